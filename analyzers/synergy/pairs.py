"""The pairs of successful executions that overlapped, and the table that every estimator fills for pairs of tasks."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

import polars as pl

from hrclog.analyzers.projections.intervals import is_counted
from hrclog.analyzers.projections.overlaps import PAIR, overlaps, task_pairs
from hrclog.analyzers.projections.schemas import OVERLAPS, SYNERGIES
from hrclog.events import Outcome

SPARSE_BELOW: Final = 5
OK, SPARSE, WEAKLY_IDENTIFIED, UNOBSERVED = "ok", "sparse", "weakly_identified", "unobserved"

_NUMBERS: Final = ("synergy", "std_err", "ci_low", "ci_high")
_FREE_NUMBERS: Final = ("synergy_free", "free_std_err", "free_ci_low", "free_ci_high")
_COEFFICIENTS: Final = pl.Schema(
    dict.fromkeys(PAIR, pl.String())
    | dict.fromkeys((*_NUMBERS, *_FREE_NUMBERS), pl.Float64())
    | {"identified": pl.Boolean()}
)


def successful(intervals: pl.DataFrame) -> pl.DataFrame:
    """Return the executions whose durations mean something: succeeded, closed, longer than nothing, and counted."""
    return intervals.filter(
        is_counted() & (pl.col("outcome") == Outcome.SUCCEEDED.value) & (pl.col("end_ns") > pl.col("start_ns"))
    )


def in_seconds(ns: pl.Expr) -> pl.Expr:
    """Return nanoseconds in seconds, rounded once: polars multiplies columns of two rows or more by 1 / 1e9."""
    return ns.map_batches(lambda values: pl.Series(values.to_numpy() / 1e9), return_dtype=pl.Float64)


def overlapping_pairs(executions: pl.DataFrame) -> pl.DataFrame:
    """Return the ordered pairs of successful executions of different agents that overlap.

    Args:
        executions: what `successful` returned.

    Returns:
        The columns of `OVERLAPS` with `duration_s`, `other_duration_s`, `overlap_s` and `met_s`: the time within the
        execution in which the other agent was busy, the same in all pairs with that agent.
    """
    length = in_seconds(pl.col("end_ns") - pl.col("start_ns")).alias("duration_s")
    sides = executions.select("run_id", "execution_id", "start_ns", "end_ns", length)
    others = sides.rename({name: f"other_{name}" for name in sides.columns if name != "run_id"})
    low = pl.max_horizontal("start_ns", "other_start_ns")
    high = pl.min_horizontal("end_ns", "other_end_ns")
    # of what an execution meets of one agent, sorted: what reaches beyond all before it
    further = (pl.col("high") - pl.max_horizontal("low", pl.col("high").cum_max().shift(1))).clip(0)
    return (
        overlaps(executions)
        .filter(pl.col("agent") != pl.col("other_agent"))
        .join(sides, on=["run_id", "execution_id"], maintain_order="left")
        .join(others, on=["run_id", "other_execution_id"], maintain_order="left")
        .with_columns(in_seconds(pl.col("overlap_ns")).alias("overlap_s"), low.alias("low"), high.alias("high"))
        .sort("run_id", "execution_id", "other_agent", "low", "other_execution_id")
        .with_columns(in_seconds(further.sum().over("run_id", "execution_id", "other_agent")).alias("met_s"))
        .select(*OVERLAPS.names(), "duration_s", "other_duration_s", "overlap_s", "met_s")
    )


def synergy_table(
    executions: pl.DataFrame, pairs: pl.DataFrame, rows: Iterable[tuple[Any, ...]], estimator: str
) -> pl.DataFrame:
    """Lay out an estimator's coefficients with one row per ordered pair of tasks of different agents.

    Args:
        executions: all that count, with agent and task; they say which tasks there are.
        pairs: what `overlapping_pairs` returned.
        rows: tuples of agent, task, other agent, other task; synergy, standard error and both ends of its interval;
            the same of the free synergy; and whether all that was asked is identified. Numbers that are not are NaN.
        estimator: its name.

    Returns:
        A frame of schema `SYNERGIES`; pairs that never overlapped carry nulls and the status unobserved.
    """
    coefficients = pl.DataFrame(list(rows), schema=_COEFFICIENTS, orient="row").fill_nan(None)
    tasks = executions.group_by("agent", "task").agg(pl.len().alias("executions")).sort("agent", "task")
    seen = pairs.group_by(PAIR).agg(pl.len().alias("n"), pl.col("overlap_s").sort().sum())
    table = (
        task_pairs(tasks, seen)
        .join(seen, on=PAIR, how="left")
        .join(coefficients, on=PAIR, how="left")
        .with_columns(pl.col("n").fill_null(0), pl.col("overlap_s").fill_null(0.0))
    )
    unobserved = (pl.col("n") == 0) | pl.col("identified").is_null()
    status = (
        pl.when(unobserved)
        .then(pl.lit(UNOBSERVED))
        .when(~pl.col("identified"))
        .then(pl.lit(WEAKLY_IDENTIFIED))
        .when(pl.col("n") < SPARSE_BELOW)
        .then(pl.lit(SPARSE))
        .otherwise(pl.lit(OK))
    )
    table = table.with_columns(
        status.alias("status"),
        pl.lit(estimator).alias("estimator"),
        *(pl.when(~unobserved).then(name).alias(name) for name in (*_NUMBERS, *_FREE_NUMBERS)),
    )
    return table.select(SYNERGIES.names()).cast(SYNERGIES).sort(PAIR)
