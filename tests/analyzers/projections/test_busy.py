"""Busy time against a set of covered integers."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from interval_frames import frame, row

from hrclog.analyzers.projections.busy import BusyTime, busy_times

spans = st.lists(st.tuples(st.integers(-10, 20), st.integers(0, 8)), max_size=8)


def covered(found: list[tuple[int, int]]) -> set[int]:
    return {instant for start, length in found for instant in range(start, start + length)}


def busy_time(found: list[tuple[int, int]]) -> BusyTime:
    starts = np.array([start for start, _ in found], np.int64)
    return BusyTime(starts, starts + np.array([length for _, length in found], np.int64))


@given(spans)
def test_busy_time_is_the_union_of_the_executions(found: list[tuple[int, int]]) -> None:
    busy = busy_time(found)
    assert busy.total == len(covered(found))
    assert (busy.start[1:] > busy.end[:-1]).all()
    blocks = zip(busy.start.tolist(), busy.end.tolist(), strict=True)
    assert {instant for start, end in blocks for instant in range(start, end)} == covered(found)


@given(spans, st.lists(st.integers(-15, 35), max_size=8))
def test_busy_time_until_an_instant_counts_what_came_before(found: list[tuple[int, int]], times: list[int]) -> None:
    union = covered(found)
    expected = [sum(instant < time for instant in union) for time in times]
    assert busy_time(found).until(np.array(times, np.int64)).tolist() == expected


@given(spans, st.lists(st.tuples(st.integers(-15, 25), st.integers(0, 12)), max_size=8))
def test_busy_time_within_an_interval_is_what_the_two_share(
    found: list[tuple[int, int]], windows: list[tuple[int, int]]
) -> None:
    starts = np.array([start for start, _ in windows], np.int64)
    ends = starts + np.array([length for _, length in windows], np.int64)
    expected = [len(covered(found) & covered([window])) for window in windows]
    assert busy_time(found).within(starts, ends).tolist() == expected


def test_busy_times_are_kept_per_run_and_agent_without_the_steps_of_a_sequence() -> None:
    rows = [
        row("A", "x", 0, 5, run_id="r"),
        row("A", "y", 3, 9, run_id="r"),
        row("A", "step", 20, 30, run_id="r", parent_execution_id="x0"),
        row("A", "x", 0, 2, run_id="s"),
        row("B", "home", 7, 8, run_id="s", role="auxiliary"),
    ]
    found = {
        run: {agent: busy.total for agent, busy in agents.items()} for run, agents in busy_times(frame(rows)).items()
    }
    assert found == {"r": {"A": 9}, "s": {"A": 2, "B": 1}}
