"""Times of a column, in whatever form they are written, into whole nanoseconds.

The form is that of most cells; a cell of another form is a problem of its row. Numbers since 1970 tell their unit by
their size. Times of day and small numbers count from the start of the run.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import polars as pl

from hrclog.errors import HrclogError
from hrclog.events import LATEST_NS
from hrclog.recorders.importers.table.mapping import UNITS
from hrclog.recorders.importers.table.numbers import BILLION, NUMBER, split_numbers, with_points
from hrclog.recorders.importers.table.time_units import (
    EARLIEST_S,
    LONGEST_S,
    UNIT_WORDS,
    AmbiguousTimesError,
    unit_in_name,
    unit_of,
)

EMPTY: Final = ("", "na", "n/a", "null", "none", "-", "nat")
"""Cells that say nothing, in lower case."""

_DATE: Final = r"(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})"
_SHORT_DATE: Final = r"(\d{1,2})[-/.](\d{1,2})[-/.](\d{4})"
_CLOCK: Final = r"(\d{1,2}):(\d{2})(?::(\d{2})(?:[.,](\d+))?)?"
_ZONE: Final = r"\s*(Z|z|UTC|[+-]\d{2}(?::?\d{2})?)?"
_ISO: Final = rf"^{_DATE}(?:[T ]\s*{_CLOCK}\s*([AaPp][Mm])?{_ZONE})?$"
_LOCAL_DATE: Final = rf"^{_SHORT_DATE}(?:[T ,]\s*{_CLOCK}\s*([AaPp][Mm])?{_ZONE})?$"
_SINCE: Final = r"^([+-]?)(\d{1,5}):([0-5]?\d):([0-5]?\d)(?:[.,](\d+))?$"
_PARTS: Final = ("first", "second", "third", "hour", "minute", "seconds", "rest", "half", "zone")

_SPREADSHEET_1970: Final = 25_569  # 1970-01-01 as a day of a spreadsheet
_DAY_NS: Final = UNITS["days"]
_MS: Final = 10**6


@dataclass(frozen=True, slots=True)
class TimeSettings:
    """What is known of times beside their cells."""

    timezone: str = ""
    unit: str = ""
    date_order: str = ""
    decimal: str = ""


@dataclass(frozen=True, slots=True)
class Times:
    """The times of a column.

    Attributes:
        ns: since 1970, or since the start of the run; null where the cell is empty or has a problem.
        problem: why a cell that is not empty has no time, null where it has none.
        is_relative: whether they count from the start of the run.
        form: how they were read, for people.
        is_unit_sure: whether their unit was told, or follows from their form or size.
        date_order: dmy or mdy, where dates are written so and show which; "" elsewhere.
    """

    ns: pl.Series
    problem: pl.Series
    is_relative: bool
    form: str
    is_unit_sure: bool = True
    date_order: str = ""


class AmbiguousDatesError(AmbiguousTimesError):
    """A column's dates could have the day or the month first."""


def read_times(values: pl.Series, settings: TimeSettings) -> Times:
    """Return the times of a column.

    Raises:
        AmbiguousTimesError: they could mean several things.
        HrclogError: the column holds no times, or the time zone is not known.
    """
    if settings.timezone:
        check_zone(settings.timezone)
    kind = values.dtype
    if kind in (pl.Datetime, pl.Date):
        return _typed_instants(values, settings)
    if kind in (pl.Duration, pl.Time):
        ns = values.dt.total_nanoseconds() if kind == pl.Duration else values.cast(pl.Int64)
        return Times(ns, _nothing(ns), is_relative=True, form="time since the start of the run")
    if kind.is_numeric():
        return _numbers(values, settings)
    if kind == pl.Null:
        return Times(values.cast(pl.Int64), _nothing(values), is_relative=False, form="")
    return _texts(values.cast(pl.String), settings)


def check_zone(name: str) -> None:
    """Raise if a time zone is not known.

    Raises:
        HrclogError: says so.
    """
    try:
        ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError) as error:
        raise HrclogError(f"timezone: found {name!r}, expected a name as Europe/Rome, or UTC") from error


