"""What every synergy estimator starts from: the pairs of successful executions that overlapped."""

from __future__ import annotations

from typing import Final

import polars as pl

from hrclog.analyzers.intervals import counted
from hrclog.analyzers.overlaps import PAIR, overlaps, task_counts, task_pairs
from hrclog.analyzers.schemas import SYNERGIES
from hrclog.events import Outcome

SPARSE_BELOW: Final = 5


def successful(intervals: pl.DataFrame) -> pl.DataFrame:
    """Return the executions whose durations mean something: succeeded, closed, longer than nothing, and counted."""
    return intervals.filter(
        counted() & (pl.col("outcome") == Outcome.SUCCEEDED.value) & (pl.col("end_ns") > pl.col("start_ns"))
    )


def overlapping_pairs(executions: pl.DataFrame) -> pl.DataFrame:
    """Return the ordered pairs of successful executions of different agents that overlap.

    Args:
        executions: what `successful` returned.

    Returns:
        The columns of `OVERLAPS` with `duration_s`, `other_duration_s` and `overlap_s`.
    """
    lengths = executions.select(
        "run_id", "execution_id", ((pl.col("end_ns") - pl.col("start_ns")) / 1e9).alias("duration_s")
    )
    others = lengths.rename({"execution_id": "other_execution_id", "duration_s": "other_duration_s"})
    return (
        overlaps(executions)
        .filter(pl.col("agent") != pl.col("other_agent"))
        .join(lengths, on=["run_id", "execution_id"], maintain_order="left")
        .join(others, on=["run_id", "other_execution_id"], maintain_order="left")
        .with_columns((pl.col("overlap_ns") / 1e9).alias("overlap_s"))
    )


def mean_durations(executions: pl.DataFrame) -> pl.DataFrame:
    """Return agent, task and mean duration `mean_s` of successful executions."""
    seconds = (pl.col("end_ns") - pl.col("start_ns")) / 1e9
    return executions.group_by("agent", "task").agg(seconds.sort().mean().alias("mean_s")).sort("agent", "task")


def synergy_table(
    intervals: pl.DataFrame, pairs: pl.DataFrame, coefficients: pl.DataFrame, estimator: str
) -> pl.DataFrame:
    """Lay out an estimator's coefficients with one row per ordered pair of tasks of different agents.

    Args:
        intervals: all executions; they say which tasks there are.
        pairs: what `overlapping_pairs` returned.
        coefficients: columns `PAIR`, synergy, std_err, ci_low, ci_high, identified.
        estimator: its name.

    Returns:
        A frame of schema `SYNERGIES`; pairs that never overlapped carry nulls and the status unobserved.
    """
    seen = pairs.group_by(PAIR).agg(pl.len().alias("n"), pl.col("overlap_s").sort().sum())
    table = (
        task_pairs(task_counts(intervals), seen)
        .join(seen, on=PAIR, how="left")
        .join(coefficients, on=PAIR, how="left")
        .with_columns(pl.col("n").fill_null(0), pl.col("overlap_s").fill_null(0.0))
    )
    status = (
        pl.when((pl.col("n") == 0) | pl.col("identified").is_null())
        .then(pl.lit("unobserved"))
        .when(~pl.col("identified"))
        .then(pl.lit("weakly_identified"))
        .when(pl.col("n") < SPARSE_BELOW)
        .then(pl.lit("sparse"))
        .otherwise(pl.lit("ok"))
    )
    table = table.with_columns(
        status.alias("status"),
        pl.lit(estimator).alias("estimator"),
        pl.lit(None, pl.Float64).alias("synergy_free"),
    )
    return table.select(SYNERGIES.names()).cast(SYNERGIES).sort(PAIR)
