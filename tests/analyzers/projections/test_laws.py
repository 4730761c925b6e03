"""What may change in an analysis when its input is told in another way: only what must."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from interval_frames import random_runs
from polars.testing import assert_frame_equal

from hrclog.analyzers.analysis import analyze, analyze_logs
from hrclog.analyzers.result import Analysis
from hrclog.errors import HrclogError
from hrclog.events import Event, RunEnded, RunStarted, SafetyStateChanged, TaskEnded, TaskStarted
from hrclog.log.messages.message import EVENTS
from hrclog.log.reader import read_logs
from hrclog.log.writing.writer import write_log

Runs = dict[str, list[Event]]

TABLES = ("durations", "synergies", "pair_overlaps")
PER_RUN = ("intervals", "overlaps", "metrics", "runs")


def campaign(seed: int = 1, n_runs: int = 6, agents: str = "HR", **others: object) -> Runs:
    """Return the events of some runs, made once."""
    runs: Runs = {}
    for one in random_runs(seed, n_runs=n_runs, agents=agents, tasks=3, **others):
        identity = {name: one[name] for name in ("run_id", "agent", "task", "execution_id")}
        start = TaskStarted(time_ns=one["start_ns"], planned_start_ns=one["start_ns"] - 7, **identity)
        end = TaskEnded(time_ns=one["end_ns"], outcome=one["outcome"], **identity)
        runs.setdefault(one["run_id"], []).extend((start, end))
    for run, events in runs.items():
        slow = SafetyStateChanged(time_ns=5_000_000_000, run_id=run, agent="R", speed_scale=0.05)
        events.append(slow)
        events.sort(key=lambda event: event.time_ns)
        events.insert(0, RunStarted(time_ns=events[0].time_ns, run_id=run, name=f"name of {run}", agents=tuple(agents)))
        events.append(RunEnded(time_ns=events[-1].time_ns, run_id=run))
    return runs


def analysed(runs: Runs, folder: Path, estimator: str = "ols") -> Analysis:
    folder.mkdir()
    for run, events in runs.items():
        write_log(folder / f"{run}.mcap", events)
    return analyze(folder, estimator)


def changed(runs: Runs, change: Callable[[Event], Event]) -> Runs:
    return {run: [change(event) for event in events] for run, events in runs.items()}


def same(first: Analysis, second: Analysis, names: tuple[str, ...], *without: str, exact: bool = True) -> None:
    for name in names:
        one, other = (getattr(analysis, name).drop(without, strict=False) for analysis in (first, second))
        assert_frame_equal(one, other, check_exact=exact, rel_tol=1e-9)


both = pytest.mark.parametrize("estimator", ["ols", "paper"])


@both
def test_the_order_of_the_events_changes_nothing(estimator: str, tmp_path: Path) -> None:
    first = analysed(campaign(), tmp_path / "a", estimator)
    logs = read_logs([tmp_path / "a"], signals=True)
    order = np.random.default_rng(0).permutation(logs.events.height)
    second = analyze_logs(replace(logs, events=logs.events[order]), estimator)
    same(first, second, TABLES + PER_RUN)
    assert first.diagnostics == second.diagnostics


@both
@pytest.mark.parametrize("shift", [3_000_000_000, 1_700_000_000_123_456_789])
def test_shifting_all_times_shifts_the_instants_and_nothing_else(estimator: str, shift: int, tmp_path: Path) -> None:
    def later(event: Event) -> Event:
        moved = replace(event, time_ns=event.time_ns + shift)
        return (
            replace(moved, planned_start_ns=event.planned_start_ns + shift) if isinstance(moved, TaskStarted) else moved
        )

    first = analysed(campaign(), tmp_path / "a", estimator)
    second = analysed(changed(campaign(), later), tmp_path / "b", estimator)
    same(first, second, (*TABLES, "overlaps", "metrics"))
    instants = ("start_ns", "end_ns", "until_ns", "planned_start_ns")
    same(first, second, ("intervals", "runs"), *instants, "path")
    assert (second.intervals["start_ns"] - first.intervals["start_ns"]).unique().to_list() == [shift]


@both
def test_new_ids_change_only_themselves(estimator: str, tmp_path: Path) -> None:
    # in reverse, so that everything that is sorted by id is sorted the other way round
    runs = campaign()
    ids = sorted({event.execution_id for events in runs.values() for event in events if isinstance(event, TaskStarted)})
    new = dict(zip(ids, reversed([f"id{number:05}" for number in range(len(ids))]), strict=True))

    def renamed(event: Event) -> Event:
        other = replace(event, run_id=f"new{99 - int(event.run_id[3:]):03}")
        return (
            replace(other, execution_id=new[event.execution_id])
            if isinstance(other, TaskStarted | TaskEnded)
            else other
        )

    first = analysed(runs, tmp_path / "a", estimator)
    second = analysed(changed(runs, renamed), tmp_path / "b", estimator)
    same(first, second, ("durations", "pair_overlaps"))
    same(first, second, ("synergies",), exact=False)
    assert sorted(first.metrics["value"]) == sorted(second.metrics["value"])


@both
def test_renaming_agents_and_tasks_renames_the_rows(estimator: str, tmp_path: Path) -> None:
    # the names swap places in every sort: H <-> R, and the tasks are counted backwards
    agents = {"H": "R", "R": "H"}

    def name_of(task: str) -> str:
        return f"ü/{9 - int(task[1:])}-{task[0]}"

    def renamed(event: Event) -> Event:
        if isinstance(event, TaskStarted | TaskEnded):
            return replace(event, agent=agents[event.agent], task=name_of(event.task))
        return replace(event, agent=agents[event.agent]) if isinstance(event, SafetyStateChanged) else event

    first = analysed(campaign(), tmp_path / "a", estimator)
    second = analysed(changed(campaign(), renamed), tmp_path / "b", estimator)
    for table in TABLES:
        one, other = getattr(first, table), getattr(second, table)
        keys = [name for name in ("agent", "task", "other_agent", "other_task") if name in one.columns]
        for name in keys:
            change = agents.get if "agent" in name else name_of
            one = one.with_columns(pl.col(name).map_elements(change, pl.String))
        assert_frame_equal(one.sort(keys), other.sort(keys), rel_tol=1e-9)
    assert sorted(first.metrics["value"]) == pytest.approx(sorted(second.metrics["value"]), rel=1e-9)


def test_swapping_the_agents_of_a_pair_transposes_the_overlap_matrix(tmp_path: Path) -> None:
    table = analysed(campaign(), tmp_path / "a").pair_overlaps
    turned = table.rename({"agent": "other_agent", "task": "other_task", "other_agent": "agent", "other_task": "task"})
    keys = ["agent", "task", "other_agent", "other_task"]
    assert_frame_equal(
        table.select(*keys, "overlap_s", "n"), turned.select(*keys, "overlap_s", "n").sort(keys), check_exact=True
    )


@both
def test_splitting_runs_into_segments_changes_nothing_but_the_paths(estimator: str, tmp_path: Path) -> None:
    runs = campaign()
    first = analysed(runs, tmp_path / "a", estimator)
    events = first.events
    folder = tmp_path / "b"
    folder.mkdir()
    for run in runs:
        rows = events.filter(pl.col("run_id") == run).sort("seq")
        for part, (low, high) in enumerate(((0, 3), (3, 12), (12, 1000))):
            write_segment(folder / f"{run}_{part}.mcap", rows[low:high])
    second = analyze(folder, estimator)
    assert second.events.height == events.height
    same(first, second, TABLES + PER_RUN, "path")


def write_segment(path: Path, rows: pl.DataFrame) -> None:
    """Write events as they are, with the numbers that they have."""
    from hrclog.event_rows import from_row
    from hrclog.log.messages.encode import event_message
    from hrclog.log.writing.writer import write_atomically

    events = [from_row(row) for row in rows.iter_rows(named=True)]
    write_atomically(path, lambda writer: [writer.add(event_message(event, event.time_ns)) for event in events])


@both
def test_a_run_without_overlap_changes_no_synergy_that_its_durations_do_not(estimator: str, tmp_path: Path) -> None:
    runs = campaign()
    first = analysed(runs, tmp_path / "a", estimator)
    # one more run, in which the agents take turns, with exactly the mean durations of its tasks
    turns: list[Event] = []
    now = 0
    for number, (agent, task, mean) in enumerate(first.durations.select("agent", "task", "mean_s").iter_rows()):
        identity = {"run_id": "zz", "agent": agent, "task": task, "execution_id": f"zz{number}"}
        end = now + round(mean * 1e9)
        turns += [TaskStarted(time_ns=now, **identity), TaskEnded(time_ns=end, **identity)]
        now = end
    second = analysed(runs | {"zz": turns}, tmp_path / "b", estimator)
    same(first, second, ("synergies",), exact=False)
    same(first, second, ("pair_overlaps",), "mean_ratio")
    same(first, second, ("overlaps",))
    assert (second.pair_overlaps["mean_ratio"] <= first.pair_overlaps["mean_ratio"]).all()
    assert (second.durations["count"] - first.durations["count"]).to_list() == [1] * first.durations.height
    without = second.metrics.filter(pl.col("run_id") != "zz")
    assert_frame_equal(without, first.metrics, check_exact=True)


def test_a_file_given_twice_counts_once_and_says_so(tmp_path: Path) -> None:
    first = analysed(campaign(), tmp_path / "a")
    (tmp_path / "b").mkdir()
    for path in (tmp_path / "a").iterdir():
        (tmp_path / "b" / path.name).write_bytes(path.read_bytes())
    second = analyze([tmp_path / "a", tmp_path / "b", tmp_path / "a" / "run000.mcap"], "ols")
    same(first, second, TABLES + PER_RUN)
    told = {one.code for one in second.diagnostics} - {one.code for one in first.diagnostics}
    assert told == {"duplicate_events"}


def test_what_one_run_says_of_itself_does_not_depend_on_the_others(tmp_path: Path) -> None:
    runs = campaign(agents="HRS", overlap_itself="S")
    whole = analysed(runs, tmp_path / "a")
    alone = analysed({"run003": runs["run003"]}, tmp_path / "b")
    for name in PER_RUN:
        part, other = (getattr(one, name).filter(pl.col("run_id") == "run003") for one in (whole, alone))
        # polars divides a long column by a constant through its reciprocal: the last digit may differ
        assert_frame_equal(part.drop("path", strict=False), other.drop("path", strict=False), rel_tol=1e-15, abs_tol=0)


def test_an_estimator_that_is_not_known_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(HrclogError, match="ols, paper"):
        analyze(tmp_path, "magic")


def test_the_events_of_an_analysis_are_all_that_was_written(tmp_path: Path) -> None:
    runs = campaign()
    found = analysed(runs, tmp_path / "a").events
    assert found.schema == EVENTS
    assert found.height == sum(map(len, runs.values()))
