"""The longest chain of executions of a run, and how much each of the others could slip (critical path method, CPM).

The realised precedence graph has an edge from execution k to execution c where k ended before c started and either one
agent did both or the plan declares that k's item comes before c's. A declared precedence that the run broke is no edge.
Kelley, Walker, Critical-Path Planning and Scheduling (1959).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable
from typing import Final

import numpy as np
import polars as pl

from hrclog.analyzers.projections.intervals import SORT, top_level
from hrclog.analyzers.projections.schemas import CRITICAL_PATH
from hrclog.arrays import IntArray

Precedence = tuple[str, str]
"""(item_id, item_id): the first must end before the second starts."""

_KEPT: Final = ("run_id", "agent", "task", "execution_id", "item_id")


def critical_path(intervals: pl.DataFrame, precedences: Iterable[Precedence] = ()) -> pl.DataFrame:
    """Return earliest and latest instants and the slack of each execution.

    Args:
        intervals: a frame of schema `INTERVALS`; an execution still open lasts until its `until_ns`.
        precedences: declared between plan items.

    Returns:
        A frame of schema `CRITICAL_PATH`.
    """
    before: dict[str, list[str]] = {}
    after: dict[str, list[str]] = {}
    for first, second in sorted(set(precedences)):
        before.setdefault(second, []).append(first)
        after.setdefault(first, []).append(second)
    rows = intervals.filter(top_level()).sort(SORT)
    parts = [_schedule_run(part, before, after) for _, part in rows.group_by("run_id", maintain_order=True)]
    return pl.concat([pl.DataFrame(schema=CRITICAL_PATH), *parts])


def critical_path_lengths(schedule: pl.DataFrame) -> dict[str, int]:
    """Return the length in ns of each run's longest chain.

    Args:
        schedule: what `critical_path` returned.
    """
    return dict(schedule.group_by("run_id").agg(pl.col("earliest_end_ns").max()).iter_rows())


def _schedule_run(part: pl.DataFrame, before: dict[str, list[str]], after: dict[str, list[str]]) -> pl.DataFrame:
    """Lay out one run's rows; they come sorted, and time 0 is the first start."""
    start, end = part["start_ns"].to_numpy(), part["until_ns"].to_numpy()
    agents, items = part["agent"].to_list(), part["item_id"].to_list()
    length = end - start
    head = longest_before(start, end, agents, items, before)
    # what comes after is what comes before, when time runs backwards
    back = np.lexsort((-np.arange(len(start)), -start, -end))
    tail = np.empty_like(head)
    tail[back] = longest_before(
        -end[back], -start[back], [agents[row] for row in back], [items[row] for row in back], after
    )
    slack = int((head + length).max()) - head - length - tail
    times = {
        "earliest_start_ns": head,
        "earliest_end_ns": head + length,
        "latest_start_ns": head + slack,
        "latest_end_ns": head + slack + length,
        "slack_ns": slack,
        "critical": slack == 0,
    }
    return (
        part.select(_KEPT).with_columns(pl.Series(name, values) for name, values in times.items()).cast(CRITICAL_PATH)
    )


def longest_before(
    start: IntArray, end: IntArray, agents: list[str], items: list[str], before: dict[str, list[str]]
) -> IntArray:
    """Return the length of the longest chain that ends before each execution, shape (n,).

    Args:
        start: shape (n,), in an order in which no execution comes before one that ends where it starts.
        end: shape (n,).
        agents: who did it, shape (n,).
        items: plan item of each execution, "" without one, shape (n,).
        before: item -> the items that must come before it.
    """
    chains: dict[tuple[str, str], _Chains] = {}
    head = np.zeros(len(start), np.int64)
    rows = zip(start.tolist(), end.tolist(), agents, items, strict=True)
    for row, (begins, ends, agent, item) in enumerate(rows):
        sources = [("agent", agent), *(("item", earlier) for earlier in before.get(item, ()))]
        longest = max(chains[source].until(begins) if source in chains else 0 for source in sources)
        head[row] = longest
        chains.setdefault(("agent", agent), _Chains()).add(ends, longest + ends - begins)
        if item:
            chains.setdefault(("item", item), _Chains()).add(ends, longest + ends - begins)
    return head


class _Chains:
    """The longest chain that has ended by an instant; chains no longer than an earlier one are forgotten."""

    def __init__(self) -> None:
        self._ends: list[int] = []
        self._lengths: list[int] = []

    def until(self, time_ns: int) -> int:
        """Return the length of the longest chain that ended at or before an instant, 0 without one."""
        index = bisect_right(self._ends, time_ns)
        return self._lengths[index - 1] if index else 0

    def add(self, end_ns: int, length: int) -> None:
        """Take a chain in."""
        index = bisect_right(self._ends, end_ns)
        if index and self._lengths[index - 1] >= length:
            return
        beaten = index
        while beaten < len(self._lengths) and self._lengths[beaten] <= length:
            beaten += 1
        if index and self._ends[index - 1] == end_ns:
            index -= 1
        self._ends[index:beaten] = [end_ns]
        self._lengths[index:beaten] = [length]
