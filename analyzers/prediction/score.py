"""How good predictions were: errors, proper scores and coverage, with bootstrap intervals of their differences."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import polars as pl

from hrclog.analyzers.prediction.settings import Predictions
from hrclog.arrays import FloatArray
from hrclog.errors import HrclogError
from hrclog.wording import counted

_DRAWS: Final = 2000
_SEED: Final = 0
_WINDOW: Final = 5  # runs


@dataclass(frozen=True, slots=True)
class Score:
    """The figures of one set of predictions, as plain values; see docs/scoring.md.

    Attributes:
        setting: cv, static or prequential.
        estimators: per estimator its figures over all test executions, and under "agents" those of each agent.
        comparisons: per other estimator, how much lower the CRPS of the first one is.
        n_train_runs: what was learnt from before the first test run; with cv that of the largest fold.
        n_test_runs: how many runs were predicted.
        n_executions: how many executions there were to predict.
        truth: per estimator its errors against a known truth, if one was given.
    """

    setting: str
    estimators: dict[str, dict[str, Any]]
    comparisons: list[dict[str, Any]]
    n_train_runs: int
    n_test_runs: int
    n_executions: int
    truth: dict[str, dict[str, Any]] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the machine-readable result."""
        result: dict[str, Any] = {
            "setting": self.setting,
            "estimators": self.estimators,
            "comparisons": self.comparisons,
            "n_train_runs": self.n_train_runs,
            "n_test_runs": self.n_test_runs,
            "n_executions": self.n_executions,
        }
        return result | ({"truth": self.truth} if self.truth else {})

    def to_json(self) -> str:
        """Return `to_dict` as JSON text."""
        return json.dumps(self.to_dict(), ensure_ascii=False, indent=2, allow_nan=False)


def score(predictions: Predictions) -> Score:
    """Sum up predictions.

    Args:
        predictions: of one or more estimators, over the same runs.

    Raises:
        HrclogError: nothing could be predicted.
    """
    if predictions.executions.is_empty():
        raise HrclogError(
            f"none of {counted(predictions.n_executions, 'successful execution')} could be predicted; expected some of "
            "a task that succeeded in other runs: give more runs to learn from"
        )
    rows = predictions.executions.with_columns(
        pl.col("observed_s").is_between("low_s", "high_s").alias("covered"),
        (pl.col("median_s") - pl.col("observed_s")).abs().alias("absolute"),
        ((pl.col("mean_s") - pl.col("observed_s")) ** 2).alias("square"),
    )
    per_run = _per_run(rows, predictions.runs)
    estimators = {
        name: _figures(part)
        | _interval_of_crps(per_run[name])
        | _makespan(predictions.makespans.filter(pl.col("estimator") == name))
        | _windows(per_run[name], predictions.setting)
        | {"calibrated": name in predictions.calibrated, "n": part.height}
        | {"agents": {str(agent): _figures(rows) | {"n": rows.height} for (agent,), rows in _group_by(part, "agent")}}
        for (name,), part in _group_by(rows, "estimator")
    }
    names = list(estimators)
    return Score(
        predictions.setting,
        estimators,
        [_comparison(names[0], name, per_run) for name in names[1:]],
        predictions.n_train_runs,
        len(predictions.runs),
        predictions.n_executions,
    )


def _group_by(rows: pl.DataFrame, column: str) -> Iterator[tuple[tuple[Any, ...], pl.DataFrame]]:
    ordered = rows if column == "estimator" else rows.sort(column, maintain_order=True)
    yield from ordered.group_by(column, maintain_order=True)


def _figures(rows: pl.DataFrame) -> dict[str, Any]:
    """Return the scores over some executions of one estimator, n >= 1."""
    return {
        "mae_s": _mean(rows["absolute"]),
        "rmse_s": float(np.sqrt(_mean(rows["square"]))),
        "crps_s": _mean(rows["crps_s"]),
        "coverage90": _mean(rows["covered"]),
        "interval_score_s": _mean(rows["interval_score_s"]),
        "log_likelihood": _mean(rows["log_density"]),
    }


def _mean(values: pl.Series) -> float:
    return float(np.mean(values.to_numpy()))


def _per_run(rows: pl.DataFrame, runs: list[str]) -> dict[str, FloatArray]:
    """Return per estimator and run: sum of CRPS, number covered, number of executions; shape (runs, 3)."""
    index = pl.DataFrame({"run_id": runs}, schema={"run_id": pl.String})
    sums = rows.group_by("estimator", "run_id").agg(pl.col("crps_s").sort().sum(), pl.col("covered").sum(), pl.len())
    return {
        str(name): index.join(part, on="run_id", how="left", maintain_order="left")
        .select("crps_s", "covered", "len")
        .fill_null(0)
        .to_numpy()
        .astype(np.float64)
        for (name,), part in sums.group_by("estimator")
    }


def _draws(runs: int) -> FloatArray:
    """Return how often each run is drawn, shape (draws, runs)."""
    generator = np.random.default_rng(_SEED)
    return generator.multinomial(runs, np.full(runs, 1 / runs), _DRAWS).astype(np.float64)


def _interval_of_crps(per_run: FloatArray) -> dict[str, Any]:
    """Return the 95 % interval of the mean CRPS by a bootstrap of runs; null for a single run."""
    if len(per_run) < 2:
        return {"crps_low_s": None, "crps_high_s": None}
    sums = _draws(len(per_run)) @ per_run
    sums = sums[sums[:, 2] > 0]  # draws of runs without executions have no mean
    low, high = np.quantile(sums[:, 0] / sums[:, 2], (0.025, 0.975))
    return {"crps_low_s": float(low), "crps_high_s": float(high)}


def _comparison(first: str, other: str, per_run: dict[str, FloatArray]) -> dict[str, Any]:
    """Return 1 - CRPS of the first / CRPS of the other, with its 95 % interval by a bootstrap of runs."""
    first_sums, other_sums = per_run[first], per_run[other]

    def reduction(weights: FloatArray) -> FloatArray:
        a, b = weights @ first_sums, weights @ other_sums
        return 1 - _ratio(a[:, 0] * b[:, 2], b[:, 0] * a[:, 2])

    result: dict[str, Any] = {
        "estimator": first,
        "other": other,
        "crps_reduction": float(reduction(np.ones((1, len(first_sums))))[0]),
        "low": None,
        "high": None,
    }
    if len(first_sums) > 1:
        result["low"], result["high"] = np.quantile(reduction(_draws(len(first_sums))), (0.025, 0.975)).tolist()
    return result


def _ratio(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a / b, 1 where b is 0: nothing to predict, or both without error."""
    return np.divide(a, b, out=np.ones_like(a), where=b != 0)


def _makespan(rows: pl.DataFrame) -> dict[str, Any]:
    """Return the errors of predicted makespans; null where no run could be predicted."""
    error = (rows["predicted_s"] - rows["observed_s"]).to_numpy()
    known = len(error) > 0
    return {
        "makespan_mae_s": float(np.abs(error).mean()) if known else None,
        "makespan_bias_s": float(error.mean()) if known else None,
        "makespan_n": len(error),
    }


def _windows(per_run: FloatArray, setting: str) -> dict[str, Any]:
    """Return the lowest coverage of five runs in a row, where runs are in order."""
    if setting != "prequential" or len(per_run) < _WINDOW:
        return {}
    sums = np.lib.stride_tricks.sliding_window_view(per_run, _WINDOW, axis=0).sum(axis=-1)
    return {"coverage90_worst_five_runs": float(_ratio(sums[:, 1], sums[:, 2]).min())}
