"""What the other agents do while an execution runs, piece by piece: cut where anything of theirs starts or ends.

Within a segment the others' executions are the same, its *state*; the empty state is idle. Executions are half-open
intervals. Steps of sequences are no executions of their own; auxiliary ones (go home) count as something that the
other agent does.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import polars as pl

from hrclog.analyzers.projections.intervals import top_level
from hrclog.arrays import IntArray

AgentTask = tuple[str, str]
State = tuple[AgentTask, ...]
"""What the other agents are doing, sorted; twice the same where an agent overlaps itself."""

_BLOCK_SPAN_NS: Final = 2.0**62  # runs put after each other on one axis must stay within int64


@dataclass(frozen=True, slots=True)
class Segments:
    """Segments in order of (row, time); shapes (n,)."""

    row: IntArray  # number of the execution
    start_ns: IntArray  # since the execution's start
    end_ns: IntArray
    state: IntArray  # number of the state
    states: tuple[State, ...]  # sorted


@dataclass(frozen=True, slots=True)
class _Meetings:
    """Which other tasks an execution meets, and from and until when since its start; shapes (m,)."""

    row: IntArray
    column: IntArray
    low: IntArray
    high: IntArray


def segments(executions: pl.DataFrame, others: pl.DataFrame, until_ns: IntArray | None = None) -> Segments:
    """Cut executions into segments; an execution of no length has none.

    Args:
        executions: the rows of a frame of schema `INTERVALS` that are to be cut.
        others: all intervals of the same runs, in any order.
        until_ns: where each execution is cut off, shape (n,); where it ends when left out.
    """
    start = executions["start_ns"].to_numpy()
    end = executions["until_ns"].to_numpy() if until_ns is None else until_ns
    rows = others.filter(top_level())
    tasks = sorted(rows.select("agent", "task").unique().iter_rows())
    met = _join_meetings(list(_blocks(executions, start, end, rows, tasks)))

    row = np.arange(len(start))
    key = np.concatenate([row, row, met.row, met.row])
    time = np.concatenate([np.zeros_like(start), end - start, met.low, met.high])
    order = np.lexsort((time, key))
    first = np.ones(len(order), np.bool_)
    first[1:] = (np.diff(key[order]) != 0) | (np.diff(time[order]) != 0)
    boundary = np.empty(len(order), np.int64)
    boundary[order] = np.cumsum(first) - 1
    key, time = key[order][first], time[order][first]
    opens = np.flatnonzero(np.diff(key) == 0)  # a segment is named after the boundary that opens it
    begin, stop = np.split(boundary[2 * len(row) :], 2)
    state, states = _sorted_states(*_states(len(key), begin, stop, met.column, tasks), opens)
    return Segments(key[opens], time[opens], time[opens + 1], state, states)


def _blocks(
    executions: pl.DataFrame, start: IntArray, end: IntArray, rows: pl.DataFrame, tasks: list[AgentTask]
) -> Iterator[_Meetings]:
    """Yield the meetings of each pair of agents, for as many runs at a time as fit on one time axis."""
    numbered = executions.select("run_id", "agent", pl.Series("start", start), pl.Series("end", end)).with_row_index(
        "row"
    )
    spans = (
        pl.concat([rows.select("run_id", start="start_ns", end="until_ns"), numbered.select("run_id", "start", "end")])
        .group_by("run_id")
        .agg(pl.col("start").min().alias("origin"), pl.col("end").max().alias("last"))
        .sort("run_id")
        .with_columns((pl.col("last").cast(pl.Float64) - pl.col("origin") + 1).alias("span"))
        .with_columns((pl.col("span").cum_sum() / _BLOCK_SPAN_NS).floor().alias("block"))
        .with_columns(
            ((pl.col("last") - pl.col("origin") + 1).cum_sum().over("block").shift(1, fill_value=0).over("block"))
            .alias("offset")
        )
        .with_columns((pl.col("offset") - pl.col("origin")).alias("shift"))
        .select("run_id", "block", "shift")
    )  # fmt: skip
    columns = pl.DataFrame(
        [(*task, column) for column, task in enumerate(tasks)],
        schema={"agent": pl.String, "task": pl.String, "column": pl.Int64},
        orient="row",
    )
    shift = pl.col("shift")
    shifted = numbered.join(spans, on="run_id").with_columns(pl.col("start") + shift, pl.col("end") + shift)
    met = (
        rows.join(spans, on="run_id")
        .join(columns, on=["agent", "task"])
        .select("block", "agent", "column", start=pl.col("start_ns") + shift, end=pl.col("until_ns") + shift)
        .sort("block", "agent", "start", "end", "column")
    )
    of_others = dict(met.group_by("block", "agent", maintain_order=True))
    together = _together(rows, numbered)
    for (block, agent), part in shifted.group_by("block", "agent", maintain_order=True):
        for (other_block, other), other_part in of_others.items():
            if other_block == block and (agent, other) in together:
                yield _find_meetings(part, other_part)


def _together(rows: pl.DataFrame, executions: pl.DataFrame) -> set[tuple[Any, Any]]:
    """Return the ordered pairs of different agents that are in one run."""
    agents = executions.select("run_id", "agent").unique()
    others = rows.select("run_id", other="agent").unique()
    pairs = agents.join(others, on="run_id").select("agent", "other").unique()
    return set(pairs.filter(pl.col("agent") != pl.col("other")).iter_rows())


def _find_meetings(executions: pl.DataFrame, others: pl.DataFrame) -> _Meetings:
    start, end = executions["start"].to_numpy(), executions["end"].to_numpy()
    other_start, other_end = others["start"].to_numpy(), others["end"].to_numpy()
    first = np.searchsorted(np.maximum.accumulate(other_end), start, "right")
    count = np.maximum(np.searchsorted(other_start, end, "left") - first, 0)
    k = np.repeat(np.arange(len(start)), count)
    c = np.arange(len(k)) - np.repeat(np.cumsum(count) - count, count) + first[k]
    low, high = np.maximum(other_start[c], start[k]) - start[k], np.minimum(other_end[c], end[k]) - start[k]
    real = high > low
    k, c = k[real], c[real]
    return _Meetings(
        executions["row"].to_numpy().astype(np.int64)[k], others["column"].to_numpy()[c], low[real], high[real]
    )


def _join_meetings(parts: list[_Meetings]) -> _Meetings:
    none = np.empty(0, np.int64)
    return _Meetings(
        np.concatenate([none, *(part.row for part in parts)]),
        np.concatenate([none, *(part.column for part in parts)]),
        np.concatenate([none, *(part.low for part in parts)]),
        np.concatenate([none, *(part.high for part in parts)]),
    )


def _states(
    n: int, begin: IntArray, stop: IntArray, column: IntArray, tasks: list[AgentTask]
) -> tuple[IntArray, list[State]]:
    """Return the number of the state after each of n boundaries, and the states.

    The sum of random 64-bit numbers, one for each task in it, identifies a state, so a running sum finds all states.
    """
    codes = np.random.default_rng(0).integers(0, 2**64, len(tasks), np.uint64, endpoint=False)
    change = np.zeros(n + 1, np.uint64)
    np.add.at(change, begin, codes[column])
    np.subtract.at(change, stop, codes[column])
    _, example, state = np.unique(np.cumsum(change)[:n], return_index=True, return_inverse=True)
    # which of the boundaries that stand for a state lie in [begin, stop)
    order = np.argsort(example)
    first = np.searchsorted(example, begin, "left", sorter=order)
    count = np.searchsorted(example, stop, "left", sorter=order) - first
    pair_number = np.repeat(np.arange(len(begin)), count)
    place = np.arange(len(pair_number)) - np.repeat(np.cumsum(count) - count, count) + first[pair_number]
    members: list[list[AgentTask]] = [[] for _ in example]
    for number, task in zip(order[place].tolist(), column[pair_number].tolist(), strict=True):
        members[number].append(tasks[task])
    return state, [tuple(sorted(state_tasks)) for state_tasks in members]


def _sorted_states(state: IntArray, states: list[State], opens: IntArray) -> tuple[IntArray, tuple[State, ...]]:
    """Number the states that segments have in sorted order."""
    present, state = np.unique(state[opens], return_inverse=True)
    kept_states = [states[index] for index in present]
    ranked = sorted(range(len(kept_states)), key=kept_states.__getitem__)
    rank = np.empty(len(kept_states), np.int64)
    rank[ranked] = np.arange(len(kept_states))
    return rank[state], tuple(kept_states[index] for index in ranked)
