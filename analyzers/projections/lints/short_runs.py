"""Runs with far fewer executions than their siblings."""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import polars as pl

from hrclog.analyzers.projections.intervals import is_counted
from hrclog.analyzers.projections.lints.record import Record
from hrclog.analyzers.projections.lints.told import listed
from hrclog.analyzers.projections.tags import tag_names
from hrclog.diagnostic import Diagnostic
from hrclog.wording import counted

AgentTask = tuple[str, str]

_FEWEST_SIBLINGS: Final = 2
_ALIKE: Final = 0.1
"""Siblings within this share of their median count are alike."""

_MOSTLY: Final = 0.75
"""Share of the siblings that must be alike; where runs differ anyway, none is short."""

_SHORT: Final = 0.8
"""A run with less than this share of the executions of its siblings is short."""

_SHORT_TASK: Final = 0.5
_FEWEST_PER_TASK: Final = 2
_DIGITS: Final = re.compile(r"\d+")


@dataclass(frozen=True, slots=True)
class _Run:
    run_id: str
    counts: Counter[AgentTask]
    tags: Mapping[str, str]


class _Level:
    """What is usual among the other runs of a group."""

    def __init__(self, counts: Iterable[int]) -> None:
        self._counts = sorted(counts)

    def usual(self, count: int) -> float | None:
        """Return the median of the counts but for one of them, None if they differ too much to say what is usual."""
        place = bisect_left(self._counts, count)
        others = len(self._counts) - 1
        middle = [(others - 1) // 2, others // 2]
        median = sum(self._counts[index + (index >= place)] for index in middle) / 2
        low, high = median * (1 - _ALIKE), median * (1 + _ALIKE)
        n_alike = bisect_right(self._counts, high) - bisect_left(self._counts, low) - (low <= count <= high)
        return median if n_alike >= _MOSTLY * others else None


def short_runs(record: Record) -> Iterator[Diagnostic]:
    """Find runs that have far fewer executions than their siblings, in all or of a task.

    Runs whose log tells what was planned are left to their plans.
    """
    if record.runs.height <= _FEWEST_SIBLINGS:
        return
    for runs in _siblings(record):
        short = _short(runs)
        for run in runs:
            if run.run_id in short and not _tag_explains(run, runs, short):
                text = f"run {record.names[run.run_id]!r} {short[run.run_id]}"
                yield Diagnostic("short_run", text, record.paths[run.run_id], run.run_id)


def _siblings(record: Record) -> Iterator[list[_Run]]:
    """Yield the runs of a plan's name or whose names differ in digits only; of the others, those of a set of agents."""
    counts = _counts(record.intervals)
    tags = tag_names(record.runs)
    by_name: dict[tuple[str, str], list[_Run]] = defaultdict(list)
    agents: dict[str, tuple[object, ...]] = {}
    for row in record.runs.iter_rows(named=True):
        start = record.starts.get(row["run_id"])
        if start and start.plan:
            continue
        run = _Run(row["run_id"], counts.get(row["run_id"], Counter()), {key: row[key] for key in tags if row[key]})
        plan = start.plan_name if start else ""
        by_name[plan, "" if plan else _DIGITS.sub("#", row["name"])].append(run)
        agents[run.run_id] = tuple(row["agents"] or ())
    by_agents: dict[tuple[object, ...], list[_Run]] = defaultdict(list)
    for runs in by_name.values():
        if len(runs) > _FEWEST_SIBLINGS:
            yield runs
            continue
        for run in runs:
            by_agents[agents[run.run_id]].append(run)
    yield from (runs for runs in by_agents.values() if len(runs) > _FEWEST_SIBLINGS)


def _counts(intervals: pl.DataFrame) -> dict[str, Counter[AgentTask]]:
    """Return by run how many pieces of work each agent did of each task; attempts at one item are one."""
    piece = pl.when(pl.col("item_id") != "").then("item_id").otherwise("execution_id")
    rows = intervals.filter(is_counted()).group_by("run_id", "agent", "task").agg(piece.n_unique().alias("n"))
    counts: dict[str, Counter[AgentTask]] = defaultdict(Counter)
    for run, agent, task, count in rows.iter_rows():
        counts[run][agent, task] = count
    return counts


def _short(runs: Sequence[_Run]) -> dict[str, str]:
    """Return by run how it is shorter than the others, of those that are."""
    total = _Level(run.counts.total() for run in runs)
    n_runs_of = Counter(task for run in runs for task in run.counts)
    tasks = sorted(task for task, n in n_runs_of.items() if 2 * n >= len(runs))  # of others the median is 0
    of_task = {task: _Level(run.counts[task] for run in runs) for task in tasks}
    short: dict[str, str] = {}
    for run in runs:
        count = run.counts.total()
        usual = total.usual(count)
        if usual is None:
            continue
        is_short = count < _SHORT * usual
        lacking = {
            task: usual_of_task
            for task in tasks
            if (usual_of_task := of_task[task].usual(run.counts[task])) is not None
            and _lacks(run.counts[task], usual_of_task, is_short=is_short)
        }
        if is_short or lacking:
            siblings = f"{counted(len(runs) - 1, 'run')} like it {usual:g} (median)"
            short[run.run_id] = _text(run, count, siblings, lacking)
    return short


def _lacks(count: int, usual: float, *, is_short: bool) -> bool:
    return count < usual if is_short else usual >= _FEWEST_PER_TASK and count <= _SHORT_TASK * usual


def _text(run: _Run, count: int, siblings: str, lacking: Mapping[AgentTask, float]) -> str:
    tasks = [f"{run.counts[task]} of {usual:g} of {task[0]!r}, {task[1]!r}" for task, usual in lacking.items()]
    return f"has {counted(count, 'execution')}, the {siblings}" + (f": {listed(tasks)}" if tasks else "")


def _tag_explains(run: _Run, runs: Sequence[_Run], short: Mapping[str, str]) -> bool:
    """Return whether most runs that share a tag with this one are short: a condition, not an accident."""
    for key, value in run.tags.items():
        mates = [mate for mate in runs if mate.run_id != run.run_id and mate.tags.get(key) == value]
        if mates and 2 * sum(mate.run_id in short for mate in mates) >= len(mates) and len(mates) + 1 < len(runs):
            return True
    return False
