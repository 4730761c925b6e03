"""A wrong frame handed to a public function ends in one error that says what was found, expected and to do."""

from __future__ import annotations

import timeit
from collections.abc import Callable
from pathlib import Path

import polars as pl
import pytest
from interval_frames import frame, row

import hrclog
from hrclog.analyzers.projections.frames import EVENTS_FRAME, INTERVALS_FRAME, SIGNALS_FRAME, FrameKind, check_frame
from hrclog.analyzers.projections.schemas import DURATIONS, METRICS, OVERLAPS, SIGNALS
from hrclog.log.messages.message import EVENTS

SAMPLE = Path(__file__).parents[3] / "sample_logs" / "campaign" / "paper_0000.mcap"
INTERVALS_MADE = frame([row("human", "pick", 0, 5), row("robot", "place", 2, 7)])
EVENTS_MADE = pl.DataFrame(schema=EVENTS)

OF_INTERVALS = [hrclog.overlaps, hrclog.durations, hrclog.metrics]
KINDS = [EVENTS_FRAME, INTERVALS_FRAME, SIGNALS_FRAME]


class PandasFrame:
    """What pandas calls a frame, without pandas."""

    __module__ = "pandas.core.frame"


PandasFrame.__name__ = "DataFrame"

NO_FRAMES: list[tuple[object, str]] = [
    (None, "found None"),
    ("runs/a.mcap", "found the path 'runs/a.mcap'"),
    (Path("runs/a.mcap"), f"found the path '{Path('runs/a.mcap')}'"),
    (pl.LazyFrame(), r"found a LazyFrame (its collect() makes a DataFrame)"),
    (PandasFrame(), "found a pandas DataFrame (polars.from_pandas makes a DataFrame)"),
    ([1, 2], "found a value of type list"),
    (hrclog.Logs, "found a value of type type"),
]


def refusal(function: Callable[..., object], *arguments: object) -> str:
    with pytest.raises(hrclog.HrclogError) as caught:
        function(*arguments)
    assert type(caught.value) is hrclog.HrclogError
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(("value", "found"), NO_FRAMES, ids=lambda part: str(part)[:20])
@pytest.mark.parametrize("function", [hrclog.intervals, *OF_INTERVALS], ids=lambda function: function.__name__)
def test_what_is_no_frame_is_refused_by_its_name(function: Callable[..., object], value: object, found: str) -> None:
    wanted = "events" if function is hrclog.intervals else "intervals"
    made_by = "hrclog.read_events(LOGS)" if wanted == "events" else "hrclog.intervals(hrclog.read_events(LOGS))"
    page = "docs/events.md" if wanted == "events" else "docs/tables.md"
    expected = f"expected a polars DataFrame with the columns of {wanted} ({page}); {made_by} makes one"
    assert refusal(function, value) == f"{wanted}: {found}, {expected}"


@pytest.mark.parametrize("function", OF_INTERVALS, ids=lambda function: function.__name__)
def test_events_where_intervals_are_expected_are_called_events(function: Callable[..., object]) -> None:
    text = refusal(function, EVENTS_MADE)
    assert text.startswith("intervals: found a frame of events without dispatched_ns, start_ns, end_ns, until_ns and 1")
    assert "attempt as UInt32 instead of Int64" in text


def test_intervals_where_events_are_expected_are_called_intervals() -> None:
    text = refusal(hrclog.intervals, INTERVALS_MADE)
    assert text.startswith(
        "events: found a frame of intervals without schema_version, seq, time_ns, agent_time_ns and "
    )


@pytest.mark.parametrize(
    ("schema", "name"), [(OVERLAPS, "overlaps"), (DURATIONS, "durations"), (METRICS, "metrics"), (SIGNALS, "signals")]
)
def test_frames_of_other_kinds_are_called_what_they_are(schema: pl.Schema, name: str) -> None:
    assert f"found a frame of {name} without " in refusal(hrclog.overlaps, pl.DataFrame(schema=schema))


def test_a_missing_column_is_named_and_so_is_one_of_a_wrong_type() -> None:
    less = INTERVALS_MADE.drop("until_ns").with_columns(pl.col("start_ns").cast(pl.Float64))
    found = "found a frame without until_ns and with start_ns as Float64 instead of Int64, expected"
    assert found in refusal(hrclog.durations, less)
    assert "found a frame without until_ns, expected" in refusal(hrclog.durations, INTERVALS_MADE.drop("until_ns"))
    text = INTERVALS_MADE.with_columns(pl.col("end_ns").cast(pl.String))
    assert "found a frame of intervals with end_ns as String instead of Int64, expected" in refusal(
        hrclog.overlaps, text
    )


def test_logs_and_analyses_are_told_from_the_frames_that_they_hold() -> None:
    logs, analysis = hrclog.read_logs(SAMPLE), hrclog.analyze(SAMPLE)
    assert "found a value of type Logs (its .events is such a frame), expected" in refusal(hrclog.intervals, logs)
    found = "found a value of type Analysis (its .intervals is such a frame), expected"
    assert found in refusal(hrclog.durations, analysis)
    assert "found a value of type Logs, expected" in refusal(hrclog.overlaps, logs)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_the_page_that_is_named_lists_the_columns(kind: FrameKind) -> None:
    page = (Path(__file__).parents[3] / kind.page).read_text(encoding="utf-8")
    assert [name for name in kind.schema if f"`{name}`" not in page] == []


def test_an_empty_frame_without_columns_is_refused() -> None:
    assert "found a frame without run_id, agent, task, task_type and 19 more columns" in refusal(
        hrclog.overlaps, pl.DataFrame()
    )


def test_metrics_check_events_and_signals_as_well() -> None:
    assert refusal(hrclog.metrics, INTERVALS_MADE, INTERVALS_MADE).startswith("events: found a frame of intervals")
    text = refusal(hrclog.metrics, INTERVALS_MADE, None, EVENTS_MADE)
    assert text.startswith("signals: found a frame of events without name, value, expected")
    assert text.endswith("hrclog.read_logs(LOGS, signals=True).signals makes one")


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_right_frames_pass_with_further_columns_in_any_order_and_without_rows(kind: FrameKind) -> None:
    right = pl.DataFrame(schema=kind.schema)
    check_frame(right, kind)
    check_frame(right.select(*reversed(right.columns), pl.lit(1).alias("further")), kind)


def test_what_the_named_functions_make_is_accepted() -> None:
    logs = hrclog.read_logs(SAMPLE, signals=True)
    check_frame(hrclog.read_events(SAMPLE), EVENTS_FRAME)
    check_frame(hrclog.intervals(logs.events), INTERVALS_FRAME)
    check_frame(logs.signals, SIGNALS_FRAME)


def test_a_check_costs_far_less_than_what_it_precedes() -> None:
    times = min(timeit.repeat(lambda: check_frame(INTERVALS_MADE, INTERVALS_FRAME), number=100, repeat=5))
    assert times / 100 < 1e-3
