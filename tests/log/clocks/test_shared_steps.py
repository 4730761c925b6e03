"""A clock that all agents share and that is put back: both times fall, and the order of writing goes on."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from clock_runs import BEGIN, HUMAN, SECOND, Written, ahead, jumps, run, write
from hypothesis import given, settings
from hypothesis import strategies as st

import hrclog
from hrclog.diagnostic import TIMES_IN_DOUBT, Diagnostic
from hrclog.log.clocks.shared_steps import shared_steps
from hrclog.log.reader import read_logs

TEMPORARY = tempfile.TemporaryDirectory()


def stepped(size: float, after: float, delays: Sequence[float] = (0.002,), tasks: int = 8) -> list[Written]:
    """Return a run on one computer, whose clock is put back by `size` s some time after the begin."""
    clock = jumps(-size, BEGIN + round(after * SECOND))
    return run(clock, clock, delays, log=clock, tasks=tasks)


def found(path: Path) -> list[Diagnostic]:
    return [finding for finding in read_logs(path).diagnostics if "share" in finding.message]


@settings(max_examples=25)
@given(st.floats(0.5, 4000), st.floats(2, 85), st.sampled_from(({}, {"seq": 0})))
def test_a_step_of_the_clock_of_all_is_found_where_times_fall(
    size: float, after: float, columns: dict[str, int]
) -> None:
    events = stepped(size, after)
    falls = [one.log_time - other.log_time for one, other in pairwise(events)]
    diagnostics = found(write(Path(TEMPORARY.name, "a.mcap"), events, **columns))
    assert [finding.code for finding in diagnostics] == ["clock_jump"] * (max(falls) > SECOND)
    for finding in diagnostics:
        assert finding.code in TIMES_IN_DOUBT
        assert finding.seq == falls.index(max(falls)) + 1
        assert finding.run_id == "run"
        shown = float(finding.message.split("at least ")[1].split(" s ")[0])
        assert shown == pytest.approx(max(falls) / SECOND, abs=0.001)


def test_results_stand_beside_the_doubt(tmp_path: Path) -> None:
    analysis = hrclog.analyze(write(tmp_path / "a.mcap", stepped(30, 40)))
    assert "clock_jump" in {finding.code for finding in analysis.diagnostics}


def test_files_of_several_recorders_are_not_compared(tmp_path: Path) -> None:
    events = run(delays=[0.002])
    of_human = [getattr(entry.event, "agent", "") == HUMAN for entry in events]
    late = ahead(-10)
    theirs = [
        Written(replace(entry.event, time_ns=late(entry.event.time_ns)), late(entry.log_time))
        for entry, is_theirs in zip(events, of_human, strict=True)
        if is_theirs
    ]
    write(tmp_path / "human.mcap", theirs, seq=0)
    mine = [entry for entry, is_theirs in zip(events, of_human, strict=True) if not is_theirs]
    write(tmp_path / "robot.mcap", mine, seq=0)
    assert found(tmp_path) == []


@settings(max_examples=15)
@given(st.lists(st.floats(0, 0.9), min_size=40, max_size=40))
def test_events_that_overtake_each_other_are_no_step(delays: list[float]) -> None:
    events = run(delays=[0.001], tasks=8)
    late = [
        Written(
            replace(entry.event, time_ns=entry.event.time_ns + round(delay * SECOND)),
            entry.log_time + round(delay * SECOND),
        )
        for entry, delay in zip(events, delays, strict=False)
    ]
    assert found(write(Path(TEMPORARY.name, "a.mcap"), late)) == []


@pytest.mark.parametrize("lag", [0, 10**6])
def test_agents_one_after_the_other_and_rows_of_a_table_are_no_steps(tmp_path: Path, lag: int) -> None:
    events = [entry.event for entry in run(tasks=8)]
    orders = {
        "agents": lambda event: (getattr(event, "agent", ""), event.seq),
        "rows": lambda event: (getattr(event, "execution_id", "")[-1:], getattr(event, "agent", ""), event.seq),
    }
    for name, order in orders.items():
        rows = [replace(event, seq=seq) for seq, event in enumerate(sorted(events, key=order))]
        path = write(tmp_path / f"{name}.mcap", [Written(event, event.time_ns + lag) for event in rows])
        assert found(path) == [], name


def test_times_copied_by_a_converter_are_no_log_times(tmp_path: Path) -> None:
    events = [entry.event for entry in run(tasks=3)]
    events[4], events[7] = replace(events[7], seq=4), replace(events[4], seq=7)
    assert found(write(tmp_path / "a.mcap", [Written(event, event.time_ns) for event in events])) == []


def test_many_logs_that_are_in_order_cost_no_sorting(tmp_path: Path) -> None:
    events = read_logs(write(tmp_path / "a.mcap", run())).events
    assert shared_steps(events.drop("time_ns", "log_time_ns", "kind")) == []
