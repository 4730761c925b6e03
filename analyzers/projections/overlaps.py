"""Which executions overlapped, and for how long: a sweep over the sorted starts of each run.

Executions are half-open intervals, so touching ones do not overlap. Sorted by start, the executions that begin while
execution k runs are the rows right after k, up to one binary search; each pair is met once, at its earlier member.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
import polars as pl

from hrclog.analyzers.projections.crowded import without_crowded
from hrclog.analyzers.projections.frames import INTERVALS_FRAME, check_frame
from hrclog.analyzers.projections.intervals import SORT, is_counted
from hrclog.analyzers.projections.schemas import OVERLAPS, PAIR_OVERLAPS
from hrclog.arrays import IntArray

_BLOCK_ROWS: Final = 100_000  # keeps the arrays of a sweep in the processor's cache
_BLOCK_SPAN_NS: Final = 2.0**62  # runs put after each other must stay within int64

MOST_PAIRS: Final = 1_000_000
"""With more pairs of tasks than this, tables list the observed ones only."""

PAIR: Final = ("agent", "task", "other_agent", "other_task")

_SIDE: Final = ("execution_id", "agent", "task")


def overlaps(intervals: pl.DataFrame) -> pl.DataFrame:
    """Return the ordered pairs of executions of one run that overlap.

    o = max(0, min(e_k, e_c) - max(b_k, b_c)). Auxiliary executions, steps of sequences and crowded runs are left out;
    pairs of one agent with itself are included. An execution still open lasts until its `until_ns`.

    Args:
        intervals: a frame of schema `INTERVALS`.

    Returns:
        A frame of schema `OVERLAPS`, symmetric: (k, c) is there with (c, k).

    Raises:
        HrclogError: `intervals` is no intervals frame.
    """
    check_frame(intervals, INTERVALS_FRAME)
    rows = without_crowded(intervals).filter(is_counted()).sort(SORT)
    first, second, overlap = sweep(rows["run_id"], rows["start_ns"], rows["until_ns"])
    ahead, behind = np.concatenate([first, second]), np.concatenate([second, first])
    sides = rows.select("run_id", *_SIDE, (pl.col("until_ns") - pl.col("start_ns")).alias("duration_ns"))
    pairs = pl.concat(
        [
            sides[ahead],
            sides.select(pl.col(_SIDE).name.prefix("other_"))[behind],
            pl.DataFrame({"overlap_ns": np.concatenate([overlap, overlap])}),
        ],
        how="horizontal",
    ).with_columns((pl.col("overlap_ns") / pl.col("duration_ns")).alias("ratio"))
    order = np.lexsort((behind, ahead))
    return pairs[order].select(OVERLAPS.names()).cast(OVERLAPS)


def sweep(run: pl.Series, start: pl.Series, end: pl.Series) -> tuple[IntArray, IntArray, IntArray]:
    """Return row numbers and overlap in ns of all pairs that overlap, each once, the earlier row first.

    Args:
        run: run of each row, shape (n,); rows sorted by (run, start).
        start: int64 ns, shape (n,).
        end: int64 ns, shape (n,).
    """
    starts, ends = start.to_numpy(), end.to_numpy()
    blocks = [_sweep_block(starts, ends, bounds) for bounds in _blocks(run, starts, ends)]
    if not blocks:
        return (np.empty(0, np.int64),) * 3
    first, second, overlap = (np.concatenate(arrays) for arrays in zip(*blocks, strict=True))
    return first, second, overlap


def pair_overlaps(intervals: pl.DataFrame, overlaps: pl.DataFrame) -> pl.DataFrame:
    """Sum overlaps per ordered pair of tasks of different agents; the entries of the overlap matrices.

    Args:
        intervals: a frame of schema `INTERVALS`.
        overlaps: its overlaps.

    Returns:
        A frame of schema `PAIR_OVERLAPS`: every ordered pair of tasks is a row, zeros included.
    """
    tasks = task_counts(intervals)
    sums = (
        overlaps.filter(pl.col("agent") != pl.col("other_agent"))
        .group_by(PAIR)
        # sorted, the sum does not depend on the order of the rows, nor on who is called what
        .agg(pl.col("overlap_ns").sum(), pl.len().alias("n"), pl.col("ratio").sort().sum())
    )
    pairs = task_pairs(tasks, sums).join(sums, on=PAIR, how="left")
    return pairs.select(
        "agent",
        "task",
        "other_agent",
        "other_task",
        (pl.col("overlap_ns").fill_null(0) / 1e9).alias("overlap_s"),
        pl.col("n").fill_null(0),
        (pl.col("ratio").fill_null(0.0) / pl.col("executions")).alias("mean_ratio"),
    ).cast(PAIR_OVERLAPS)


def task_counts(intervals: pl.DataFrame) -> pl.DataFrame:
    """Return agent, task and number of executions that count, sorted."""
    return (
        intervals.filter(is_counted()).group_by("agent", "task").agg(pl.len().alias("executions")).sort("agent", "task")
    )


def task_pairs(tasks: pl.DataFrame, observed: pl.DataFrame) -> pl.DataFrame:
    """Return every ordered pair of tasks of different agents, sorted; only the observed ones where there are too many.

    Args:
        tasks: what `task_counts` returned.
        observed: a frame with the columns `PAIR`.
    """
    if pair_count(tasks) > MOST_PAIRS:
        pairs = observed.select(PAIR).join(tasks, on=["agent", "task"])
    else:
        others = tasks.select(pl.col("agent", "task").name.prefix("other_"))
        pairs = tasks.join(others, how="cross").filter(pl.col("agent") != pl.col("other_agent"))
    return pairs.sort(PAIR)


def pair_count(tasks: pl.DataFrame) -> int:
    """Return how many ordered pairs of tasks of different agents there are."""
    per_agent = tasks.group_by("agent").len()["len"].cast(pl.Int64)
    return int(per_agent.sum()) ** 2 - int((per_agent**2).sum())


def _blocks(run: pl.Series, start: IntArray, end: IntArray) -> Iterator[tuple[int, int, IntArray]]:
    """Yield (first row, one past the last row, number of the run within the block of each row), cut between runs."""
    if run.is_empty():
        return
    lengths = run.rle().struct.field("len").to_numpy().astype(np.int64)
    rows = np.concatenate([[0], np.cumsum(lengths)])
    # as floats, because a few runs with clocks gone wrong are longer than int64 holds
    spans = np.maximum.reduceat(end.astype(np.float64), rows[:-1]) - start[rows[:-1]]
    span = np.concatenate([[0.0], np.cumsum(spans + 1)])
    begin = 0
    while begin < len(lengths):
        fits = min(
            np.searchsorted(rows, rows[begin] + _BLOCK_ROWS, "right"),
            np.searchsorted(span, span[begin] + _BLOCK_SPAN_NS, "right"),
        )
        stop = max(begin + 1, int(fits) - 1)
        yield int(rows[begin]), int(rows[stop]), np.repeat(np.arange(stop - begin), lengths[begin:stop])
        begin = stop


def _sweep_block(
    starts: IntArray, ends: IntArray, bounds: tuple[int, int, IntArray]
) -> tuple[IntArray, IntArray, IntArray]:
    low, high, run = bounds
    start, end = _apart(starts[low:high], ends[low:high], run)
    row = np.arange(len(start))
    partners = np.maximum(np.searchsorted(start, end, "left") - row - 1, 0)
    first = np.repeat(row, partners)
    second = np.arange(len(first)) - np.repeat(np.cumsum(partners) - partners, partners) + first + 1
    overlap = np.minimum(end[first], end[second]) - start[second]
    real = overlap > 0
    return first[real] + low, second[real] + low, overlap[real]


def _apart(start: IntArray, end: IntArray, run: IntArray) -> tuple[IntArray, IntArray]:
    """Shift the runs of a block so that they follow each other on one axis."""
    if not run[-1]:
        return start, end
    first_row = np.searchsorted(run, np.arange(run[-1] + 1))
    origin = start[first_row]
    length = np.maximum.reduceat(end, first_row) - origin + 1
    shift = np.cumsum(length) - length - origin
    return start + shift[run], end + shift[run]
