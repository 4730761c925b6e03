"""Times are read exactly in whatever form they are written, or not at all."""

from __future__ import annotations

from datetime import UTC, datetime
from decimal import Decimal
from fractions import Fraction
from zoneinfo import ZoneInfo

import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.errors import HrclogError
from hrclog.recorders.importers.table.instants import TimeSettings, read_times
from hrclog.recorders.importers.table.numbers import split_numbers
from hrclog.recorders.importers.table.time_units import AmbiguousTimesError, unit_in_name

S = 10**9
# from 2000 to 2040
INSTANTS = st.lists(st.integers(946_684_800 * S, 2_208_988_800 * S), min_size=1, max_size=4)
FORMS = ("iso", "offset", "s", "ms", "us", "ns", "decimal comma", "local", "dmy", "datetime")
SCALE = {"s": S, "ms": 10**6, "us": 10**3, "ns": 1}


def text(ns: int, form: str) -> str:
    if form in SCALE:
        return f"{Decimal(ns) / SCALE[form]:f}"
    if form == "decimal comma":
        return f"{ns // S},{ns % S:09d}"
    zone = ZoneInfo("Asia/Kolkata") if form in ("offset", "local") else UTC
    clock = datetime.fromtimestamp(ns // S, zone)
    rest = f".{ns % S:09d}"
    if form == "dmy":
        return clock.strftime("%d/%m/%Y %H:%M:%S") + rest
    ending = {"iso": "Z", "offset": "+05:30", "local": ""}[form]
    return clock.strftime("%Y-%m-%dT%H:%M:%S") + rest + ending


@settings(max_examples=150)
@given(INSTANTS, st.sampled_from(FORMS))
def test_an_instant_is_read_to_the_nanosecond(instants: list[int], form: str) -> None:
    settings = TimeSettings(
        timezone="Asia/Kolkata" if form == "local" else "", date_order="dmy" if form == "dmy" else ""
    )
    if form == "datetime":
        cells = (
            pl.Series("start", instants, pl.Int64).cast(pl.Datetime("ns", "UTC")).dt.convert_time_zone("Europe/Rome")
        )
    else:
        cells = pl.Series("start", [text(ns, form) for ns in instants])
    times = read_times(cells, settings)
    assert times.ns.to_list() == instants
    assert not times.is_relative
    assert times.problem.null_count() == len(instants)


@given(st.lists(st.integers(0, 10**6 * S), min_size=1, max_size=4), st.booleans())
def test_a_time_since_the_start_of_the_run_is_read_to_the_nanosecond(lengths: list[int], as_clock: bool) -> None:
    cells = [
        f"{ns // S // 3600}:{ns // S // 60 % 60:02d}:{ns // S % 60:02d}.{ns % S:09d}"
        if as_clock
        else f"{Decimal(ns) / S:f}"
        for ns in lengths
    ]
    times = read_times(pl.Series("t", cells), TimeSettings(unit="s"))
    assert times.ns.to_list() == lengths
    assert times.is_relative


@given(st.lists(st.floats(-9e17, 9e17), min_size=1, max_size=5))
def test_a_float_is_split_to_the_nearest_billionth(values: list[float]) -> None:
    parts = split_numbers(pl.Series("n", values))
    for value, (whole, billionths) in zip(values, parts.rows(), strict=True):
        assert abs(Fraction(value) * S - (whole * S + billionths)) <= Fraction(1, 2)


@given(st.lists(st.decimals(-(10**12), 10**12, places=9), min_size=1, max_size=5), st.sampled_from([".", ","]))
def test_a_decimal_text_is_split_exactly(values: list[Decimal], sign: str) -> None:
    texts = pl.Series("n", [f"{value:f}".replace(".", sign) for value in values])
    parts = split_numbers(texts, sign)
    assert [whole * S + rest for whole, rest in parts.rows()] == [int(value * S) for value in values]


def test_local_times_that_clocks_skip_or_repeat_are_no_instants() -> None:
    cells = pl.Series("t", ["2026-03-29 02:30:00", "2026-10-25 02:30:00", "2026-03-29 03:30:00"])
    times = read_times(cells, TimeSettings(timezone="Europe/Rome"))
    assert times.ns.to_list() == [None, None, 1774747800 * S]
    assert ["does not exist" in times.problem[0], "comes twice" in times.problem[1], times.problem[2]] == [
        True,
        True,
        None,
    ]


def test_times_without_a_zone_among_others_are_problems_unless_the_zone_is_told() -> None:
    cells = pl.Series("t", ["2026-03-02T09:00:00Z", "2026-03-02T09:00:00"])
    assert read_times(cells, TimeSettings()).ns.to_list() == [1772442000 * S, None]
    assert read_times(cells, TimeSettings(timezone="Europe/Rome")).ns.to_list() == [1772442000 * S, 1772438400 * S]


@pytest.mark.parametrize("cell", ["12345678901", "02/03/2026 09:00", "36000.25143", "99999999999999"])
def test_what_could_be_several_times_is_refused(cell: str) -> None:
    cells = pl.Series("t", [cell])
    if cell == "36000.25143":  # five digits: a day of a spreadsheet; with four it is neither
        assert read_times(cells, TimeSettings()).form.startswith("days of a spreadsheet")
        cells = pl.Series("t", ["36000.2514"])
    with pytest.raises(AmbiguousTimesError):
        read_times(cells, TimeSettings())


@pytest.mark.parametrize("cell", ["soon", "12", "robot"])
def test_a_column_of_words_holds_no_times(cell: str) -> None:
    if cell == "12":
        assert read_times(pl.Series("t", [cell]), TimeSettings()).ns.to_list() == [12 * S]
        return
    with pytest.raises(HrclogError, match="expected times"):
        read_times(pl.Series("t", [cell]), TimeSettings())


def test_not_a_number_is_a_problem_and_an_empty_cell_is_none() -> None:
    times = read_times(pl.Series("t", ["1772442000", "NaN", "", "NA"]), TimeSettings())
    assert times.ns.to_list() == [1772442000 * S, None, None, None]
    assert [problem is None for problem in times.problem] == [True, False, True, True]
    assert read_times(pl.Series("t", [1772442000.5, float("nan")]), TimeSettings()).problem[1] is not None


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("start_ms", "ms"),
        ("Stop (s)", "s"),
        ("Begin Time - ss.msec", "s"),
        ("t_us", "us"),
        ("tasks", ""),
        ("status", ""),
    ],
)
def test_the_name_of_a_column_may_tell_its_unit(name: str, unit: str) -> None:
    assert unit_in_name(name) == unit
