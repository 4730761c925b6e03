"""Estimates against the truth that only a simulator knows: bias, spread and coverage of 95 % intervals.

What is compared, per ordered pair of tasks that the estimator gives a number for:

    beside  the mean duration of the task, were the other's task running all the time: synergy times mean duration,
            against exp(mu + sigma^2 / 2) s
    free    the factor on undisturbed work: synergy_free, against s
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, Final

import numpy as np
import polars as pl

from hrclog.analyzers.projections.overlaps import PAIR
from hrclog.analyzers.synergy.fit import Fit
from hrclog.analyzers.synergy.observations import Observations
from hrclog.analyzers.synergy.regression import mean_durations
from hrclog.errors import HrclogError

STRONG: Final = 1.8
"""Couplings from here on are reported apart: they are what planning with synergies is for."""

TRUE_PAIRS: Final = pl.Schema(dict.fromkeys(PAIR, pl.String()) | {"s": pl.Float64(), "beside_s": pl.Float64()})
"""One row per ordered pair of tasks: the factor on undisturbed work, and the mean duration beside the other in s."""


def true_pairs(
    tasks: Iterable[tuple[str, str, float | None, float | None]],
    factors: Iterable[tuple[str, str, str, str, float | None]],
) -> pl.DataFrame:
    """Lay out a truth.

    Args:
        tasks: agent, task, mu and sigma of log work in seconds; None for tasks whose work nobody has seen.
        factors: agent, task, other agent, other task, s; pairs with None (a full stop, or not seen) are left out, like
            those of a task without its work.

    Returns:
        A frame of schema `TRUE_PAIRS`.

    Raises:
        HrclogError: a factor is of a task that is not among the tasks.
    """
    work_s = {(agent, task): _mean_work_s(mu, sigma) for agent, task, mu, sigma in tasks}
    factors = list(factors)
    unknown = [(agent, task) for agent, task, *_ in factors if (agent, task) not in work_s]
    if unknown:
        agent, task = unknown[0]
        raise HrclogError(
            f"the truth gives a factor of {task!r} by {agent!r} without its work; expected the truth.json that"
            " was written beside the logs, unchanged"
        )
    rows = [
        (agent, task, other, other_task, s, alone_s * s)
        for agent, task, other, other_task, s in factors
        if s is not None and (alone_s := work_s[agent, task]) is not None
    ]
    return pl.DataFrame(rows, schema=TRUE_PAIRS, orient="row")


def pair_errors(fit: Fit, observations: Observations, truth: pl.DataFrame) -> pl.DataFrame:
    """Return relative errors per pair and kind of estimate.

    Args:
        fit: what an estimator made of the observations.
        observations: what it was fitted to.
        truth: schema `TRUE_PAIRS`.

    Returns:
        Columns agent, task, other_agent, other_task, s, kind (beside or free), error (estimate / truth - 1), covered
        (whether the 95 % interval holds the truth; null without an interval). Pairs without a number have no row.

    Raises:
        HrclogError: not one pair of tasks is in both.
    """
    table = fit.synergies.join(truth, on=PAIR, how="inner", maintain_order="left")
    if table.is_empty() and not fit.synergies.is_empty():
        names = ", ".join(repr(agent) for agent in fit.synergies["agent"].unique().sort())
        raise HrclogError(
            f"the truth knows none of the pairs of tasks in the logs (agents {names}); expected the truth.json that"
            " was written beside them"
        )
    means = pl.DataFrame(
        [(*key, mean_s) for key, mean_s in mean_durations(observations).items()],
        schema={"agent": pl.String, "task": pl.String, "mean_s": pl.Float64},
        orient="row",
    )
    table = table.join(means, on=["agent", "task"], how="left", maintain_order="left")
    scale = pl.col("mean_s") / pl.col("beside_s")
    beside = _errors(table, "beside", scale, "synergy", "ci_low", "ci_high")
    free = _errors(table, "free", 1 / pl.col("s"), "synergy_free", "free_ci_low", "free_ci_high")
    return pl.concat([beside, free])


def truth_figures(errors: pl.DataFrame) -> dict[str, Any]:
    """Sum up relative errors.

    Args:
        errors: what `pair_errors` returned, of one or more data sets.

    Returns:
        Per kind, over all pairs and over those with s >= `STRONG` ("beside", "beside_strong", "free", "free_strong"):
        bias, rmse, coverage95 and n; null where there is nothing to say.
    """
    strong = errors.filter(pl.col("s") >= STRONG)
    return {
        f"{kind}{name}": _summary(rows.filter(pl.col("kind") == kind))
        for kind in ("beside", "free")
        for name, rows in (("", errors), ("_strong", strong))
    }


def _mean_work_s(mu: float | None, sigma: float | None) -> float | None:
    return None if mu is None or sigma is None else math.exp(mu + sigma**2 / 2)


def _errors(table: pl.DataFrame, kind: str, scale: pl.Expr, value: str, low: str, high: str) -> pl.DataFrame:
    inside = (pl.col(low) * scale <= 1) & (pl.col(high) * scale >= 1)
    return table.filter(pl.col(value).is_not_null()).select(
        *PAIR, "s", pl.lit(kind).alias("kind"), (pl.col(value) * scale - 1).alias("error"), inside.alias("covered")
    )


def _summary(rows: pl.DataFrame) -> dict[str, Any]:
    error = rows["error"].to_numpy()
    covered = rows["covered"].drop_nulls().to_numpy()
    return {
        "bias": float(error.mean()) if len(error) else None,
        "rmse": float(np.sqrt((error**2).mean())) if len(error) else None,
        "coverage95": float(covered.mean()) if len(covered) else None,
        "n": len(error),
    }
