"""`bayes` against the published numbers, against grids, and against a random walk."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from interval_frames import frame, random_runs, row
from polars.testing import assert_frame_equal
from scipy import integrate
from sizes import many

from hrclog.analyzers.synergy import bayes as module
from hrclog.analyzers.synergy.bayes import Posterior, bayes, log_upper_gamma, posterior
from hrclog.analyzers.synergy.observations import observe
from hrclog.analyzers.synergy.regression import concurrent_shares
from hrclog.arrays import FloatArray

if TYPE_CHECKING:
    from conftest import Runs

SECOND = 1_000_000_000

LogDensity = Callable[[FloatArray], FloatArray]


# --- the published numbers ---


def test_the_published_synergies_are_met(offline: Runs, data_dir: Path) -> None:
    published = {
        (one["agent"], one["agent_skill"], one["concurrent_agent"], one["concurrent_skill"]): one
        for one in json.loads((data_dir / "safety_areas" / "task_synergies.json").read_text())
    }
    table = bayes(observe(offline.intervals)).synergies
    found = {(one["agent"], one["task"], one["other_agent"], one["other_task"]): one for one in table.to_dicts()}
    assert found.keys() == published.keys()
    assert len(found) == 32
    for key, theirs in published.items():
        ours = found[key]
        assert ours["n"] == theirs["counter"]
        assert ours["synergy"] == pytest.approx(theirs["dynamic_risk"], abs=0.02)
        assert ours["std_err"] == pytest.approx(theirs["std_err"], rel=0.1, abs=0.03)
        assert ours["ci_low"] < ours["synergy"] < ours["ci_high"]
        assert ours["status"] == ("ok" if ours["n"] >= 5 else "sparse")
        assert ours["synergy_free"] is None


def test_the_sample_of_the_published_runs_counts(offline: Runs) -> None:
    for one in concurrent_shares(observe(offline.intervals), "none"):
        assert posterior(one.x, one.y).efficiency > 0.4


# --- moments ---


def sampled(seed: int, n: int, p: int, spread: float, scale: float = 3.0) -> tuple[FloatArray, FloatArray]:
    source = np.random.default_rng(seed)
    x = source.gamma(2.0, scale / 2, (n, p)) * (source.random((n, p)) < 0.8)
    x[:, ~x.any(axis=0)] = scale
    return x, x @ np.exp(0.4 * source.normal(size=p)) + spread * source.normal(size=n)


def log_posterior(x: FloatArray, y: FloatArray) -> LogDensity:
    """Return the log density of log s with sigma integrated out by brute force."""
    n = len(y)
    sigma = np.geomspace(1e-5, 2.0, 5000)
    squares = np.geomspace(1e-10, 1e8, 1500)
    exponent = -n * np.log(sigma) - 0.5 * squares[:, None] / sigma**2
    top = exponent.max(axis=1)
    table = top + np.log(integrate.trapezoid(np.exp(exponent - top[:, None]), sigma, axis=1))

    def density(log_s: FloatArray) -> FloatArray:
        residual = y - np.exp(log_s) @ x.T
        found = (residual**2).sum(axis=-1) + n * module._RESOLUTION_S**2
        return np.interp(np.log(found), np.log(squares), table) - 0.5 * (log_s**2).sum(axis=-1) / 0.25

    return density


def on_a_grid(x: FloatArray, y: FloatArray, points: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return mean, deviation, and both quantiles of s by a grid; one of several dimensions goes where the mass is."""
    p = x.shape[1]
    density = log_posterior(x, y)
    low, high = np.full(p, -3.5), np.full(p, 3.5)
    for _ in range(1 if p == 1 else 3):
        axes = [np.linspace(a, b, points) for a, b in zip(low, high, strict=True)]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, p)
        weight = density(grid)
        weight = np.exp(weight - weight.max())
        weight /= weight.sum()
        center = weight @ grid
        deviation = np.sqrt(weight @ (grid - center) ** 2) + (high - low) / points
        low, high = np.maximum(low, center - 9 * deviation), np.minimum(high, center + 9 * deviation)
    s = np.exp(grid)
    mean = weight @ s
    ends = []
    for number, axis in enumerate(axes):
        marginal = weight.reshape((points,) * p).sum(axis=tuple(k for k in range(p) if k != number))
        ends.append(np.interp([0.025, 0.975], np.cumsum(marginal) - marginal / 2, np.exp(axis)))
    return mean, np.sqrt(weight @ (s - mean) ** 2), *np.array(ends).T


