"""The paper's regressions as matrices: the authors' code (`concurrent_shares`) and the printed formula (`own_shares`).

Main task i of agent A, executions k of any outcome that met at least one execution c of agent B that succeeded (those
that did not tell nothing of how long j takes); d_j is the mean duration of (B, j):

    concurrent shares:  y_k = sum_c o_kc        X_kj = d_j sum_{c in j} o_kc / D_c
    own shares:         y_k = D_k - o_k0        X_kj = d_j o_kj / D_k   (eq. regression-row, its index misprint read
                                                                        sensibly)

y = X s without an intercept, one regression per (A, i, B). s_j says how long j of B takes, relative to its own mean,
while i of A runs; so it is stored as agent B, task j, other agent A, other task i.
Sandrini, Faroni, Pedrocchi, Learning Action Duration and Synergy in Task Planning for HRC (ETFA 2022).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from hrclog.analyzers.projections.overlaps import PAIR
from hrclog.analyzers.synergy.observations import Observations
from hrclog.analyzers.synergy.outlier_methods import Outliers, inliers
from hrclog.analyzers.synergy.pairs import in_seconds
from hrclog.arrays import FloatArray

_MET: Final = ("run_id", "execution_id", "other_agent")


@dataclass(frozen=True, slots=True)
class Regression:
    """One main task against the tasks of one other agent that it met.

    Attributes:
        keys: (agent, task, other agent, other task) of the row of each coefficient, (p,).
        x: shape (n, p), no zero column.
        y: shape (n,).
    """

    keys: tuple[tuple[str, str, str, str], ...]
    x: FloatArray
    y: FloatArray


def concurrent_shares(observations: Observations, outliers: Outliers) -> Iterator[Regression]:
    """Yield the regressions of the authors' code.

    Args:
        observations: what to learn from; of the other agent's executions those that succeeded count.
        outliers: which rows of each regression to leave out.
    """
    share = pl.col("overlap_s") / pl.col("other_duration_s")
    return _regressions(observations, outliers, pl.col("overlap_s"), share)


def own_shares(observations: Observations, outliers: Outliers) -> Iterator[Regression]:
    """Yield the regressions that the paper prints.

    Args:
        observations: what to learn from; of the other agent's executions those that succeeded count.
        outliers: which rows of each regression to leave out.
    """
    share = pl.col("overlap_s") / pl.col("duration_s")
    # of what an execution meets of one agent, by start: what reaches beyond all before it
    until = pl.col("from_ns") + pl.col("overlap_ns")
    further = (until - pl.max_horizontal("from_ns", until.cum_max().shift(1))).clip(0)
    # the time in which the other agent was busy, spread over the pairs of k, sums to y_k again
    met = in_seconds(further.sum().over(_MET)) / pl.len().over(_MET)
    return _regressions(observations, outliers, met, share)


def mean_durations(observations: Observations) -> dict[tuple[str, str], float]:
    """Return the mean duration in seconds of each (agent, task), over its successful executions."""
    good = observations.executions.filter(pl.col("finished") & (pl.col("duration_s") > 0))
    means = good.group_by("agent", "task").agg(pl.col("duration_s").sort().mean()).sort("agent", "task")
    return {(agent, task): mean for agent, task, mean in means.iter_rows()}


def _regressions(
    observations: Observations, outliers: Outliers, response: pl.Expr, share: pl.Expr
) -> Iterator[Regression]:
    useful = observations.meetings.filter("other_finished").sort(*_MET, "from_ns", "other_execution_id")
    terms = useful.with_columns(response.alias("response"), share.alias("share"))
    terms = terms.sort(*PAIR, "run_id", "execution_id", "other_execution_id")
    mean_of = mean_durations(observations)
    for (agent, task, other), part in terms.group_by("agent", "task", "other_agent", maintain_order=True):
        x, y, columns = _matrices(part, str(other), mean_of)
        kept = inliers(y, outliers)
        x, y = x[kept], y[kept]
        met_columns = np.flatnonzero(x.any(axis=0))
        if len(met_columns):
            keys = tuple((str(other), columns[column], str(agent), str(task)) for column in met_columns)
            yield Regression(keys, x[:, met_columns], y)


def _matrices(
    part: pl.DataFrame, other: str, mean_of: dict[tuple[str, str], float]
) -> tuple[FloatArray, FloatArray, list[str]]:
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
