"""Clocks that disagree: what reading says of them, and what corrects them."""

from __future__ import annotations

import random
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from clock_runs import BEGIN, HUMAN, ROBOT, SECOND, Written, ahead, jumps, right, run, write
from hypothesis import given, settings
from hypothesis import strategies as st

import hrclog
from hrclog.diagnostic import Diagnostic
from hrclog.errors import HrclogError
from hrclog.events import ClockSynced
from hrclog.log.clocks.offsets import parse_offset
from hrclog.log.logs import Logs
from hrclog.log.reader import read_events, read_logs

DAY = 86_400
TEMPORARY = tempfile.TemporaryDirectory()
RELIABLE = ("clock_offset", "clock_jump", "clock_step", "log_times_shifted", "log_times_untimely", "clock_corrected")
offsets = st.one_of(st.floats(3, 7200), st.floats(3, 19 * DAY)).flatmap(lambda size: st.sampled_from((size, -size)))


def logs_of(folder: Path, *parts: Any, **arguments: Any) -> Logs:  # noqa: ANN401 - arguments of `run`
    path = folder / "a.mcap"
    path.unlink(missing_ok=True)
    return read_logs(write(path, run(*parts, **arguments)))


def told(logs: Logs) -> list[Diagnostic]:
    return [finding for finding in logs.diagnostics if finding.code in RELIABLE]


def codes(logs: Logs) -> list[str]:
    return [finding.code for finding in told(logs)]


def delays(seed: int, longest: float = 0.3) -> list[float]:
    source = random.Random(seed)
    return [source.random() * longest for _ in range(60)]


@settings(max_examples=12)
@given(offsets, st.booleans(), st.integers(0, 99))
def test_a_clock_that_is_off_is_named_and_what_is_printed_corrects_it(seconds: float, human: bool, seed: int) -> None:
    folder = Path(TEMPORARY.name)
    agent, other = (HUMAN, ROBOT) if human else (ROBOT, HUMAN)
    clocks = {"human" if human else "robot": ahead(seconds)}
    logs = logs_of(folder, delays=delays(seed), **clocks)
    (finding,) = told(logs)
    assert (finding.code, finding.severity, finding.run_id) == ("clock_offset", "warning", "run")
    assert repr(agent) in finding.message
    assert repr(other) in finding.message
    printed = finding.message.split("--clock ")[1].split()[0]
    name, text = printed.split("=")
    assert name == agent
    assert parse_offset(text) == pytest.approx(seconds * SECOND, abs=0.31 * SECOND)
    corrected = read_logs(folder / "a.mcap", clocks={agent: parse_offset(text)})
    assert codes(corrected) == ["clock_corrected"]
    expected = hrclog.intervals(logs_of(folder).events)
    for column in ("start_ns", "end_ns"):
        difference = (hrclog.intervals(corrected.events)[column] - expected[column]).abs().max()
        assert difference is not None
        assert difference < 0.31 * SECOND  # type: ignore[operator] # an integer


@settings(max_examples=12)
@given(st.integers(0, 999), st.sampled_from((0.01, 0.3, 0.9, 3.0)), st.sampled_from((1, 2, 6)))
def test_delays_are_no_fault_of_a_clock(seed: int, longest: float, tasks: int) -> None:
    assert codes(logs_of(Path(TEMPORARY.name), delays=delays(seed, longest), tasks=tasks)) == []


@settings(max_examples=12)
@given(st.floats(10, 7200), st.sampled_from((1, -1)), st.floats(3, 55), st.integers(0, 99))
def test_a_jump_within_a_run_names_agent_size_and_place(size: float, sign: int, after: float, seed: int) -> None:
    at = BEGIN + round(after * SECOND)
    logs = logs_of(Path(TEMPORARY.name), jumps(sign * size, at), delays=delays(seed, 0.1))
    (jump,) = told(logs)[:1]
    assert (jump.code, jump.severity) == ("clock_jump", "warning")
    assert "'human'" in jump.message
    shown = float(jump.message.split(" by ")[1].split(" s ")[0])
    assert shown == pytest.approx(sign * size, abs=0.3)
    assert jump.seq is not None
    written = {entry.event.seq: entry.log_time for entry in run(jumps(sign * size, at), delays=delays(seed, 0.1))}
    assert written[jump.seq] >= at