def empty_as_null(values: pl.Series) -> pl.Series:
    """Return texts stripped, null where they say nothing."""
    texts = values.cast(pl.String).str.strip_chars()
    return pl.select(pl.when(~texts.str.to_lowercase().is_in(EMPTY)).then(texts)).to_series().rename(values.name)


def _nothing(like: pl.Series) -> pl.Series:
    return pl.Series("problem", [None], pl.String).new_from_index(0, len(like))


def _typed_instants(values: pl.Series, settings: TimeSettings) -> Times:
    zone = getattr(values.dtype, "time_zone", None)
    us = values.cast(pl.Datetime("us")).cast(pl.Int64) if values.dtype == pl.Date else None
    if zone is not None:
        ns = _ns_of(values.dt.convert_time_zone("UTC"))
        return _checked_instants(ns, _nothing(ns), "instants")
    local = values.cast(pl.Datetime("us")) if us is not None else values
    ns, problem = _in_zone(local, settings.timezone)
    return _checked_instants(ns, problem, f"instants without a zone, {_zone_text(settings.timezone)}")


def _ns_of(instants: pl.Series) -> pl.Series:
    """Return instants as ns, null beyond what int64 holds."""
    unit = {"ns": 1, "us": 10**3, "ms": 10**6}[getattr(instants.dtype, "time_unit", "us")]
    counts = instants.cast(pl.Int64)
    far = counts.abs() > LATEST_NS // unit
    return pl.select(pl.when(far).then(LATEST_NS + 1).otherwise(counts * unit)).to_series()


def _zone_text(timezone: str) -> str:
    return f"taken as {timezone}" if timezone else "taken as UTC (--timezone says otherwise)"


def _in_zone(local: pl.Series, timezone: str) -> tuple[pl.Series, pl.Series]:
    """Return the ns of local times, and why some have none: a clock that was put forward or back."""
    if timezone in ("", "UTC"):
        ns = _ns_of(local)
        return ns, _nothing(ns)
    ns = _ns_of(local.dt.replace_time_zone(timezone, ambiguous="null", non_existent="null"))
    if ns.null_count() == local.null_count():
        return ns, _nothing(ns)
    exists = local.dt.replace_time_zone(timezone, ambiguous="earliest", non_existent="null").is_not_null()
    lost = ns.is_null() & local.is_not_null()
    problem = pl.select(
        pl.when(lost & exists)
        .then(pl.lit(f"its local time comes twice in {timezone}, as clocks are put back"))
        .when(lost)
        .then(pl.lit(f"its local time does not exist in {timezone}, as clocks are put forward"))
    ).to_series()
    return ns, problem


def _checked_instants(ns: pl.Series, problem: pl.Series, form: str, *, is_unit_sure: bool = True) -> Times:
    outside = ~ns.is_between(0, LATEST_NS)
    frame = pl.select(
        pl.when(~outside).then(ns).alias("ns"),
        pl.coalesce(problem, pl.when(outside).then(pl.lit("its time is not between 1970 and 2043"))).alias("problem"),
    )
    return Times(frame["ns"], frame["problem"], is_relative=False, form=form, is_unit_sure=is_unit_sure)


def _texts(values: pl.Series, settings: TimeSettings) -> Times:
    texts = empty_as_null(values)
    if texts.null_count() == len(texts):
        return Times(texts.cast(pl.Int64, strict=False), _nothing(texts), is_relative=False, form="")
    forms = {
        "iso": texts.str.contains(_ISO),
        "clock": texts.str.contains(_SINCE),
        "local": texts.str.contains(_LOCAL_DATE),
        "number": texts.str.contains(NUMBER),
    }
    counts = {name: int(mask.sum()) for name, mask in forms.items()}
    form = max(counts, key=lambda name: counts[name])
    if not counts[form]:
        shown = ", ".join(repr(text) for text in texts.drop_nulls().head(2))
        raise HrclogError(f"column {values.name!r}: found {shown}, expected times")
    fitting = pl.select(pl.when(forms[form]).then(texts)).to_series().rename(values.name)
    times = {"iso": _iso, "clock": _clock, "local": _local_dates, "number": _numbers}[form](fitting, settings)
    other = texts.is_not_null() & ~forms[form]
    strange = pl.select(pl.when(other).then(pl.lit(f"its time is none of the form of the others ({times.form})")))
    problem = pl.select(pl.coalesce(strange.to_series(), times.problem)).to_series()
    return replace(times, problem=problem)


