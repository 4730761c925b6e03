"""Runs in which so many executions overlap that nothing can be told from it, and whose pairs would fill the memory.

An execution that overlaps m others is cut into up to 2 m pieces, each with up to m others: the cost of a run is the sum
of the squares of m.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import polars as pl

from hrclog.arrays import IntArray

_NEVER_CROWDED: Final = 100  # executions, even if all overlap each other
_LEAST: Final = _NEVER_CROWDED**3
_PER_EXECUTION: Final = 2000
"""An execution may overlap 44 others on average, and in small runs more."""

MOST_AGENTS: Final = 50
"""Agents of a run; pairs of agents grow with the square of them."""


def without_crowded(intervals: pl.DataFrame) -> pl.DataFrame:
    """Return intervals without those of crowded runs.

    Args:
        intervals: a frame of schema `INTERVALS`.
    """
    crowded = crowded_runs(intervals)
    return intervals.filter(~pl.col("run_id").is_in(list(crowded))) if crowded else intervals


def crowded_runs(intervals: pl.DataFrame) -> dict[str, str]:
    """Return the crowded runs, sorted, each with what there is too much of.

    Args:
        intervals: a frame of schema `INTERVALS`.
    """
    if intervals.height <= MOST_AGENTS:
        return {}
    sizes = intervals.group_by("run_id").agg(pl.len().alias("executions"), pl.col("agent").n_unique().alias("agents"))
    populous = sizes.filter(pl.col("agents") > MOST_AGENTS).select("run_id", "agents").iter_rows()
    crowded = {run: f"it has {agents:,} agents, expected at most {MOST_AGENTS}" for run, agents in populous}
    large = sizes.filter(pl.col("executions") > _NEVER_CROWDED)["run_id"]
    for run, n_pairs in _overlapping(intervals.filter(pl.col("run_id").is_in(large.implode()))).items():
        crowded.setdefault(run, f"{n_pairs:,} pairs of its executions overlap")
    return dict(sorted(crowded.items()))


def _overlapping(intervals: pl.DataFrame) -> dict[str, int]:
    """Return the runs in which too many executions overlap, and how many pairs of them do."""
    rows = intervals.sort("run_id")
    if rows.is_empty():
        return {}
    number = rows["run_id"].rle_id().to_numpy().astype(np.int64)
    met = _met(number, rows["start_ns"].to_numpy(), rows["until_ns"].to_numpy())
    costs = np.bincount(number, met.astype(np.float64) ** 2)
    n_executions, n_met = np.bincount(number), np.bincount(number, met)
    names = rows["run_id"].unique(maintain_order=True).to_list()
    is_crowded = costs > np.maximum(_LEAST, _PER_EXECUTION * n_executions)
    return {names[run]: int(n_met[run]) // 2 for run in np.flatnonzero(is_crowded).tolist()}


def _met(run: IntArray, start: IntArray, end: IntArray) -> IntArray:
    """Return how many executions of its run each execution overlaps, shape (n,).

    Those are the ones that begin before its end, but for itself and those that end by its start.
    """
    n = len(start)
    row = np.tile(np.arange(n), 2)
    is_start = np.repeat([True, False], n)
    order = np.lexsort((is_start, np.concatenate([start, end]), np.tile(run, 2)))
    sorted_starts = is_start[order]
    begun, over = np.cumsum(sorted_starts), np.cumsum(~sorted_starts)
    before = np.empty((2, n), np.int64)
    before[0, row[order][sorted_starts]] = over[sorted_starts]  # of all runs before too, in both counts
    before[1, row[order][~sorted_starts]] = begun[~sorted_starts]
    met: IntArray = np.maximum(before[1] - before[0] - 1, 0)
    return met
