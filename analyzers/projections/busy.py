"""When an agent is busy: the union of its executions, per run."""

from __future__ import annotations

import numpy as np
import polars as pl

from hrclog.analyzers.projections.intervals import top_level
from hrclog.arrays import IntArray


class BusyTime:
    """The union of one agent's executions in one run, as disjoint sorted blocks.

    Args:
        start: ns, shape (n,), in any order.
        end: ns, shape (n,).
    """

    def __init__(self, start: IntArray, end: IntArray) -> None:
        order = np.lexsort((end, start))
        start, end = start[order], end[order]
        reach = np.maximum.accumulate(end) if len(end) else end
        opens = np.ones(len(start), np.bool_)
        opens[1:] = start[1:] > reach[:-1]
        self.start = start[opens]
        self.end = reach[np.append(np.flatnonzero(opens)[1:] - 1, len(reach) - 1)] if len(reach) else reach
        self._before = np.concatenate([[0], np.cumsum(self.end - self.start)])

    @property
    def total(self) -> int:
        """Return the busy time in ns."""
        return int(self._before[-1])

    def until(self, time_ns: IntArray) -> IntArray:
        """Return the busy time in ns before each instant, shape as given."""
        block = np.searchsorted(self.start, time_ns, "right")
        if not len(self.start):
            return np.zeros(np.shape(time_ns), np.int64)
        beyond = np.maximum(self.end[np.maximum(block - 1, 0)] - time_ns, 0) * (block > 0)
        before: IntArray = self._before[block] - beyond
        return before

    def within(self, start: IntArray, end: IntArray) -> IntArray:
        """Return the busy time in ns within each interval."""
        return self.until(end) - self.until(start)


def busy_times(intervals: pl.DataFrame) -> dict[str, dict[str, BusyTime]]:
    """Return run -> agent -> busy time, over all executions that are no step of another."""
    busy_of_run: dict[str, dict[str, BusyTime]] = {}
    for (run, agent), rows in intervals.filter(top_level()).group_by("run_id", "agent", maintain_order=True):
        busy = BusyTime(rows["start_ns"].to_numpy(), rows["until_ns"].to_numpy())
        busy_of_run.setdefault(str(run), {})[str(agent)] = busy
    return busy_of_run