def _clock(texts: pl.Series, settings: TimeSettings) -> Times:  # noqa: ARG001 - as the other forms
    parts = _groups(texts, _SINCE, ("sign", "hour", "minute", "seconds", "rest"))
    whole = (_int("hour") * 3600 + _int("minute") * 60 + _int("seconds")) * BILLION + _rest()
    ns = parts.select(pl.when(pl.col("sign") == "-").then(-whole).otherwise(whole).alias("ns")).to_series()
    return Times(ns, _nothing(ns), is_relative=True, form="HH:MM:SS since the start of the run")


def _groups(texts: pl.Series, pattern: str, names: tuple[str, ...]) -> pl.DataFrame:
    groups = texts.rename("text").to_frame().select(pl.col("text").str.extract_groups(pattern).alias("groups"))
    return groups.select(pl.col("groups").struct.rename_fields(list(names))).unnest("groups")


def _int(name: str) -> pl.Expr:
    return pl.col(name).cast(pl.Int64, strict=False).fill_null(0)


def _rest() -> pl.Expr:
    return pl.col("rest").fill_null("").str.slice(0, 9).str.pad_end(9, "0").cast(pl.Int64)


def _iso(texts: pl.Series, settings: TimeSettings) -> Times:
    return _dated(_groups(texts, _ISO, _PARTS), ("first", "second", "third"), settings)


def _local_dates(texts: pl.Series, settings: TimeSettings) -> Times:
    parts = _groups(texts, _LOCAL_DATE, _PARTS)
    order = settings.date_order or _date_order(parts, texts.name)
    if order == "ymd":
        raise HrclogError(
            f"column {texts.name!r}: found {texts.drop_nulls()[0]!r}, expected dates that begin with the year"
        )
    day, month = ("first", "second") if order == "dmy" else ("second", "first")
    times = _dated(parts, ("third", month, day), settings, f"{order[0]}{order[0]}/{order[1]}{order[1]}/yyyy ")
    return replace(times, date_order=order)


def _date_order(parts: pl.DataFrame, name: str) -> str:
    first, second = parts.select(_int("first").max(), _int("second").max()).row(0)
    if first > 12 and second > 12:
        raise AmbiguousTimesError(f"column {name!r}: found dates in two orders, expected one; write them as 2026-03-31")
    if first <= 12 and second <= 12:
        raise AmbiguousDatesError(
            f"column {name!r}: found dates that have the day or the month first; say which: --date-order dmy or mdy"
        )
    return "dmy" if first > 12 else "mdy"


def _dated(parts: pl.DataFrame, date: tuple[str, str, str], settings: TimeSettings, form: str = "") -> Times:
    half = pl.col("half").str.to_lowercase().fill_null("")
    hour = (
        pl.when(half == "pm")
        .then(_int("hour") % 12 + 12)
        .when(half == "am")
        .then(_int("hour") % 12)
        .otherwise(_int("hour"))
    )
    year, month, day = (pl.col(name) for name in date)
    text = pl.format(
        "{}-{}-{} {}:{}:{}", year, month, day, hour, pl.col("minute").fill_null("0"), pl.col("seconds").fill_null("0")
    )
    seconds = text.str.to_datetime("%Y-%m-%d %H:%M:%S", time_unit="us", strict=False)
    zone = pl.col("zone").str.to_uppercase()
    digits = zone.str.replace_all(r"[^0-9]", "")
    minutes = digits.str.slice(0, 2).cast(pl.Int64, strict=False) * 60 + digits.str.slice(2, 2).cast(
        pl.Int64, strict=False
    ).fill_null(0)
    shift = pl.when(zone.str.starts_with("-")).then(-minutes).otherwise(minutes).fill_null(0)
    frame = parts.select(
        seconds.alias("local"), _rest().alias("rest"), shift.alias("shift"), zone.is_not_null().alias("zoned"),
        year.is_not_null().alias("filled"),
    )  # fmt: skip
    return _instants_of(frame, settings, form)


