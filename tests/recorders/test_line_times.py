"""Instants in another unit than nanoseconds are refused, with what to type; those of a clock of its own are not."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta, timezone
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hrclog.errors import InvalidEventError
from hrclog.recorders.line_times import FIRST_NS, check_times

NOON = 1_772_452_800_000_000_000
UNITS = {"seconds": 10**9, "milliseconds": 10**6, "microseconds": 10**3}


def refusal(time: object, first_ns: int | None = NOON, field: str = "time_ns") -> str:
    with pytest.raises(InvalidEventError) as error:
        check_times({"kind": "heartbeat", field: time}, first_ns)
    return str(error.value)


@given(
    st.integers(950_000_000, 4_000_000_000),
    st.integers(0, 999),
    st.sampled_from(list(UNITS)),
    st.sampled_from([None, NOON]),
    st.sampled_from(["time_ns", "planned_start_ns", "planned_end_ns"]),
)
def test_what_to_type_is_the_same_instant_in_nanoseconds(
    seconds: int, ms: int, unit: str, first_ns: int | None, field: str
) -> None:
    instant_ns = seconds * 10**9 + ms * 10**6
    whole, rest = divmod(instant_ns, UNITS[unit])
    text = refusal(float(f"{whole}.{ms:03}") if rest else whole, first_ns, field)
    assert f"found {unit} since 1970" in text
    assert f"write {instant_ns}" in text
    assert ("clock of its own" in text) == (first_ns is None)


@given(st.integers(0, FIRST_NS - 1), st.integers(0, 2**61))
def test_a_run_on_a_clock_of_its_own_is_never_questioned(first_ns: int, time_ns: int) -> None:
    check_times({"time_ns": time_ns}, first_ns)


@given(st.integers(0, 946_000_000), st.sampled_from([None, 0, NOON]))
def test_instants_that_are_small_in_every_unit_may_be_those_of_a_simulation(time_ns: int, first_ns: int | None) -> None:
    check_times({"time_ns": time_ns}, first_ns)


@given(st.integers(FIRST_NS, 2**61), st.sampled_from([None, NOON, 0]))
def test_nanoseconds_pass(time_ns: int, first_ns: int | None) -> None:
    check_times({"time_ns": time_ns, "planned_end_ns": time_ns}, first_ns)


@pytest.mark.parametrize("first_ns", [None, NOON, 0])
@pytest.mark.parametrize(
    ("time", "hint"),
    [
        (12.5, "if it is seconds, multiply by 1000000000: write 12500000000$"),
        (-0.5, "found a fraction"),
        (-1, "not before it"),
        (-(10**18), "not before it"),
        (float("nan"), "expected whole nanoseconds"),
        (float("inf"), "expected whole nanoseconds"),
        (str(NOON), "without quotes$"),
        ("now", "expected whole nanoseconds since 1970$"),
        ("2026-03-02T12:00:00", "names no time zone"),
    ],
)
def test_what_is_no_whole_number_is_refused_whatever_the_clock(time: Any, hint: str, first_ns: int | None) -> None:  # noqa: ANN401 - anything of JSON
    assert re.search(hint, refusal(time, first_ns))


@given(st.datetimes(datetime(1971, 1, 1), datetime(2040, 1, 1)), st.integers(-12, 12))  # noqa: DTZ001 - the zone is drawn
def test_a_text_with_a_zone_is_told_in_nanoseconds(local: datetime, hours: int) -> None:
    instant = local.replace(tzinfo=timezone(timedelta(hours=hours)))
    since_1970 = instant - datetime(1970, 1, 1, tzinfo=UTC)
    assert refusal(instant.isoformat()).endswith(f": write {since_1970 // timedelta(microseconds=1) * 1000}")
