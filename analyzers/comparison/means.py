"""Means of two sides, their difference and its interval, for any totals per run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from hrclog.analyzers.comparison.draws import Draws, percentile_interval, widened
from hrclog.arrays import FloatArray, IntArray

_ROUNDING: Final = 1e-9  # of the means; a difference below it is none


@dataclass(frozen=True, slots=True)
class _Side:
    mean: FloatArray  # (cells,), NaN where the side has no value
    n: IntArray
    runs: IntArray
    drawn: FloatArray  # (draws, cells)


def compare_means(a: pl.DataFrame, b: pl.DataFrame, draws_a: Draws, draws_b: Draws, schema: pl.Schema) -> pl.DataFrame:
    """Compare means that are quotients of totals per run.

    Args:
        a: one row per run and key: the first two columns of the schema, `run_id`, `total` of the values of the run,
            and `weight`, how many they are.
        b: the same of the other side.
        draws_a: the runs of the first side.
        draws_b: the runs of the second.
        schema: of the result, one of those of means in `hrclog.analyzers.comparison.schemas`.

    Returns:
        A frame of that schema, sorted by its first two columns.
    """
    keys = schema.names()[:2]
    cells = pl.concat([a.select(keys), b.select(keys)]).unique().sort(keys)
    first, second = _side(a, cells, keys, draws_a), _side(b, cells, keys, draws_b)
    difference = second.mean - first.mean
    if len(first.drawn) == len(second.drawn):
        low, high = percentile_interval(second.drawn - first.drawn)
    else:  # one side has too few runs to draw from
        low, high = np.full((2, cells.height), np.nan)
    least = _ROUNDING * np.maximum(np.abs(first.mean), np.abs(second.mean))
    positive = np.where((first.mean > 0) & (second.mean > 0), first.mean, np.nan)
    columns = {
        "mean_a": first.mean,
        "mean_b": second.mean,
        "difference": difference,
        "ci_low": low,
        "ci_high": high,
        "relative": difference / positive,
    }
    known = pl.lit(pl.Series(~np.isnan(low)))
    return (
        cells.with_columns(pl.Series(name, values, nan_to_null=True) for name, values in columns.items())
        .with_columns(pl.when(known).then(pl.lit(pl.Series((low > least) | (high < -least)))).alias("differs"))
        .with_columns(n_a=first.n, n_b=second.n, runs_a=first.runs, runs_b=second.runs)
        .select(schema.names())
        .cast(schema)
    )


def _side(totals: pl.DataFrame, cells: pl.DataFrame, keys: Sequence[str], draws: Draws) -> _Side:
    runs = pl.DataFrame({"run_id": draws.runs}, schema={"run_id": pl.String}).with_row_index("row")
    placed = totals.join(cells.with_row_index("cell"), on=keys).join(runs, on="run_id")
    total, weight = np.zeros((2, len(draws.runs), cells.height))
    row, cell = placed["row"].to_numpy(), placed["cell"].to_numpy()
    total[row, cell], weight[row, cell] = placed["total"].to_numpy(), placed["weight"].to_numpy()
    # sorted, so that the sum does not depend on what the runs are called
    mean = _quotient(np.sort(total, axis=0).sum(axis=0), weight.sum(axis=0))
    runs_with = (weight > 0).sum(axis=0)
    drawn = _quotient(draws.counts @ total, draws.counts @ weight)
    return _Side(mean, weight.sum(axis=0).astype(np.int64), runs_with, widened(drawn, mean, runs_with))


def _quotient(total: FloatArray, weight: FloatArray) -> FloatArray:
    quotient = np.full(total.shape, np.nan)
    np.divide(total, weight, out=quotient, where=weight > 0)
    return quotient
