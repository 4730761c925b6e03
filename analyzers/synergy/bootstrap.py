"""Standard errors independent of the estimator's own: its estimates on runs drawn with repetition (cluster bootstrap).

Executions of one run are not independent of each other, runs are; so runs are drawn, not executions (Efron and
Tibshirani 1993; Cameron, Gelbach and Miller 2008).
"""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
import polars as pl

from hrclog.analyzers.projections.overlaps import PAIR
from hrclog.analyzers.synergy.estimator import Estimator, EstimatorError, estimate
from hrclog.analyzers.synergy.fit import Fit
from hrclog.analyzers.synergy.observations import Observations
from hrclog.analyzers.synergy.outlier_methods import Outliers
from hrclog.errors import HrclogError
from hrclog.parallel import ordered_map

_VALUES: Final = {
    "synergy": ("std_err", "ci_low", "ci_high"),
    "synergy_free": ("free_std_err", "free_ci_low", "free_ci_high"),
}
_BATCH: Final = 20


def with_bootstrap(
    fit: Fit,
    observations: Observations,
    estimator: Estimator,
    outliers: Outliers,
    replicates: int,
    seed: int,
    workers: int,
    on_draws: Callable[[int], None] = lambda _: None,
) -> Fit:
    """Return a fit whose errors and 95 % intervals are those of the bootstrap; estimates stay.

    Args:
        fit: what the estimator made of the observations.
        observations: of at least two runs.
        estimator: what made it.
        outliers: as for the fit.
        replicates: how many draws, at least 2.
        seed: of the draws; the result depends on it, not on the workers.
        workers: processes to use.
        on_draws: told how many further draws are done, for progress.

    Raises:
        HrclogError: there are too few runs or draws.
    """
    draws = bootstrap(observations, estimator, outliers, replicates, seed, workers, on_draws)
    table = fit.synergies
    for value, (error, low, high) in _VALUES.items():
        errors = draws.group_by(PAIR).agg(
            pl.col(value).std().alias("error"),
            pl.col(value).quantile(0.025, "linear").alias("low"),
            pl.col(value).quantile(0.975, "linear").alias("high"),
        )
        known = pl.col(value).is_not_null()
        table = (
            table.join(errors, on=PAIR, how="left", maintain_order="left")
            .with_columns(
                pl.when(known).then("error").alias(error),
                pl.when(known).then("low").alias(low),
                pl.when(known).then("high").alias(high),
            )
            .drop("error", "low", "high")
        )
    return replace(fit, synergies=table)


def bootstrap(
    observations: Observations,
    estimator: Estimator,
    outliers: Outliers,
    replicates: int,
    seed: int,
    workers: int = 1,
    on_draws: Callable[[int], None] = lambda _: None,
) -> pl.DataFrame:
    """Estimate synergies from runs drawn with repetition.

    Args:
        observations: of at least two runs.
        estimator: what made it.
        outliers: which rows to leave out.
        replicates: how many draws, at least 2.
        seed: of the draws; the result depends on it, not on the workers.
        workers: processes to use.
        on_draws: told how many further draws are done, for progress.

    Returns:
        Columns replicate, agent, task, other_agent, other_task, synergy, synergy_free; null where not identified.

    Raises:
        HrclogError: there are too few runs or draws.
    """
    runs = observations.runs
    if len(runs) < 2:
        raise HrclogError(f"a bootstrap draws runs: found {len(runs)}, expected at least 2; record more runs")
    if replicates < 2:
        raise HrclogError(f"the number of bootstrap draws is {replicates}, expected at least 2")
    if workers > 1:
        check_picklable(estimator)
    batches = [range(low, min(low + _BATCH, replicates)) for low in range(0, replicates, _BATCH)]
    work = partial(_batch, observations, estimator, outliers, seed)
    tables = []
    for batch, table in zip(batches, ordered_map(work, batches, workers), strict=True):
        tables.append(table)
        on_draws(len(batch))
    return pl.concat(tables)


def check_picklable(estimator: Estimator) -> None:
    """Raise where an estimator cannot be sent to worker processes.

    Raises:
        EstimatorError: pickle does not find its class by the module's name.
    """
    try:
        pickle.dumps(estimator)
    except Exception as error:
        complaint = f"it cannot be sent to worker processes ({error})"
        raise EstimatorError(estimator.name, complaint, "a class at the top of a module; or use one worker") from error


def drawn_runs(runs: list[str], seed: int, replicate: int) -> list[str]:
    """Return as many runs as there are, drawn with repetition."""
    chosen = np.random.default_rng([seed, replicate]).integers(0, len(runs), len(runs))
    return [runs[index] for index in chosen]


def _batch(
    observations: Observations, estimator: Estimator, outliers: Outliers, seed: int, replicates: range
) -> pl.DataFrame:
    return pl.concat([_replicate(observations, estimator, outliers, seed, replicate) for replicate in replicates])


def _replicate(
    observations: Observations, estimator: Estimator, outliers: Outliers, seed: int, replicate: int
) -> pl.DataFrame:
    drawn = observations.drawn(drawn_runs(observations.runs, seed, replicate))
    table = estimate(estimator, drawn, outliers).synergies
    return table.select(pl.lit(replicate, pl.Int64).alias("replicate"), *PAIR, *_VALUES)
