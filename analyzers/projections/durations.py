"""How long each task takes: descriptive statistics and fitted distributions per (agent, task)."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import polars as pl

from hrclog.analyzers.projections.distributions import NAMES, fit_distributions
from hrclog.analyzers.projections.frames import INTERVALS_FRAME, check_frame
from hrclog.analyzers.projections.intervals import has_learnt_role, is_success
from hrclog.analyzers.projections.schemas import DURATIONS
from hrclog.events import UNKNOWN_OUTCOME, Outcome

Z95: Final = 1.959963984540054

_FAILED: Final = (Outcome.FAILED.value, Outcome.TIMED_OUT.value)
_CANCELED: Final = (Outcome.CANCELED.value, Outcome.SKIPPED.value)
_RATES: Final = ("success_rate", "success_low", "success_high")


def durations(intervals: pl.DataFrame) -> pl.DataFrame:
    """Summarise the durations of the executions that succeeded, and count the others.

    Where a run tells no outcome at all, those that ended count as completed: their durations too, but no success rate.
    Executions still open when the log ended are right-censored: counted, never averaged in; so are those whose end
    tells no outcome where others do. Auxiliary ones are left out.

    Args:
        intervals: a frame of schema `INTERVALS`.

    Returns:
        A frame of schema `DURATIONS`, sorted by (agent, task).

    Raises:
        HrclogError: `intervals` is no intervals frame.
    """
    check_frame(intervals, INTERVALS_FRAME)
    outcome = pl.col("outcome")
    succeeded = is_success()
    seconds = pl.col("seconds").filter(succeeded)
    rows = (
        intervals.filter(has_learnt_role())
        .with_columns(((pl.col("end_ns") - pl.col("start_ns")) / 1e9).alias("seconds"))
        .sort("agent", "task", "seconds", "run_id", "execution_id")
        .group_by("agent", "task", maintain_order=True)
        .agg(
            succeeded.sum().alias("count"),
            (outcome == Outcome.SUCCEEDED.value).sum().alias("told"),
            outcome.is_in(_FAILED).sum().alias("n_failed"),
            outcome.is_in(_CANCELED).sum().alias("n_canceled"),
            (outcome == UNKNOWN_OUTCOME).sum().alias("n_censored"),
            seconds.mean().alias("mean_s"),
            seconds.std(ddof=1).alias("std_s"),
            seconds.median().alias("median_s"),
            seconds.quantile(0.25, "linear").alias("q25_s"),
            seconds.quantile(0.75, "linear").alias("q75_s"),
            seconds.min().alias("min_s"),
            seconds.max().alias("max_s"),
            seconds.alias("sample"),
        )
    )
    fits = [fit_distributions(np.asarray(sample, np.float64)) for sample in rows["sample"]]
    rates = [
        dict(zip(_RATES, wilson(row[0], row[0] + row[1]), strict=True))
        for row in rows.select("told", "n_failed").rows()
    ]
    extra = [fit | rate for fit, rate in zip(fits, rates, strict=True)]
    columns = pl.DataFrame(extra, schema=dict.fromkeys((*NAMES, *_RATES), pl.Float64))
    return pl.concat([rows.drop("sample"), columns], how="horizontal").select(DURATIONS.names()).cast(DURATIONS)


def wilson(successes: int, trials: int) -> tuple[float | None, float | None, float | None]:
    """Return a success rate and its Wilson 95 % interval (Wilson 1927), None without trials."""
    if not trials:
        return None, None, None
    rate, z2 = successes / trials, Z95 * Z95
    centre = (rate + z2 / (2 * trials)) / (1 + z2 / trials)
    half = Z95 * math.sqrt(rate * (1 - rate) / trials + z2 / (4 * trials * trials)) / (1 + z2 / trials)
    # rounding may put the ends a hair beyond the rate they enclose
    return rate, min(max(0.0, centre - half), rate), max(min(1.0, centre + half), rate)
