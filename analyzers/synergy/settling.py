"""What was known after 1, 2, 5, … runs: how estimates settle as runs accumulate."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count
from typing import Final

import numpy as np
import polars as pl

from hrclog.analyzers.projections.intervals import has_learnt_role, is_success
from hrclog.analyzers.projections.mean_interval import half_width
from hrclog.analyzers.projections.overlaps import PAIR
from hrclog.analyzers.projections.schemas import SETTLING, SETTLING_DURATIONS, SYNERGIES
from hrclog.analyzers.synergy.estimator import estimate
from hrclog.analyzers.synergy.estimators import ESTIMATORS
from hrclog.analyzers.synergy.observations import Observations, observe
from hrclog.analyzers.synergy.outlier_methods import Outliers
from hrclog.analyzers.synergy.pairs import UNOBSERVED

MOST_STEPS: Final = 8

_LEAST_GROWTH: Final = 1.25  # of the last step over the one before


def settle(
    intervals: pl.DataFrame,
    runs: pl.DataFrame,
    estimator: str,
    outliers: Outliers = "none",
    most: int = MOST_STEPS,
    *,
    observations: Observations | None = None,
    final: pl.DataFrame | None = None,
) -> pl.DataFrame:
    """Estimate synergies from the first runs alone, for growing numbers of them.

    Every step has the intervals that its own runs give, and holds the runs of the steps before.

    Args:
        intervals: a frame of schema `INTERVALS`.
        runs: a frame of schema `RUNS`.
        estimator: its name.
        outliers: which rows each estimate leaves out.
        most: steps at most, at least 2.
        observations: those of the intervals, where they were made already.
        final: what the same estimator said of all runs, where that is known; the last step is that then. Errors of a
            bootstrap are of another kind than those of the steps before.

    Returns:
        A frame of schema `SETTLING`: per step one row per pair of tasks that all runs have, sorted.
    """
    order = runs.sort("start_ns", "run_id", nulls_last=True)["run_id"].to_list()
    numbers = steps(len(order), most)
    if not numbers:
        return SETTLING.to_frame()
    if observations is None:
        observations = observe(intervals)
    chosen_estimator = ESTIMATORS[estimator]
    if final is None:
        final = estimate(chosen_estimator, observations, outliers).synergies
    tables = [
        estimate(chosen_estimator, observations.only(order[:number]), outliers).synergies for number in numbers[:-1]
    ]
    of_pair = final.select(*PAIR, "estimator")
    laid_out = [_lay_out(table, of_pair, number) for number, table in zip(numbers, [*tables, final], strict=True)]
    return pl.concat(laid_out).cast(SETTLING)


def settle_durations(intervals: pl.DataFrame, runs: pl.DataFrame, most: int = MOST_STEPS) -> pl.DataFrame:
    """Average the durations of executions that succeeded over the first runs alone, for growing numbers of them.

    Intervals are Student's, executions taken as independent of each other.

    Args:
        intervals: a frame of schema `INTERVALS`.
        runs: a frame of schema `RUNS`.
        most: steps at most, at least 2.

    Returns:
        A frame of schema `SETTLING_DURATIONS`: per step one row per (agent, task) that all runs have, sorted.
    """
    order = runs.sort("start_ns", "run_id", nulls_last=True)["run_id"].to_list()
    primary = intervals.filter(has_learnt_role())
    tasks = primary.select("agent", "task").unique().sort("agent", "task")
    succeeded = primary.filter(is_success())
    samples = succeeded.select(
        "run_id", "agent", "task", ((pl.col("end_ns") - pl.col("start_ns")) / 1e9).alias("seconds")
    ).sort("agent", "task", "seconds")
    tables = [_means(samples, tasks, order[:number]) for number in steps(len(order), most)]
    return pl.concat([SETTLING_DURATIONS.to_frame(), *tables])


def steps(runs: int, most: int = MOST_STEPS) -> list[int]:
    """Return after how many runs to look: 1, 2, 5, 10, 20, 50, … and all.

    One shortly before all is left out; of too many, some between the first and the last are.

    Args:
        runs: how many there are.
        most: numbers at most, at least 2.
    """
    if not runs:
        return []
    numbers: list[int] = []
    for power in count():
        grown = [base * 10**power for base in (1, 2, 5) if base * 10**power * _LEAST_GROWTH <= runs]
        numbers += grown
        if len(grown) < 3:
            break
    numbers.append(runs)
    if len(numbers) <= most:
        return numbers
    return [numbers[int(index)] for index in np.linspace(0, len(numbers) - 1, most).round()]


def _lay_out(table: pl.DataFrame, of_pair: pl.DataFrame, number: int) -> pl.DataFrame:
    """Return a table with a row for each of the pairs; those it does not have were not observed."""
    return (
        of_pair.join(table.drop("estimator"), on=PAIR, how="left", maintain_order="left")
        .with_columns(
            pl.lit(number, pl.Int64).alias("runs"),
            pl.col("n").fill_null(0),
            pl.col("overlap_s").fill_null(0.0),
            pl.col("status").fill_null(UNOBSERVED),
        )
        .select("runs", *SYNERGIES.names())
    )


def _means(samples: pl.DataFrame, tasks: pl.DataFrame, runs: Sequence[str]) -> pl.DataFrame:
    seconds = pl.col("seconds")
    means = (
        samples.filter(pl.col("run_id").is_in(runs))
        .group_by("agent", "task", maintain_order=True)
        .agg(pl.len().alias("count"), seconds.mean().alias("mean_s"), seconds.std(ddof=1).alias("std_s"))
    )
    half = half_width(means["std_s"].fill_null(float("nan")).to_numpy(), means["count"].cast(pl.Int64).to_numpy())
    ends = means.with_columns(pl.Series("half", half, nan_to_null=True)).with_columns(
        (pl.col("mean_s") - pl.col("half")).alias("mean_low_s"),
        (pl.col("mean_s") + pl.col("half")).alias("mean_high_s"),
    )
    return (
        tasks.join(ends, on=["agent", "task"], how="left", maintain_order="left")
        .with_columns(pl.lit(len(runs), pl.Int64).alias("runs"), pl.col("count").fill_null(0))
        .select(SETTLING_DURATIONS.names())
        .cast(SETTLING_DURATIONS)
    )
