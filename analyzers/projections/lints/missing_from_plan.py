"""Items of a plan that nobody did."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator
from typing import Final

import polars as pl

from hrclog.analyzers.projections.intervals import is_counted
from hrclog.analyzers.projections.lints.record import Record
from hrclog.analyzers.projections.lints.run_start import PlannedItem, RunStart
from hrclog.analyzers.projections.lints.told import listed
from hrclog.diagnostic import Diagnostic
from hrclog.events import Outcome, TaskEnded, TaskStarted
from hrclog.wording import agree, share

_SETTLES: Final = (TaskStarted.kind, TaskEnded.kind)


def missing_from_plan(record: Record) -> Iterator[Diagnostic]:
    """Find runs in which items of the plan neither started nor were given up, by their ids.

    Where executions tell no ids of the plan, agents and tasks are counted.
    """
    planned = {run: start for run, start in record.starts.items() if start.plan}
    if not planned:
        return
    settled = _settled_items(record.events)
    by_id = {run for run, start in planned.items() if not settled[run].isdisjoint(item.item_id for item in start.plan)}
    counts = _executions(record.intervals, planned.keys() - by_id)
    outcomes = dict(record.runs.select("run_id", "outcome").iter_rows())
    for run, start in sorted(planned.items()):
        if run in by_id:
            missing = [item for item in start.plan if item.item_id and item.item_id not in settled[run]]
        else:
            missing = _uncounted(start, counts[run])
        if missing:
            text = _text(record.names[run], start, missing, outcomes[run])
            yield Diagnostic("missing_from_plan", text, record.paths[run], run)


def _settled_items(events: pl.DataFrame) -> dict[str, set[str]]:
    rows = events.filter(pl.col("kind").is_in(_SETTLES) & (pl.col("item_id") != "")).select("run_id", "item_id")
    settled: dict[str, set[str]] = defaultdict(set)
    for run, item in rows.unique().iter_rows():
        settled[run].add(item)
    return settled


def _executions(intervals: pl.DataFrame, runs: Collection[str]) -> dict[str, Counter[tuple[str, str]]]:
    """Return by run how often each agent began each task, further attempts left out."""
    counts: dict[str, Counter[tuple[str, str]]] = defaultdict(Counter)
    if runs:
        is_first = is_counted() & (pl.col("attempt").fill_null(1) <= 1)
        rows = intervals.filter(is_first & pl.col("run_id").is_in(list(runs)))
        for run, agent, task, count in rows.group_by("run_id", "agent", "task").len().iter_rows():
            counts[run][agent, task] = count
    return counts


def _uncounted(start: RunStart, executions: Counter[tuple[str, str]]) -> list[PlannedItem]:
    """Return the last items of each agent and task that are more than its executions."""
    left = Counter(executions)
    missing: list[PlannedItem] = []
    for item in start.plan:
        key = (item.agent, item.task)
        if left[key]:
            left[key] -= 1
        else:
            missing.append(item)
    return missing


def _text(name: str, start: RunStart, missing: list[PlannedItem], outcome: str) -> str:
    end = {"": ", which has no run_ended", Outcome.SUCCEEDED.value: ""}.get(outcome, f", which ended as {outcome}")
    items, have = share(len(missing), len(start.plan), "item"), agree(len(missing), "has", "have")
    return f"{items} of the plan {have} no execution in run {name!r}{end}: {listed(list(_items(missing)))}"


def _items(missing: Iterable[PlannedItem]) -> Iterator[str]:
    for item in missing:
        yield f"{item.agent!r}, {item.task!r}" + (f" (item {item.item_id})" if item.item_id else "")
