"""What holds for every estimator, whatever it is given."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from interval_frames import Row, frame, random_runs, rows
from polars.testing import assert_frame_equal

from hrclog.analyzers.projections.schemas import SYNERGIES
from hrclog.analyzers.synergy.estimators import ESTIMATORS, YARDSTICKS
from hrclog.analyzers.synergy.fit import Fit
from hrclog.analyzers.synergy.log_work import SampledLogWork
from hrclog.analyzers.synergy.observations import observe
from hrclog.analyzers.synergy.outlier_methods import OUTLIER_METHODS, Outliers, inliers
from hrclog.analyzers.synergy.sampled_models import LEAST_FACTOR

pytestmark = pytest.mark.slow

SECOND = 1_000_000_000
ALL = {**ESTIMATORS, **YARDSTICKS}
QUICK = [name for name in ALL if name != "bayes"]
NUMBERS = ("synergy", "std_err", "ci_low", "ci_high")
FREE_NUMBERS = ("synergy_free", "free_std_err", "free_ci_low", "free_ci_high")

every = pytest.mark.parametrize("name", ALL)


def sensible(fit: Fit, found: list[Row]) -> None:
    """Assert that numbers are numbers, in order, and there only where their status says so."""
    table = fit.synergies
    assert table.schema == SYNERGIES
    counting = [one for one in found if one["role"] != "auxiliary" and not one["parent_execution_id"]]
    tasks = {(one["agent"], one["task"]) for one in counting}
    expected = sorted(one + other for one in tasks for other in tasks if one[0] != other[0])
    assert table.select("agent", "task", "other_agent", "other_task").rows() == expected
    for one in table.to_dicts():
        for value, *others in (NUMBERS, FREE_NUMBERS):
            numbers = [one[name] for name in (value, *others) if one[name] is not None]
            assert np.isfinite(numbers).all()
            assert one[value] is not None or not numbers
            if one[others[1]] is not None:
                assert one[others[1]] <= one[value] <= one[others[2]]
                assert one[others[0]] >= 0
        assert (one["n"] == 0) == (one["overlap_s"] == 0.0)
        assert (one["n"] == 0) == (one["status"] == "unobserved")
        if one["status"] in ("unobserved", "no_success"):
            assert (one["synergy"], one["synergy_free"]) == (None, None)
        if one["status"] in ("ok", "sparse"):
            assert one["synergy"] is not None
            assert one["status"] == "sparse" or one["n"] >= 5
    finished = {
        (one["agent"], one["task"])
        for one in counting
        if one["outcome"] == "succeeded" and one["end_ns"] is not None and one["end_ns"] > one["start_ns"]
    }
    assert set(fit.models) == finished
    for model in fit.models.values():
        quantiles = model.log_work.quantile(np.array([0.05, 0.5, 0.95]))
        assert np.isfinite([*quantiles, *model.log_factors.values()]).all()
        assert (np.diff(quantiles) >= 0).all()


@pytest.mark.parametrize("name", QUICK)
@settings(max_examples=25)
@given(found=rows(max_size=14, scale=SECOND))
def test_any_few_executions_give_numbers_that_make_sense_or_none(name: str, found: list[Row]) -> None:
    sensible(ALL[name].fit(observe(frame(found)), "none"), found)


@settings(max_examples=8)
@given(found=rows(max_size=14, scale=SECOND))
def test_any_few_executions_give_bayes_numbers_that_make_sense_or_none(found: list[Row]) -> None:
    sensible(ALL["bayes"].fit(observe(frame(found)), "none"), found)


@every
@pytest.mark.parametrize("outliers", OUTLIER_METHODS)
@pytest.mark.parametrize("agents", ["H", "HR", "HRS"])
def test_random_runs_give_numbers_that_make_sense(name: str, outliers: Outliers, agents: str) -> None:
    found = random_runs(1, n_runs=4, per_agent=5, tasks=2, agents=agents, overlap_itself="R")
    sensible(ALL[name].fit(observe(frame(found)), outliers), found)


@every
def test_the_estimator_is_named_in_its_rows(name: str) -> None:
    table = ALL[name].fit(observe(frame(random_runs(1, n_runs=2))), "none").synergies
    assert set(table["estimator"]) == {name}


@every
def test_estimates_do_not_depend_on_the_order_of_rows(name: str) -> None:
    intervals = frame(random_runs(2, n_runs=4))
    mixed = intervals.sample(fraction=1.0, shuffle=True, seed=1)
    tables = [ALL[name].fit(observe(one), "none").synergies for one in (intervals, mixed)]
    assert_frame_equal(*tables, check_exact=True)


def test_the_default_comes_first() -> None:
    assert list(ESTIMATORS) == ["aft", "bayes", "ols", "paper"]
    assert list(YARDSTICKS) == ["mean"]


def test_the_yardstick_knows_no_effect_and_no_error() -> None:
    found = random_runs(1, n_runs=4)
    fit = YARDSTICKS["mean"].fit(observe(frame(found)), "none")
    seen = [one for one in fit.synergies.to_dicts() if one["n"]]
    assert {(one["synergy"], one["synergy_free"]) for one in seen} == {(1.0, 1.0)}
    assert {one["std_err"] for one in seen} == {None}
    for (agent, task), model in fit.models.items():
        durations = [
            (one["end_ns"] - one["start_ns"]) / 1e9
            for one in found
            if (one["agent"], one["task"], one["outcome"]) == (agent, task, "succeeded")
        ]
        assert isinstance(model.log_work, SampledLogWork)
        np.testing.assert_allclose(sorted(model.log_work.values), np.log(sorted(durations)), rtol=1e-12)


def test_models_of_regressions_take_work_off_by_their_factors() -> None:
    found = random_runs(3, n_runs=6, tasks=2)
    fit = ESTIMATORS["ols"].fit(observe(frame(found)), "none")
    table = {
        (one["agent"], one["task"], one["other_agent"], one["other_task"]): one for one in fit.synergies.to_dicts()
    }
    for key, model in fit.models.items():
        for other, log_factor in model.log_factors.items():
            assert log_factor == pytest.approx(math.log(max(table[*key, *other]["synergy"], LEAST_FACTOR)))
        works = []
        for own in found:
            if (own["agent"], own["task"], own["outcome"]) != (*key, "succeeded"):
                continue
            idle, work = own["end_ns"] - own["start_ns"], 0.0
            for one in found:
                shared = min(own["end_ns"], one["end_ns"]) - max(own["start_ns"], one["start_ns"])
                if one["run_id"] == own["run_id"] and one["agent"] != own["agent"] and shared > 0:
                    idle -= shared
                    work += shared / math.exp(model.log_factors.get((one["agent"], one["task"]), 0.0))
            works.append(math.log((idle + work) / 1e9))
        assert isinstance(model.log_work, SampledLogWork)
        np.testing.assert_allclose(sorted(model.log_work.values), sorted(works), rtol=1e-9)


@pytest.mark.parametrize(
    "values", [[3.0] * 40, [3.0, 3.0], [0.0] * 5, [1.0], [], [1.0, 2.0], [1.0] * 9 + [1.0 + 1e-15]]
)
def test_some_rows_are_always_kept(values: list[float]) -> None:
    kept = inliers(np.array(values), "isolation-forest")
    assert kept.dtype == np.bool_
    assert kept.shape == (len(values),)
    assert kept.any() or not values


def test_the_forest_leaves_out_what_lies_far_from_the_rest() -> None:
    values = np.append(np.random.default_rng(0).normal(5, 0.1, 60), [50.0, 0.01])
    kept = inliers(values, "isolation-forest")
    assert not kept[-2:].any()
    assert kept[:-2].mean() > 0.5
    assert inliers(values, "none").all()
