"""Instants of JSON lines in another unit than nanoseconds: they are refused, with what to type instead."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from typing import Any, Final

from hrclog.errors import InvalidEventError
from hrclog.log.messages.json_rows import short
from hrclog.units import NS_PER_S

FIRST_NS: Final = 946_684_800 * NS_PER_S
"""2000-01-01. A run that begins before it is on a clock of its own, for example a simulation's that begins at 0."""

_UNITS: Final = (("seconds", 1), ("milliseconds", 10**3), ("microseconds", 10**6))
_FIRST_S: Final = FIRST_NS // NS_PER_S
_LAST_S: Final = 4_102_444_800  # 2100-01-01
_FIELDS: Final = ("time_ns", "planned_start_ns", "planned_end_ns")  # an agent's own clock may count from anywhere
_OWN_CLOCK: Final = "begin a run on a clock of its own with a run_started at time_ns 0"
_MAX_FRACTION: Final = 2**53  # floats hold no fractions above it


def check_times(value: Mapping[str, Any], first_ns: int | None) -> None:
    """Raise if an instant is plainly no number of nanoseconds.

    Args:
        value: the JSON object of a line.
        first_ns: the first instant that a line of its run stated, None if this is the first.

    Raises:
        InvalidEventError: says what was found, and what to type.
    """
    for name in _FIELDS:
        time = value.get(name)
        if time is None or (type(time) is int and time >= FIRST_NS):  # as nearly all are
            continue
        if isinstance(time, str):
            raise InvalidEventError(f"{name} is {short(time)}, expected whole nanoseconds since 1970{_of_text(time)}")
        if isinstance(time, int | float) and not isinstance(time, bool):
            _check_number(name, time, first_ns)


def _check_number(name: str, time: float, first_ns: int | None) -> None:
    is_on_own_clock = first_ns is not None and first_ns < FIRST_NS
    for unit, per_second in _UNITS:
        if not is_on_own_clock and _FIRST_S * per_second <= time < _LAST_S * per_second:
            day = datetime.fromtimestamp(time / per_second, UTC).date()
            factor = NS_PER_S // per_second
            text = f"{name} is {time}: found {unit} since 1970 ({day}), expected nanoseconds; multiply by {factor}: "
            otherwise = f", or {_OWN_CLOCK}" if first_ns is None else ""
            raise InvalidEventError(f"{text}write {_times(time, factor)}{otherwise}")
    if not math.isfinite(time):
        raise InvalidEventError(f"{name} is {time}, expected whole nanoseconds since 1970")
    if isinstance(time, float) and abs(time) < _MAX_FRACTION and not time.is_integer():
        text = f"{name} is {time}: found a fraction, as seconds have one, expected whole nanoseconds"
        raise InvalidEventError(f"{text}; if it is seconds, multiply by {NS_PER_S}: write {_times(time, NS_PER_S)}")
    if time < 0 and name == "time_ns":
        raise InvalidEventError(f"{name} is {short(time)}, expected nanoseconds since 1970, not before it")


def _times(time: float, factor: int) -> int:
    """Return a number of another unit as nanoseconds, by the digits that were written."""
    return round(Decimal(repr(time)) * factor)


def _of_text(text: str) -> str:
    """Return what to write instead of a text, if it is an instant or a number."""
    if text.strip().isdecimal():
        return ", without quotes"
    try:
        instant = datetime.fromisoformat(text.strip())
    except ValueError:
        return ""
    if instant.tzinfo is None:
        return "; it names no time zone either"
    return f": write {(instant - datetime.fromtimestamp(0, UTC)) // timedelta(microseconds=1) * 1000}"