def test_a_step_back_during_a_task_is_a_step_of_the_clock(tmp_path: Path) -> None:
    logs = logs_of(tmp_path, jumps(-3600, BEGIN + 25 * SECOND))  # human2 works from 23 s to 31 s
    analysis = hrclog.analyze(tmp_path / "a.mcap")
    found = [finding.code for finding in analysis.diagnostics if finding.severity != "info"]
    assert found[:3] == ["time_not_monotonic", "clock_jump", "clock_step"]
    assert set(found[3:]) == {"before_run_start", "single_outcome"}
    assert codes(logs) == ["clock_jump"]
    assert "while an execution was open" in told(logs)[0].message
    (step,) = (finding for finding in analysis.diagnostics if finding.code == "clock_step")
    assert "'human'" in step.message
    interrupted = analysis.intervals.filter(pl.col("execution_id") == "human2")
    assert interrupted.select("outcome", "end_ns").rows() == [("unknown", None)]
    assert analysis.durations["max_s"].max() == 8.0


def test_days_off_for_all_alike_single_nobody_out(tmp_path: Path) -> None:
    logs = logs_of(tmp_path, log=ahead(19 * DAY))
    (shifted,) = told(logs)
    assert (shifted.code, shifted.severity) == ("log_times_shifted", "info")
    assert "1641600 s (19.0 days) later" in shifted.message
    assert HUMAN not in shifted.message
    assert "earlier" in told(logs_of(tmp_path, log=ahead(-60)))[0].message


def test_a_replayed_run_still_tells_whose_clock_is_off(tmp_path: Path) -> None:
    logs = logs_of(tmp_path, ahead(600), log=ahead(19 * DAY), delays=delays(1))
    assert codes(logs) == ["clock_offset", "log_times_shifted"]
    assert "'human' is off by +" in told(logs)[0].message


