"""How long each task takes: descriptive statistics and fitted distributions per (agent, task)."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt
import polars as pl

from hrclog.analyzers.schemas import DURATIONS
from hrclog.events import UNKNOWN_OUTCOME, Outcome, Role

Z95: Final = 1.959963984540054

_FAILED: Final = (Outcome.FAILED.value, Outcome.TIMED_OUT.value)
_CANCELED: Final = (Outcome.CANCELED.value, Outcome.SKIPPED.value)
_NEWTON_STEPS: Final = 50


def durations(intervals: pl.DataFrame) -> pl.DataFrame:
    """Summarise the durations of the executions that succeeded, and count the others.

    Executions still open when the log ended are right-censored: counted, never averaged in. Auxiliary ones are left out.

    Args:
        intervals: a frame of schema `INTERVALS`.

    Returns:
        A frame of schema `DURATIONS`, sorted by (agent, task).
    """
    outcome = pl.col("outcome")
    succeeded = (outcome == Outcome.SUCCEEDED.value) & pl.col("end_ns").is_not_null()
    seconds = pl.col("seconds").filter(succeeded)
    rows = (
        intervals.filter(pl.col("role") != Role.AUXILIARY.value)
        .with_columns(((pl.col("end_ns") - pl.col("start_ns")) / 1e9).alias("seconds"))
        .sort("agent", "task", "seconds", "run_id", "execution_id")
        .group_by("agent", "task", maintain_order=True)
        .agg(
            succeeded.sum().alias("count"),
            outcome.is_in(_FAILED).sum().alias("n_failed"),
            outcome.is_in(_CANCELED).sum().alias("n_canceled"),
            ((outcome == UNKNOWN_OUTCOME) & pl.col("end_ns").is_null()).sum().alias("n_censored"),
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
    rates = [wilson(row[0], row[0] + row[1]) for row in rows.select("count", "n_failed").iter_rows()]
    extra = pl.DataFrame(
        [fit | {"success_rate": rate[0], "success_low": rate[1], "success_high": rate[2]}
         for fit, rate in zip(fits, rates, strict=True)],
        schema={name: pl.Float64 for name in DURATIONS if name not in rows.columns},
    )
    return pl.concat([rows.drop("sample"), extra], how="horizontal").select(DURATIONS.names()).cast(dict(DURATIONS))


def wilson(successes: int, trials: int) -> tuple[float | None, float | None, float | None]:
    """Return a success rate and its Wilson 95 % interval (Wilson 1927), None without trials."""
    if not trials:
        return None, None, None
    rate, z2 = successes / trials, Z95 * Z95
    centre = (rate + z2 / (2 * trials)) / (1 + z2 / trials)
    half = Z95 * math.sqrt(rate * (1 - rate) / trials + z2 / (4 * trials * trials)) / (1 + z2 / trials)
    # rounding may put the ends a hair beyond the rate they enclose
    return rate, min(max(0.0, centre - half), rate), max(min(1.0, centre + half), rate)


def fit_distributions(seconds: npt.NDArray[np.float64]) -> dict[str, float | None]:
    """Fit a lognormal and a gamma distribution by maximum likelihood, with AIC = 4 - 2 log-likelihood.

    Args:
        seconds: durations, shape (n,).

    Returns:
        Parameters by column name; None where fewer than two different positive durations leave them undefined.
    """
    names = ("lognormal_mu", "lognormal_sigma", "lognormal_aic", "gamma_shape", "gamma_scale_s", "gamma_aic")
    if len(seconds) < 2 or seconds.min() <= 0 or np.ptp(np.log(seconds)) < 1e-12:
        return dict.fromkeys(names)
    return dict(zip(names, (*_fit_lognormal(np.log(seconds)), *_fit_gamma(seconds)), strict=True))


def _fit_lognormal(logs: npt.NDArray[np.float64]) -> tuple[float, float, float]:
    n, mu, sigma = len(logs), float(logs.mean()), float(logs.std())
    log_likelihood = -n / 2 * (math.log(2 * math.pi * sigma * sigma) + 1) - float(logs.sum())
    return mu, sigma, 4 - 2 * log_likelihood


def _fit_gamma(seconds: npt.NDArray[np.float64]) -> tuple[float, float, float]:
    """Newton's method on log shape - digamma(shape) = log mean - mean log (Minka 2002 gives the start)."""
    from scipy.special import digamma, gammaln, polygamma

    n, mean, mean_log = len(seconds), float(seconds.mean()), float(np.log(seconds).mean())
    gap = math.log(mean) - mean_log
    shape = (3 - gap + math.sqrt((gap - 3) ** 2 + 24 * gap)) / (12 * gap)
    for _ in range(_NEWTON_STEPS):
        step = (math.log(shape) - float(digamma(shape)) - gap) / (1 / shape - float(polygamma(1, shape)))
        shape = shape - step if step < shape else shape / 2
        if abs(step) < 1e-12 * shape:
            break
    scale = mean / shape
    log_likelihood = n * ((shape - 1) * mean_log - shape - shape * math.log(scale) - float(gammaln(shape)))
    return shape, scale, 4 - 2 * log_likelihood
