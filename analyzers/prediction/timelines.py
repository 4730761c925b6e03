"""The other agents' timelines from the start of an execution on, and how long work takes along them.

W(D), the work done after D seconds, is piecewise linear: within a segment its slope is the product of 1 / s over what
the others do. Beyond the last segment the others are taken to idle.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from hrclog.analyzers.projections.joint_states import AgentTask, Segments, segments
from hrclog.arrays import FloatArray, IntArray

# a forecast may not know how long its execution took: only very long runs are not looked through to their end
_VERY_LONG: Final = 100  # intervals
_HORIZON: Final = 10  # times the longest of them; what happens later makes no difference
_FOREVER: Final = 2**63 - 1


@dataclass(frozen=True, slots=True)
class Timeline:
    """From one execution's start on: work done at some instants, and the log factor in between.

    Attributes:
        time_s: shape (m + 1,), the first is 0.
        work_s: done by then, shape (m + 1,).
        log_factor: of each segment, shape (m,); 0 beyond.
    """

    time_s: FloatArray
    work_s: FloatArray
    log_factor: FloatArray

    def work_after(self, duration_s: float) -> float:
        """Return the work in seconds that is done after a duration."""
        beyond = max(duration_s - float(self.time_s[-1]), 0.0)
        return float(np.interp(duration_s, self.time_s, self.work_s)) + beyond

    def time_for(self, work_s: FloatArray) -> FloatArray:
        """Return the durations in seconds after which some work is done, shape as given."""
        durations: FloatArray = np.interp(work_s, self.work_s, self.time_s) + np.maximum(work_s - self.work_s[-1], 0.0)
        return durations

    def log_factor_before(self, duration_s: float) -> float:
        """Return the log factor just before an instant."""
        index = int(np.searchsorted(self.time_s, duration_s, "left")) - 1
        return float(self.log_factor[index]) if index < len(self.log_factor) else 0.0


class Timelines:
    """The timelines of many executions.

    Args:
        executions: the rows of a frame of schema `INTERVALS` that are to be predicted; only their starts are used.
        intervals: all intervals of the same runs.
    """

    def __init__(self, executions: pl.DataFrame, intervals: pl.DataFrame) -> None:
        self._cut = _segments_ahead(executions, intervals)
        self._first = np.searchsorted(self._cut.row, np.arange(executions.height + 1))

    def along(self, row: int, log_factors: Mapping[AgentTask, float]) -> Timeline:
        """Return the timeline of one execution under given log factors."""
        low, high = self._first[row], self._first[row + 1]
        state = self._cut.state[low:high]
        factor_of = {int(s): sum(log_factors.get(key, 0.0) for key in self._cut.states[s]) for s in np.unique(state)}
        factor = np.array([factor_of[int(s)] for s in state], np.float64)
        time = np.concatenate([[0.0], self._cut.end_ns[low:high] / 1e9])
        work = np.concatenate([[0.0], np.cumsum(np.diff(time) * np.exp(-factor))])
        return Timeline(time, work, factor)


def _segments_ahead(executions: pl.DataFrame, intervals: pl.DataFrame) -> Segments:
    start: IntArray = executions["start_ns"].to_numpy()
    longest = (pl.col("until_ns") - pl.col("start_ns")).max().clip(upper_bound=_FOREVER // _HORIZON)
    runs = intervals.group_by("run_id").agg(
        pl.col("until_ns").max().alias("last_ns"),
        pl.when(pl.len() > _VERY_LONG).then(_HORIZON * longest).otherwise(_FOREVER).alias("reach_ns"),
    )
    run_ends = executions.select("run_id").join(runs, on="run_id", how="left", maintain_order="left")
    ahead = np.minimum(run_ends["last_ns"].to_numpy() - start, run_ends["reach_ns"].to_numpy())
    return segments(executions, intervals, start + ahead)