def agrees(found: Posterior, x: FloatArray, y: FloatArray, points: int) -> None:
    mean, deviation, low, high = on_a_grid(x, y, points)
    assert (np.abs(found.mean - mean) < 0.03 * deviation).all(), (found.mean, mean, deviation)
    np.testing.assert_allclose(
        np.sqrt(np.diag(found.covariance)), deviation, rtol=0.06
    )  # with three rows tails reach far
    assert (np.abs(found.low - low) < 0.08 * deviation).all()
    assert (np.abs(found.high - high) < 0.08 * deviation).all()


# the residuals of spread 6 are far beyond the bound of sigma, 2
@pytest.mark.slow
@pytest.mark.parametrize("spread", [0.02, 0.5, 2.0, 6.0])
@pytest.mark.parametrize("n", [1, 2, 3, 10, 200])
def test_one_coefficient_agrees_with_a_grid(n: int, spread: float) -> None:
    x, y = sampled(n, n, 1, spread)
    agrees(posterior(x, y), x, y, 100_000)


@pytest.mark.slow
@pytest.mark.parametrize("spread", [0.3, 2.0, 6.0])
@pytest.mark.parametrize("n", [1, 2, 4, 30])
def test_two_coefficients_agree_with_a_grid(n: int, spread: float) -> None:
    x, y = sampled(100 + n, n, 2, spread)
    agrees(posterior(x, y), x, y, 200)


def test_columns_that_cannot_be_told_apart_share() -> None:
    x, y = sampled(5, 20, 1, 1.0)
    x = np.hstack([x, x])
    found = posterior(x, 2 * y)
    agrees(found, x, 2 * y, 200)
    assert found.mean[0] == pytest.approx(found.mean[1], rel=0.02)
    deviation = np.sqrt(np.diag(found.covariance))
    assert found.covariance[0, 1] / deviation.prod() < -0.7


def test_a_column_without_effect_keeps_its_prior() -> None:
    x, y = sampled(5, 20, 1, 0.5)
    found = posterior(np.hstack([x, 1e-9 * x]), y)
    assert found.mean[1] == pytest.approx(math.exp(0.125), rel=0.01)
    assert math.sqrt(found.covariance[1, 1]) == pytest.approx(math.exp(0.125) * math.sqrt(math.expm1(0.25)), rel=0.03)


@pytest.mark.parametrize("n", [2, 50])
def test_identical_durations_give_their_factor(n: int) -> None:
    found = posterior(np.full((n, 1), 4.0), np.full(n, 6.0))
    assert np.isfinite([found.mean[0], found.low[0], found.high[0], found.covariance[0, 0]]).all()
    assert found.low[0] < 1.5 < found.high[0]
    assert found.mean[0] == pytest.approx(1.5, abs=0.2 if n == 2 else 1e-4)


@pytest.mark.parametrize("unit", [1e-9, 1e-3, 3600.0])
def test_durations_of_any_length_have_moments(unit: float) -> None:
    x, y = sampled(3, 20, 2, 0.3)
    found = posterior(unit * x, unit * y)
    assert np.isfinite([*found.mean, *found.low, *found.high, *found.covariance.ravel()]).all()
    assert (found.low < found.mean).all()
    assert (found.mean < found.high).all()
    if unit < 1e-6:  # with so little to go by, the prior is what is known
        np.testing.assert_allclose(found.mean, math.exp(0.125), rtol=0.05)


