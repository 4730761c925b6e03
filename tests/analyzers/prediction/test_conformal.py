"""Conformal widths: residuals that were held out by run, and what they cover."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from interval_frames import frame, row
from simulated_frames import simulated_frame

from hrclog.analyzers.prediction.conformal import FEWEST, FOLDS, conformal, held_out_residuals
from hrclog.analyzers.prediction.folds import folds
from hrclog.analyzers.prediction.settings import cross_validate
from hrclog.analyzers.synergy.aft import Aft, aft
from hrclog.analyzers.synergy.estimator import Estimator
from hrclog.analyzers.synergy.fit import Fit
from hrclog.analyzers.synergy.log_work import NormalLogWork, SampledLogWork
from hrclog.analyzers.synergy.observations import Observations, observe

pytestmark = pytest.mark.slow

S = 1_000_000_000
AFT = Aft()


def alone(log_durations: list[list[float]]) -> pl.DataFrame:
    """Return runs of one agent and one task, with these log durations."""
    found = []
    for run, values in enumerate(log_durations):
        start = run * 10_000 * S
        for number, value in enumerate(values):
            length = round(np.exp(value) * S)
            found.append(row("H", "h", start, start + length, run_id=f"run{run:03}", execution_id=f"{run}-{number}"))
            start += length
    return frame(found)


def test_residuals_are_against_the_mean_of_the_runs_in_other_folds() -> None:
    source = np.random.default_rng(4)
    values = {f"run{n:03}": source.normal(1 + n, 0.2, 3).tolist() for n in range(12)}
    expected = []
    for part in folds(values, FOLDS, 0):
        others = np.concatenate([values[run] for run in values if run not in part])
        expected += [value - others.mean() for run in part for value in values[run]]
    found = held_out_residuals(AFT, observe(alone(list(values.values()))))
    assert found[("H", "h")] == pytest.approx(np.sort(expected), abs=1e-6)


def test_no_residual_comes_from_a_fit_that_saw_its_run(monkeypatch: pytest.MonkeyPatch) -> None:
    intervals = simulated_frame(2, 11, {"H": {"a": (1.0, 0.2)}, "R": {"b": (1.2, 0.2)}}, per_agent=3)
    observations = observe(intervals)
    seen: list[set[str]] = []

    def spy(_: Estimator, some: Observations, outliers: str) -> Fit:
        seen.append(set(some.runs))
        return aft(some, outliers)

    monkeypatch.setattr(Aft, "fit", spy)
    held_out_residuals(AFT, observations)
    parts = folds(observations.runs, FOLDS, 0)
    assert seen == [set(observations.runs) - set(part) for part in parts]


@pytest.mark.parametrize(("n_runs", "kind"), [(FEWEST - 1, NormalLogWork), (FEWEST, SampledLogWork)])
def test_fewer_than_ten_residuals_keep_the_normal(n_runs: int, kind: type) -> None:
    source = np.random.default_rng(1)
    observations = observe(alone([[value] for value in source.normal(1, 0.3, n_runs)]))
    fit = aft(observations)
    [model] = conformal(AFT, fit, observations).models.values()
    assert isinstance(model.log_work, kind)
    assert model.log_factors == next(iter(fit.models.values())).log_factors


@pytest.mark.parametrize("n_runs", [1, 2])
def test_a_run_alone_has_no_residuals(n_runs: int) -> None:
    observations = observe(alone([[1.0] * 20] * n_runs))
    assert len(held_out_residuals(AFT, observations).get(("H", "h"), [])) == (0 if n_runs == 1 else 40)


def test_tasks_that_only_one_run_has_keep_the_normal() -> None:
    found = alone([[1.0, 1.1]] * 12)
    rare = frame([row("H", "rare", 10**15 + n, 10**15 + n + 9, run_id="run000") for n in range(20)])
    observations = observe(pl.concat([found, rare]))
    models = conformal(AFT, aft(observations), observations).models
    assert isinstance(models["H", "rare"].log_work, NormalLogWork)
    assert isinstance(models["H", "h"].log_work, SampledLogWork)


def test_failed_executions_have_no_residuals() -> None:
    intervals = alone([[1.0, 1.2, 3.0]] * 12).with_columns(
        outcome=pl.when(pl.col("execution_id").str.ends_with("-2")).then(pl.lit("failed")).otherwise("outcome")
    )
    assert len(held_out_residuals(AFT, observe(intervals))["H", "h"]) == 24


@pytest.mark.parametrize(
    "noise",
    [
        lambda source, n: source.normal(0, 0.2, n),
        lambda source, n: source.standard_t(2, n) * 0.1,
        lambda source, n: np.where(source.random(n) < 0.12, 1.5, 0.0) + source.normal(0, 0.02, n),
    ],
    ids=["normal", "heavy tails", "interrupted now and then"],
)
def test_intervals_cover_nine_in_ten_within_a_session_whatever_the_distribution(noise: object) -> None:
    source = np.random.default_rng(7)
    intervals = alone((1.5 + noise(source, 600)).reshape(60, 10).tolist())  # type: ignore[operator] - a function
    rows = cross_validate(intervals, estimators=["aft"]).executions
    assert rows.select(pl.col("observed_s").is_between("low_s", "high_s").mean()).item() == pytest.approx(
        0.9, abs=0.025
    )


def test_intervals_cover_nine_in_ten_of_executions_that_disturb_each_other() -> None:
    work = {"H": {"a": (1.5, 0.15), "b": (1.0, 0.3)}, "R": {"c": (1.6, 0.1), "d": (1.2, 0.2)}}
    factors = {("R", "c", "H", "a"): 2.5, ("H", "b", "R", "d"): 1.6}
    intervals = simulated_frame(3, 50, work, factors, per_agent=10)
    rows = cross_validate(intervals, estimators=["aft"]).executions
    assert rows.select(pl.col("observed_s").is_between("low_s", "high_s").mean()).item() == pytest.approx(
        0.9, abs=0.025
    )
    per_task = rows.group_by("task").agg(pl.col("observed_s").is_between("low_s", "high_s").mean().alias("hit"))
    assert per_task["hit"].min() > 0.84