def _instants_of(frame: pl.DataFrame, settings: TimeSettings, form: str) -> Times:
    filled = frame["filled"]
    zoned = frame["zoned"] & filled
    has_zone, lacks_zone = bool(zoned.any()), bool((filled & ~frame["zoned"]).any())
    utc_ns = _ns_of(frame["local"]) - frame["shift"] * 60 * BILLION
    local_ns, local_problem = _in_zone(frame["local"], settings.timezone) if lacks_zone else (utc_ns, _nothing(utc_ns))
    ns = pl.select(pl.when(zoned).then(utc_ns).otherwise(local_ns) + frame["rest"]).to_series()
    mixed = has_zone and lacks_zone and not settings.timezone
    problem = pl.select(
        pl.when(filled & frame["local"].is_null())
        .then(pl.lit("its date or time of day does not exist"))
        .when(pl.lit(mixed) & filled & ~zoned)
        .then(pl.lit("its time has no zone, others have one (--timezone says which it is)"))
        .otherwise(pl.when(~zoned).then(local_problem))
    ).to_series()
    ns = pl.select(pl.when(problem.is_null()).then(ns)).to_series()
    if not has_zone:
        how = f"without a zone, {_zone_text(settings.timezone)}"
    else:
        how = (
            f"with a zone, those without one {_zone_text(settings.timezone)}"
            if lacks_zone and not mixed
            else "with a zone"
        )
    return _checked_instants(ns, problem, f"{form or 'ISO '}instants {how}")


def _numbers(values: pl.Series, settings: TimeSettings) -> Times:
    if values.dtype == pl.String:
        values = with_points(values, settings.decimal)
    parts = split_numbers(values, ".")
    problem = pl.select(
        pl.when(parts["whole"].is_null() & values.is_not_null()).then(pl.lit("its time is no finite number"))
    ).to_series()
    told = settings.unit or unit_in_name(values.name)
    unit, is_relative, is_sure = unit_of(values, parts["whole"], told)
    frame = parts.with_columns(values.cast(pl.Float64, strict=False).alias("value"))
    if unit == "days":
        since_1970 = ((pl.col("value") - _SPREADSHEET_1970) * _DAY_NS / _MS).round().cast(pl.Int64) * _MS
        ns = frame.select(since_1970.alias("ns")).to_series()
        ns, problem = _local_ns(ns, settings.timezone, problem)
        return _checked_instants(ns, problem, f"days of a spreadsheet, {_zone_text(settings.timezone)}")
    scale = UNITS[unit]
    fits = pl.col("whole").abs() <= LATEST_NS // scale
    # billionths of the unit are whole ns where it is s, else they are rounded
    rest = pl.col("billionths") if scale == BILLION else (pl.col("billionths") * scale / BILLION).round().cast(pl.Int64)
    ns = frame.select(pl.when(fits).then(pl.col("whole") * scale + rest).otherwise(
        pl.when(pl.col("whole").is_not_null()).then(LATEST_NS + 1)
    ).alias("ns")).to_series()  # fmt: skip
    if is_relative:
        far = ns.abs() > LONGEST_S * BILLION
        problem = pl.select(
            pl.coalesce(problem, pl.when(far).then(pl.lit("its time is not within 115 days of the start of the run")))
        ).to_series()
        ns = pl.select(pl.when(~far).then(ns)).to_series()
        return Times(
            ns, problem, is_relative=True, form=f"{UNIT_WORDS[unit]} since the start of the run", is_unit_sure=is_sure
        )
    size = pl.col("whole").abs() < EARLIEST_S * (BILLION // scale)
    small = parts.select(size.fill_null(value=False)).to_series()
    problem = pl.select(
        pl.coalesce(
            problem, pl.when(small).then(pl.lit(f"its time is not in {UNIT_WORDS[unit]} since 1970, as the others"))
        )
    ).to_series()
    ns = pl.select(pl.when(~small).then(ns)).to_series()
    return _checked_instants(ns, problem, f"{UNIT_WORDS[unit]} since 1970")


def _local_ns(ns: pl.Series, timezone: str, problem: pl.Series) -> tuple[pl.Series, pl.Series]:
    local = pl.select(pl.when(ns.abs() <= LATEST_NS).then(ns)).to_series().cast(pl.Datetime("ns"))
    zoned, zone_problem = _in_zone(local, timezone)
    return zoned, pl.select(pl.coalesce(problem, zone_problem)).to_series()