def test_the_order_of_rows_and_columns_does_not_matter() -> None:
    x, y = sampled(3, 40, 3, 0.5)
    found = posterior(x, y)
    order = np.random.default_rng(0).permutation(40)
    mixed = posterior(x[order], y[order])
    np.testing.assert_allclose(mixed.mean, found.mean, rtol=1e-6)
    turned = posterior(x[:, ::-1], y)
    np.testing.assert_allclose(turned.mean[::-1], found.mean, rtol=2e-3)


def walked(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and deviation of s from many long random walks."""
    source = np.random.default_rng(0)
    density = log_posterior(x, y)
    p = x.shape[1]
    log_s = np.log(np.linalg.lstsq(x, y)[0].clip(0.1))
    scaled = x * np.exp(log_s)
    step = np.linalg.inv(scaled.T @ scaled / 0.3**2 + 4 * np.eye(p))
    root = 2.38 / math.sqrt(p) * np.linalg.cholesky(step)
    here = np.repeat(log_s[None], 150, axis=0)
    value, total, squares = density(here), np.zeros(p), np.zeros(p)
    burn, count = 400, 2000
    for number in range(burn + count):
        there = here + source.normal(size=here.shape) @ root.T
        new = density(there)
        moved = np.log(source.random(len(here))) < new - value
        here[moved], value[moved] = there[moved], new[moved]
        if number >= burn:
            total += np.exp(here).mean(axis=0)
            squares += np.exp(2 * here).mean(axis=0)
    mean = total / count
    return mean, np.sqrt(squares / count - mean**2)


@pytest.mark.slow
def test_twenty_coefficients_agree_with_a_random_walk() -> None:
    x, y = sampled(9, 80, 20, 0.3)
    found = posterior(x, y)
    mean, deviation = walked(x, y)
    assert found.efficiency > 0.2
    assert (np.abs(found.mean - mean) < 0.06 * deviation).all()
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), deviation, rtol=0.06)


# --- what is rough is not told ---


@pytest.mark.slow
@pytest.mark.parametrize(("n", "p"), [(6, 10), (11, 20), (many(14, fuzz=31), many(26, fuzz=60))])
def test_more_coefficients_than_rows_do_not_fail(n: int, p: int) -> None:
    for spread in (0.01, 2.0):
        found = posterior(*sampled(p, n, p, spread))
        assert 0 < found.efficiency <= 1
        assert np.isfinite(found.mean).all()


def test_moments_of_a_sample_that_hardly_counts_are_not_told(monkeypatch: pytest.MonkeyPatch) -> None:
    observations = observe(frame(random_runs(1, n_runs=10)))
    assert bayes(observations).synergies["synergy"].null_count() == 0

    def rough(x: FloatArray, y: FloatArray) -> Posterior:
        exact = posterior(x, y)
        return Posterior(exact.mean, exact.low, exact.high, exact.covariance, exact.log_deviation, 0.005)

    monkeypatch.setattr(module, "posterior", rough)
    found = bayes(observations)
    assert set(found.synergies["status"]) == {"weakly_identified"}
    for name in ("synergy", "std_err", "ci_low", "ci_high"):
        assert found.synergies[name].null_count() == found.synergies.height
    assert all(np.isnan(one.matrix).all() for one in found.covariances)
    assert all(model.log_factors == {} for model in found.models.values())


@pytest.mark.slow
def test_few_runs_of_many_tasks_give_numbers_that_make_sense_or_none() -> None:
    table = bayes(observe(frame(random_runs(1, n_runs=3, per_agent=12, tasks=12)))).synergies
    assert set(table["status"]) <= {"ok", "sparse", "weakly_identified", "no_success", "unobserved"}
    for one in table.to_dicts():
        told = one["synergy"] is not None
        assert told or one["status"] in ("weakly_identified", "no_success", "unobserved")
        assert not told or (0 < one["ci_low"] < one["synergy"] < one["ci_high"] and one["std_err"] > 1e-4)


@pytest.mark.slow
def test_the_same_data_give_the_same_numbers() -> None:
    intervals = frame(random_runs(2, n_runs=10))
    first = bayes(observe(intervals)).synergies
    assert_frame_equal(first, bayes(observe(intervals)).synergies, check_exact=True)
    mixed = observe(intervals.sample(fraction=1.0, shuffle=True, seed=3))
    assert_frame_equal(first, bayes(mixed).synergies, check_exact=True)


def test_one_pair_and_none() -> None:
    pair = [row("H", "h", 0, 4 * SECOND), row("R", "r", 2 * SECOND, 6 * SECOND)]
    found = bayes(observe(frame(pair))).synergies.to_dicts()
    assert [(one["status"], one["n"]) for one in found] == [("sparse", 1)] * 2
    assert all(0.3 < one["ci_low"] < one["synergy"] < one["ci_high"] < 3 for one in found)
    for nothing in ([], pair[:1]):
        assert bayes(observe(frame(nothing))).synergies.height == 0


def test_what_is_the_prior_and_little_else_is_weakly_identified() -> None:
    brief = [
        one for run in range(8) for one in (row("H", "h", 0, 1, run_id=f"{run}"), row("R", "r", 0, 2, run_id=f"{run}"))
    ]
    found = bayes(observe(frame(brief))).synergies.to_dicts()
    assert [(one["status"], one["n"]) for one in found] == [("weakly_identified", 8)] * 2
    assert all(one["ci_low"] < 0.5 and one["ci_high"] > 2 for one in found)


# --- the incomplete gamma function ---

SHAPES = (0.5, 1.0, 1.5, 2.0, 7.5, 24.5, 150.0, 1000.0, 2e4)


def integrated(shape: float, x: float) -> float:
    """Return log Gamma(a, x) by Gauss-Legendre from x, or from its peak, to where nothing is left."""
    peak = max(x, shape - 1)
    width = max(min(1 / max(1 - (shape - 1) / peak, 1e-12), 12 * math.sqrt(shape)), 1.0)
    top = (shape - 1) * math.log(peak) - peak
    nodes, weights = np.polynomial.legendre.leggauss(60)
    edges = np.concatenate(
        [np.geomspace(x, peak, 200)[:-1] if x < peak else [], peak + np.linspace(0, 60 * width, 400)]
    )
    middle, half = 0.5 * (edges[1:] + edges[:-1])[:, None], 0.5 * np.diff(edges)[:, None]
    t = middle + half * nodes
    return top + math.log(float((np.exp((shape - 1) * np.log(t) - t - top) * weights * half).sum()))


@pytest.mark.parametrize("shape", SHAPES)
def test_the_upper_gamma_function_is_the_integral(shape: float) -> None:
    x = shape * np.array([0.1, 0.5, 0.9, 1.0, 1.05, 1.2, 2.0, 5.0, 50.0, 1000.0])
    expected = [integrated(shape, one) for one in x.tolist()]
    np.testing.assert_allclose(log_upper_gamma(shape, x), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_upper_gamma_function_obeys_its_recurrence_on_both_sides_of_the_switch(shape: float) -> None:
    x = np.concatenate([np.geomspace(1e-6, 1e6, 60), shape + np.linspace(550, 800, 40)])
    left = log_upper_gamma(shape + 1, x.copy())
    right = np.logaddexp(log_upper_gamma(shape, x.copy()) + math.log(shape), shape * np.log(x) - x)
    np.testing.assert_allclose(left, right, rtol=1e-9, atol=1e-9)
    assert (np.diff(log_upper_gamma(shape, np.sort(x))) <= 1e-9).all()


def test_known_values_of_the_upper_gamma_function() -> None:
    x = np.array([1e-3, 1.0, 30.0, 700.0, 1e5])
    np.testing.assert_allclose(log_upper_gamma(1.0, x.copy()), -x, rtol=1e-12)
    np.testing.assert_allclose(log_upper_gamma(2.0, x.copy()), np.log1p(x) - x, rtol=1e-12, atol=1e-12)
    # the exponential integral lies between exp(-x) log(1 + 2 / x) / 2 and exp(-x) log(1 + 1 / x)
    none = log_upper_gamma(0.0, x.copy())
    assert (np.log(0.5 * np.log1p(2 / x)) - x < none).all()
    assert (none < np.log(np.log1p(1 / x)) - x).all()
