"""Synergies of two sides, their ratio and its interval."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
import polars as pl

from hrclog.analyzers.comparison.draws import percentile_interval, side_seed, widened
from hrclog.analyzers.comparison.schemas import SYNERGIES
from hrclog.analyzers.projections.overlaps import PAIR
from hrclog.analyzers.synergy.bootstrap import bootstrap
from hrclog.analyzers.synergy.estimators import ESTIMATORS
from hrclog.analyzers.synergy.observations import Observations
from hrclog.analyzers.synergy.outlier_methods import Outliers
from hrclog.analyzers.synergy.pairs import UNOBSERVED, counted_pairs
from hrclog.arrays import FloatArray

_ROUNDING: Final = 1e-9  # of a log ratio; less is no difference

# value in a side's table -> its two columns, and the prefix of ratio, interval and flag
_VALUES: Final = {"synergy": ("synergy_a", "synergy_b", ""), "synergy_free": ("free_a", "free_b", "free_")}


def draw_synergies(
    observations: Observations,
    estimator: str,
    outliers: Outliers,
    replicates: int,
    seed: int,
    workers: int,
    on_draws: Callable[[int], None],
) -> pl.DataFrame:
    """Return what the estimator says of runs drawn with repetition, as `bootstrap` does, with the side's own seed."""
    seed = side_seed(seed, observations.runs)
    return bootstrap(observations, ESTIMATORS[estimator], outliers, replicates, seed, workers, on_draws)


def side_synergies(synergies: pl.DataFrame, observations: Observations, estimator: str) -> pl.DataFrame:
    """Return the synergies of a side, with the number of runs in which the n pairs of executions overlapped."""
    pairs = counted_pairs(observations.meetings, cut_short=ESTIMATORS[estimator].counts_cut_short)
    runs = pairs.group_by(PAIR).agg(pl.col("run_id").n_unique().cast(pl.Int64).alias("runs"))
    return synergies.select(*PAIR, *_VALUES, "n", "status").join(runs, on=PAIR, how="left")


def compare_synergies(
    a: pl.DataFrame, b: pl.DataFrame, drawn_a: pl.DataFrame | None, drawn_b: pl.DataFrame | None, draws: int
) -> pl.DataFrame:
    """Compare synergies pair by pair; draw r of one side is set against draw r of the other.

    Quantiles are those of the log ratio, so that B against A is the inverse of A against B.

    Args:
        a: what `side_synergies` returned of the first side.
        b: the same of the second.
        drawn_a: what `draw_synergies` returned; without it on both sides there are no intervals.
        drawn_b: the same of the second.
        draws: how many there are.

    Returns:
        A frame of schema `SYNERGIES` of `hrclog.analyzers.comparison.schemas`, sorted by pair.
    """
    pairs = pl.concat([a.select(PAIR), b.select(PAIR)]).unique().sort(PAIR)
    first, second = (pairs.join(side, on=PAIR, how="left", maintain_order="left") for side in (a, b))
    columns: list[pl.Series] = []
    for side, name in ((first, "a"), (second, "b")):
        columns += [side[column].fill_null(0).alias(f"{column}_{name}") for column in ("n", "runs")]
        columns.append(side["status"].fill_null(UNOBSERVED).alias(f"status_{name}"))
    runs_a, runs_b = (side["runs"].fill_null(0).to_numpy() for side in (first, second))
    for value, (name_a, name_b, prefix) in _VALUES.items():
        log_a, log_b = _logs(first[value].to_numpy()), _logs(second[value].to_numpy())
        ratio = log_b - log_a
        low, high = np.full((2, pairs.height), np.nan)
        if drawn_a is not None and drawn_b is not None:
            low, high = percentile_interval(
                widened(_log_factors(drawn_b, pairs, value, draws), log_b, runs_b)
                - widened(_log_factors(drawn_a, pairs, value, draws), log_a, runs_a)
            )
        known = pl.lit(pl.Series(~np.isnan(low)))
        differs = pl.lit(pl.Series((low > _ROUNDING) | (high < -_ROUNDING)))
        columns += [first[value].alias(name_a), second[value].alias(name_b)]
        columns += [
            pl.Series(f"{prefix}{name}", np.exp(log), nan_to_null=True)
            for name, log in (("ratio", ratio), ("ci_low", low), ("ci_high", high))
        ]
        columns.append(pl.select(pl.when(known).then(differs).alias(f"{prefix}differs")).to_series())
    return pairs.with_columns(columns).select(SYNERGIES.names()).cast(SYNERGIES)


def _log_factors(drawn: pl.DataFrame, pairs: pl.DataFrame, value: str, draws: int) -> FloatArray:
    """Return the logarithms of the drawn factors, shape (draws, pairs).

    NaN where a draw does not identify a factor, and all NaN where one is 0 or less, which has no logarithm.
    """
    placed = pairs.with_row_index("pair").join(drawn, on=PAIR)
    factors = np.full((draws, pairs.height), np.nan)
    factors[placed["replicate"].to_numpy(), placed["pair"].to_numpy()] = placed[value].to_numpy()
    logs = _logs(factors)
    logs[:, (factors <= 0).any(axis=0)] = np.nan
    return logs


def _logs(values: FloatArray) -> FloatArray:
    """Return logarithms, NaN where a value is not known or not positive."""
    logs = np.full(values.shape, np.nan)
    np.log(values, out=logs, where=values > 0)
    return logs
