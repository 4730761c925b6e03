"""The pairs of executions that overlapped, and the table that every estimator fills for pairs of tasks."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

import polars as pl

from hrclog.analyzers.projections.intervals import is_counted, is_learnt, is_success
from hrclog.analyzers.projections.overlaps import PAIR, overlaps, task_pairs
from hrclog.analyzers.projections.schemas import OVERLAPS, SYNERGIES

SPARSE_BELOW: Final = 5
"""Pairs of executions of which the first succeeded."""

OK, SPARSE, WEAKLY_IDENTIFIED = "ok", "sparse", "weakly_identified"
NO_SUCCESS, UNOBSERVED = "no_success", "unobserved"


_NUMBERS: Final = ("synergy", "std_err", "ci_low", "ci_high")
_MORE: Final = ("from_ns", "duration_s", "other_duration_s", "overlap_s", "finished", "other_finished")
_FREE_NUMBERS: Final = ("synergy_free", "free_std_err", "free_ci_low", "free_ci_high")
_COEFFICIENTS: Final = pl.Schema(
    dict.fromkeys(PAIR, pl.String())
    | dict.fromkeys((*_NUMBERS, *_FREE_NUMBERS), pl.Float64())
    | {"identified": pl.Boolean()}
)


def successful(intervals: pl.DataFrame) -> pl.DataFrame:
    """Return the executions whose durations mean something: succeeded, closed, longer than nothing, and counted."""
    return intervals.filter(is_learnt() & is_finished() & (pl.col("end_ns") > pl.col("start_ns")))


def is_finished() -> pl.Expr:
    """Return which intervals ended in success, so that they lasted as long as their task takes."""
    return is_success()


def in_seconds(ns: pl.Expr) -> pl.Expr:
    """Return nanoseconds in seconds, rounded once: polars multiplies columns of two rows or more by 1 / 1e9."""
    return ns.map_batches(lambda values: pl.Series(values.to_numpy() / 1e9), return_dtype=pl.Float64)


def overlapping_pairs(intervals: pl.DataFrame) -> pl.DataFrame:
    """Return the ordered pairs of executions of different agents that overlap, whatever came of them.

    The first is one that estimators learn from, the other any that counts.

    Args:
        intervals: a frame of schema `INTERVALS`.

    Returns:
        The columns of `OVERLAPS` with `from_ns`, where the overlap begins, since the execution's start; `duration_s`,
        `other_duration_s` and `overlap_s`; and `finished` and `other_finished`, whether they succeeded.
    """
    length = in_seconds(pl.col("until_ns") - pl.col("start_ns")).alias("duration_s")
    columns = ("run_id", "execution_id", "start_ns", length, is_finished().alias("finished"))
    sides = intervals.filter(is_learnt()).select(columns)
    others = intervals.filter(is_counted()).select(columns)
    others = others.rename({name: f"other_{name}" for name in others.columns if name != "run_id"})
    return (
        overlaps(intervals)
        .filter(pl.col("agent") != pl.col("other_agent"))
        .join(sides, on=["run_id", "execution_id"], maintain_order="left")
        .join(others, on=["run_id", "other_execution_id"], maintain_order="left")
        .with_columns(
            in_seconds(pl.col("overlap_ns")).alias("overlap_s"),
            (pl.col("other_start_ns") - pl.col("start_ns")).clip(0).alias("from_ns"),
        )
        .select(*OVERLAPS.names(), *_MORE)
    )


def counted_pairs(meetings: pl.DataFrame, *, cut_short: bool) -> pl.DataFrame:
    """Return the pairs of executions that `n` and the overlapped seconds of a pair of tasks count.

    They are what an estimator uses: those whose first execution succeeded, beside whatever the other agent did. Of
    tasks that never succeeded beside each other they are all that were seen.

    Args:
        meetings: what `overlapping_pairs` returned.
        cut_short: whether the estimator uses executions that did not succeed too.
    """
    if cut_short:
        return meetings
    return meetings.filter(pl.col("finished") | ~pl.col("finished").any().over(PAIR))


def synergy_table(
    executions: pl.DataFrame,
    meetings: pl.DataFrame,
    rows: Iterable[tuple[Any, ...]],
    estimator: str,
    *,
    cut_short: bool = False,
) -> pl.DataFrame:
    """Lay out an estimator's coefficients with one row per ordered pair of tasks of different agents.

    Args:
        executions: all that count, with agent and task; they say which tasks there are.
        meetings: what `overlapping_pairs` returned.
        rows: tuples of agent, task, other agent, other task; synergy, standard error and both ends of its interval;
            the same of the free synergy; and whether all that was asked is identified. Numbers that are not are NaN.
        estimator: its name.
        cut_short: whether it uses executions that did not succeed too.

    Returns:
        A frame of schema `SYNERGIES`; pairs that never overlapped carry nulls and the status unobserved.
    """
    coefficients = pl.DataFrame(list(rows), schema=_COEFFICIENTS, orient="row").fill_nan(None)
    tasks = executions.group_by("agent", "task").agg(pl.len().alias("executions")).sort("agent", "task")
    seen = (
        counted_pairs(meetings, cut_short=cut_short)
        .group_by(PAIR)
        .agg(pl.len().alias("n"), pl.col("overlap_s").sort().sum(), pl.col("finished").sum().alias("successes"))
    )
    table = (
        task_pairs(tasks, seen)
        .join(seen, on=PAIR, how="left")
        .join(coefficients, on=PAIR, how="left")
        .with_columns(pl.col("n", "successes").fill_null(0), pl.col("overlap_s").fill_null(0.0))
    )
    table = table.with_columns(
        _status().alias("status"),
        pl.lit(estimator).alias("estimator"),
        *(pl.when(pl.col("n") > 0).then(name).alias(name) for name in (*_NUMBERS, *_FREE_NUMBERS)),
    )
    return table.select(SYNERGIES.names()).cast(SYNERGIES).sort(PAIR)


def _status() -> pl.Expr:
    """Return the status of a row by n, the successes among them, its number and whether that is identified."""
    told = pl.col("synergy").is_not_null()
    return (
        pl.when(pl.col("n") == 0)
        .then(pl.lit(UNOBSERVED))
        .when(~told & (pl.col("successes") == 0))
        .then(pl.lit(NO_SUCCESS))
        .when(~told | ~pl.col("identified"))
        .then(pl.lit(WEAKLY_IDENTIFIED))
        .when(pl.col("successes") < SPARSE_BELOW)
        .then(pl.lit(SPARSE))
        .otherwise(pl.lit(OK))
    )
