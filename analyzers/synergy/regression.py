"""The paper's regression, as its authors' code does it (`ols`) and as it is printed (`paper`).

Main task i of agent A, executions k that met at least one task of agent B; d_j is the mean duration of (B, j):

    ols:    y_k = sum_c o_kc        X_kj = d_j sum_{c in j} o_kc / D_c
    paper:  y_k = D_k - o_k0        X_kj = d_j o_kj / D_k        (eq. regression-row, its index misprint read sensibly)

y = X s without an intercept, one regression per (A, i, B). s_j says how long j of B takes, relative to its own mean,
while i of A runs; so it is stored as agent B, task j, other agent A, other task i.
Sandrini, Faroni, Pedrocchi, Learning Action Duration and Synergy in Task Planning for HRC (ETFA 2022).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
import polars as pl

from hrclog.analyzers.busy import busy_times
from hrclog.analyzers.overlaps import PAIR
from hrclog.analyzers.synergy.least_squares import Floats, fit
from hrclog.analyzers.synergy.outliers import Outliers, inliers
from hrclog.analyzers.synergy.pairs import (
    mean_durations,
    overlapping_pairs,
    successful,
    synergy_table,
)

_COEFFICIENTS: Final = pl.Schema(
    dict.fromkeys(PAIR, pl.String())
    | dict.fromkeys(("synergy", "std_err", "ci_low", "ci_high"), pl.Float64())
    | {"identified": pl.Boolean()}
)


def ols(intervals: pl.DataFrame, outliers: Outliers = "none") -> pl.DataFrame:
    """Estimate synergies as the paper's authors' code does.

    Args:
        intervals: a frame of schema `INTERVALS`; executions that did not succeed take no part.
        outliers: which rows of each regression to leave out.

    Returns:
        A frame of schema `SYNERGIES`; `std_err` from ordinary least squares.
    """
    executions = successful(intervals)
    pairs = overlapping_pairs(executions)
    share = pl.col("overlap_s") / pl.col("other_duration_s")
    return _estimate("ols", intervals, pairs, mean_durations(executions), outliers, pl.col("overlap_s"), share)


def paper(intervals: pl.DataFrame, outliers: Outliers = "none") -> pl.DataFrame:
    """Estimate synergies as the paper prints it.

    Args:
        intervals: a frame of schema `INTERVALS`; executions that did not succeed take no part.
        outliers: which rows of each regression to leave out.

    Returns:
        A frame of schema `SYNERGIES`; `std_err` from ordinary least squares.
    """
    executions = successful(intervals)
    pairs = _with_met_time(overlapping_pairs(executions), executions)
    share = pl.col("overlap_s") / pl.col("duration_s")
    # the time in which the other agent was busy, spread over the pairs of k, sums to y_k again
    met = pl.col("met_s") / pl.len().over("run_id", "execution_id", "other_agent")
    return _estimate("paper", intervals, pairs, mean_durations(executions), outliers, met, share)


def _with_met_time(pairs: pl.DataFrame, executions: pl.DataFrame) -> pl.DataFrame:
    """Add `met_s` = D_k - o_k0, the time within k in which the other agent was busy, a union and no sum."""
    busy = busy_times(executions)
    spans = executions.select("run_id", "execution_id", "start_ns", "end_ns")
    keyed = pairs.join(spans, on=["run_id", "execution_id"], maintain_order="left").with_row_index("row")
    rows, met = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    for (run, other), part in keyed.group_by("run_id", "other_agent", maintain_order=True):
        rows.append(part["row"].to_numpy().astype(np.int64))
        met.append(busy[str(run)][str(other)].within(part["start_ns"].to_numpy(), part["end_ns"].to_numpy()))
    values = np.zeros(pairs.height, np.int64)
    values[np.concatenate(rows)] = np.concatenate(met)
    return pairs.with_columns(pl.Series("met_s", values / 1e9, pl.Float64))


def _estimate(
    name: str,
    intervals: pl.DataFrame,
    pairs: pl.DataFrame,
    means: pl.DataFrame,
    outliers: Outliers,
    response: pl.Expr,
    share: pl.Expr,
) -> pl.DataFrame:
    from threadpoolctl import threadpool_limits

    terms = pairs.with_columns(response.alias("response"), share.alias("share"))
    mean_of = {(agent, task): mean for agent, task, mean in means.iter_rows()}
    terms = terms.sort(*PAIR, "run_id", "execution_id", "other_execution_id")
    # many small problems: threads make each slower, and its last digits depend on their number
    with threadpool_limits(1, "blas"):
        rows = [
            row
            for (agent, task, other), part in terms.group_by("agent", "task", "other_agent", maintain_order=True)
            for row in _regress((str(agent), str(task), str(other)), part, mean_of, outliers)
        ]
    coefficients = pl.DataFrame(rows, schema=_COEFFICIENTS, orient="row").fill_nan(None)
    return synergy_table(intervals, pairs, coefficients, name)


def _regress(
    main: tuple[str, str, str], part: pl.DataFrame, mean_of: dict[tuple[str, str], float], outliers: Outliers
) -> Iterator[tuple[Any, ...]]:
    """Yield the coefficient rows of one main task against one other agent; NaN where not identified."""
    agent, task, other = main
    x, y, columns = _matrices(part, other, mean_of)
    kept = inliers(y, outliers)
    x, y = x[kept], y[kept]
    met = np.flatnonzero(x.any(axis=0))
    if not len(met):
        return
    result = fit(x[:, met], y)
    numbers = np.stack([result.coefficients, result.std_errors, result.low, result.high], axis=1).tolist()
    for column, values, identified in zip(met.tolist(), numbers, result.identified.tolist(), strict=True):
        yield (other, columns[column], agent, task, *values, identified)


def _matrices(
    part: pl.DataFrame, other: str, mean_of: dict[tuple[str, str], float]
) -> tuple[Floats, Floats, list[str]]:
    """Return X (n, p), y (n,) and the concurrent tasks (p,) of one regression."""
    wide = part.with_columns(
        pl.struct("run_id", "execution_id").rank("dense").sub(1).alias("k"),
        pl.col("other_task").rank("dense").sub(1).alias("j"),
    )
    columns = part["other_task"].unique().sort().to_list()
    k, j = wide["k"].to_numpy().astype(np.int64), wide["j"].to_numpy().astype(np.int64)
    n, p = int(k.max()) + 1, len(columns)
    y = np.bincount(k, wide["response"].to_numpy(), n).astype(np.float64, copy=False)
    x = np.bincount(k * p + j, wide["share"].to_numpy(), n * p).reshape(n, p)
    return x * np.array([mean_of[other, column] for column in columns]), y, columns