@pytest.mark.parametrize(
    "log",
    [lambda _: BEGIN, lambda instant: BEGIN + (instant - BEGIN) // 10_000, lambda _: 0],
    ids=["one", "burst", "0"],
)
def test_log_times_that_are_all_the_same_tell_nothing_of_clocks(log: Any, tmp_path: Path) -> None:  # noqa: ANN401 - a Clock
    (remark,) = told(logs_of(tmp_path, ahead(3600), log=log))
    assert (remark.code, remark.severity) == ("log_times_untimely", "info")


def test_a_bag_played_at_double_speed_tells_nothing_of_clocks(tmp_path: Path) -> None:
    logs = logs_of(tmp_path, log=lambda instant: BEGIN + (instant - BEGIN) // 2)
    assert codes(logs) == ["log_times_untimely"]


def synced(every: float | None, clock: Any = right, gap: float = 1e-4, **arguments: Any) -> list[Written]:  # noqa: ANN401 - a function of any kind of step
    """Return a run of which the human's events wait, and are written together at the end or at every sync."""
    events = run(clock, **arguments)
    end = max(entry.log_time for entry in events) + 3 * SECOND
    waiting: dict[int, int] = {}
    late: list[Written] = []
    for entry in events:
        log_time = entry.log_time
        if getattr(entry.event, "agent", "") == HUMAN:
            sync = end if every is None else (log_time // round(every * SECOND) + 1) * round(every * SECOND)
            waiting[sync] = waiting.get(sync, 0) + 1
            log_time = sync + round(waiting[sync] * gap * SECOND)
        late.append(Written(entry.event, log_time))
    return [
        Written(replace(entry.event, seq=seq), entry.log_time)
        for seq, entry in enumerate(sorted(late, key=lambda entry: entry.log_time))
    ]


@pytest.mark.parametrize("clock", [right, ahead(-30)], ids=["right", "behind"])
@pytest.mark.parametrize(("every", "gap"), [(None, 1e-4), (None, 0.3), (30, 1e-4), (30, 0.1), (20, 0.01)])
def test_events_that_waited_are_no_fault_of_a_clock(every: Any, gap: float, clock: Any, tmp_path: Path) -> None:  # noqa: ANN401 - a function of any kind of step
    analysis = hrclog.analyze(write(tmp_path / "a.mcap", synced(every, clock, gap, tasks=8)))
    found = {finding.code: finding for finding in analysis.diagnostics if finding.code in RELIABLE}
    assert found.keys() <= {"log_times_untimely"}
    assert all("'human'" in finding.message and "--clock" not in finding.message for finding in found.values())


@pytest.mark.parametrize("every", [None, 30, 20])
def test_a_clock_that_is_ahead_is_found_though_events_waited(every: Any, tmp_path: Path) -> None:  # noqa: ANN401 - a function of any kind of step
    logs = read_logs(write(tmp_path / "a.mcap", synced(every, ahead(3600), tasks=8)))
    assert codes(logs) == ["clock_offset"]
    message = told(logs)[0].message
    assert "the clock of 'human' is off by at least +" in message
    least = parse_offset(message.split("--clock human=")[1].split()[0])
    assert 3580 * SECOND < least <= 3600 * SECOND


def test_a_clock_that_steps_beside_one_whose_events_wait_is_found(tmp_path: Path) -> None:
    events = synced(30, robot=jumps(-60, BEGIN + 40 * SECOND), tasks=8)
    assert "clock_jump" in codes(read_logs(write(tmp_path / "a.mcap", events)))


def test_times_that_do_not_move_give_no_offset(tmp_path: Path) -> None:
    for number, instant in enumerate((BEGIN, BEGIN - 3600 * SECOND, 10**9)):
        logs = logs_of(tmp_path, lambda _, instant=instant: instant, tasks=3 + number)
        assert set(codes(logs)) <= {"log_times_untimely"}


def test_clock_synced_corrects_a_clock_whose_events_waited(tmp_path: Path) -> None:
    events = with_sync(synced(30, ahead(3600)), BEGIN, BEGIN + 3600 * SECOND)
    assert "clock_corrected" in codes(read_logs(write(tmp_path / "a.mcap", events)))
    right_already = with_sync(synced(30), BEGIN, BEGIN + 3600 * SECOND)
    assert "clock_corrected" not in codes(read_logs(write(tmp_path / "b.mcap", right_already)))


def test_equal_times_as_of_simulations_and_imports_are_fine(tmp_path: Path) -> None:
    events = [Written(entry.event, entry.event.time_ns) for entry in run(ahead(3600))]
    assert read_logs(write(tmp_path / "a.mcap", events)).diagnostics == []


def with_sync(events: list[Written], at: int, agent_time: int) -> list[Written]:
    """Return the events with a `clock_synced` of the human; the others keep their numbers."""
    seq = len(events)
    sync = ClockSynced(time_ns=at, run_id="run", seq=seq, agent=HUMAN, agent_time_ns=agent_time)
    return [*events, Written(sync, at)]


@pytest.mark.parametrize("seconds", [-5.0, 90.0, 3600.0])
def test_clock_synced_corrects_times_that_carry_the_agents_clock(seconds: float, tmp_path: Path) -> None:
    events = with_sync(run(ahead(seconds), delays=delays(3)), BEGIN, ahead(seconds)(BEGIN))
    logs = read_logs(write(tmp_path / "a.mcap", events))
    (corrected,) = told(logs)
    assert (corrected.code, corrected.severity) == ("clock_corrected", "info")
    assert "clock_synced" in corrected.message
    expected = read_logs(write(tmp_path / "b.mcap", run(delays=delays(3)))).events
    tasks = pl.col("kind").str.starts_with("task_")
    assert logs.events.filter(tasks)["time_ns"].to_list() == expected.filter(tasks)["time_ns"].to_list()


@pytest.mark.parametrize("agent_time", [0, 5, BEGIN + 3600 * SECOND])
def test_times_that_are_right_stay_whatever_clock_synced_says(agent_time: int, tmp_path: Path) -> None:
    logs = read_logs(write(tmp_path / "a.mcap", with_sync(run(delays=delays(4)), BEGIN, agent_time)))
    assert codes(logs) == []


def test_what_the_caller_says_of_a_clock_comes_before_clock_synced(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", with_sync(run(ahead(3600)), BEGIN, ahead(3600)(BEGIN)))
    logs = read_logs(path, clocks={HUMAN: 3590 * SECOND})
    assert codes(logs) == ["clock_corrected", "clock_offset"]
    assert logs.events.filter(pl.col("kind") == "clock_synced")["time_ns"].to_list() == [BEGIN]


def test_an_agent_that_no_event_names_is_an_error_that_names_those_there_are(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", run())
    with pytest.raises(HrclogError, match=r"clock of 'humn': found no event.*expected one of 'human', 'robot'"):
        read_logs(path, clocks={"humn": 5})


def test_analyze_read_events_and_read_logs_take_clocks(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", run(ahead(3600)))
    clocks = {HUMAN: 3600 * SECOND}
    analysis = hrclog.analyze(path, clocks=clocks)
    plain = hrclog.analyze(write(tmp_path / "b.mcap", run(right)))
    assert analysis.overlaps.height == plain.overlaps.height > 0
    assert analysis.events["time_ns"].to_list() == read_events(path, clocks=clocks)["time_ns"].to_list()
    assert "clock_corrected" in analysis.to_json()
