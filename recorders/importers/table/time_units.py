"""The unit of a column of numbers that are times: as its name tells, or its numbers by their size and digits."""

from __future__ import annotations

import re
from typing import Final

import polars as pl

from hrclog.errors import HrclogError
from hrclog.events import LATEST_NS
from hrclog.recorders.importers.table.mapping import UNITS
from hrclog.recorders.importers.table.numbers import BILLION

UNIT_WORDS: Final = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds", "days": "days"}

# seconds since 1970 from 1979 on, and up to what int64 and `LATEST_NS` allow; other units times theirs
EARLIEST_S: Final = 3 * 10**8
_LATEST_S: Final = LATEST_NS // BILLION
LONGEST_S: Final = 10**7
"""Of a relative time, 115 days."""

_SERIAL_DAYS: Final = (20_000, 60_000)  # 1954 to 2064
_SERIAL_DIGITS: Final = 5  # a second is 0.0000116 days
_UNIT_IN_NAME: Final = re.compile(
    r"(?:^|[\W_])(?P<unit>ss\.msec|ns|nsec|nanoseconds?|us|µs|usec|ms|msec|msecs|millis|milliseconds?|s|sec|secs|seconds?)\W*$",
    re.IGNORECASE,
)
_NAMED_UNITS: Final = {"n": "ns", "u": "us", "µ": "us", "s": "s"}


class AmbiguousTimesError(HrclogError):
    """A column's times could mean several things."""


def unit_in_name(name: str) -> str:
    """Return the unit that the name of a column tells, "" for none: `start_ms`, `Stop (s)`."""
    match = _UNIT_IN_NAME.search(name.strip())
    if match is None:
        return ""
    unit = match["unit"].lower()
    if unit.startswith("m"):
        return "ms"
    return _NAMED_UNITS[unit[0]]


def unit_of(values: pl.Series, whole: pl.Series, told: str) -> tuple[str, bool, bool]:
    """Return the unit of numbers, whether they count from the start of the run, and whether the unit is sure."""
    sizes = whole.drop_nulls().abs()
    if not len(sizes):
        return told or "s", True, True
    if told == "days":
        return "days", False, True
    if told:
        floor = EARLIEST_S * (BILLION // UNITS[told])
        return told, bool((sizes >= floor).mean() < 0.5), True  # type: ignore[operator]  # a mean of booleans
    by_size = {
        unit: int(sizes.is_between(EARLIEST_S * factor, _LATEST_S * factor).sum())
        for unit, factor in (("s", 1), ("ms", 10**3), ("us", 10**6), ("ns", 10**9))
    }
    n_relative = int((sizes < LONGEST_S).sum())
    best = max(by_size, key=lambda unit: by_size[unit])
    if by_size[best] > max(n_relative, len(sizes) // 2):
        return best, False, True
    if n_relative <= len(sizes) // 2:
        raise AmbiguousTimesError(
            f"column {values.name!r}: found {values.drop_nulls()[0]}, which is no instant in s, ms, us or ns since "
            "1970 and no time since the start of a run; say what it counts: --unit s, ms, us, ns or days"
        )
    if int(sizes.is_between(*_SERIAL_DAYS).sum()) > len(sizes) // 2:
        return _serial_or_seconds(values)
    return "s", True, False


def _serial_or_seconds(values: pl.Series) -> tuple[str, bool, bool]:
    """Tell days of a spreadsheet from seconds, by the digits behind the point: a second is 0.0000116 days."""
    digits = values.drop_nulls().cast(pl.String).str.extract(r"\.(\d+)$").fill_null("").str.len_chars().median()
    if isinstance(digits, float) and digits >= _SERIAL_DIGITS:
        return "days", False, True
    if isinstance(digits, float) and digits <= 3 and digits > 0:
        return "s", True, False
    raise AmbiguousTimesError(
        f"column {values.name!r}: found {values.drop_nulls()[0]}, seconds since the start of a run or days of a "
        "spreadsheet; say which: --unit s or --unit days"
    )
