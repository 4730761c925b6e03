"""Durations against the published ones, and the fits against scipy's."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from interval_frames import Row, frame, row, rows
from scipy import special, stats

from hrclog.analyzers.projections import distributions
from hrclog.analyzers.projections.distributions import NAMES, fit_distributions
from hrclog.analyzers.projections.durations import durations, wilson
from hrclog.analyzers.projections.schemas import DURATIONS

if TYPE_CHECKING:
    from conftest import Runs

SECOND = 1_000_000_000


def test_the_published_durations_come_out_to_ten_nanoseconds(offline: Runs, data_dir: Path) -> None:
    published = json.loads((data_dir / "safety_areas" / "task_durations.json").read_text())
    found = {(one["agent"], one["task"]): one for one in durations(offline.intervals).to_dicts()}
    names = {
        "expected_duration": "mean_s", "duration_stddev": "std_s", "median": "median_s", "min": "min_s", "max": "max_s"
    }  # fmt: skip
    assert {(one["agent"], one["name"]) for one in published} == set(found)
    for one in published:
        ours = found[one["agent"], one["name"]]
        assert (ours["count"], ours["success_rate"]) == (one["counter"], one["success_rate"])
        assert {name: ours[name] for name in names.values()} == pytest.approx(
            {ours: one[theirs] for theirs, ours in names.items()}, abs=1e-8, rel=0
        )


def test_what_did_not_succeed_is_counted_and_never_averaged() -> None:
    outcomes = ("succeeded", "succeeded", "failed", "timed_out", "canceled", "skipped")
    rows = [row("A", "x", 0, (2 + number) * SECOND, outcome=outcome) for number, outcome in enumerate(outcomes)]
    rows.append(row("A", "x", 0, None, until_ns=900 * SECOND, outcome="unknown"))
    rows.append(row("A", "x", 0, 800 * SECOND, role="auxiliary"))
    found = durations(frame(rows)).to_dicts()[0]
    assert [found[name] for name in ("count", "n_failed", "n_canceled", "n_censored")] == [2, 2, 2, 1]
    assert (found["mean_s"], found["min_s"], found["max_s"], found["median_s"]) == (2.5, 2.0, 3.0, 2.5)
    assert found["success_rate"] == 0.5


@settings(max_examples=30)
@given(rows(max_size=14))
def test_every_execution_is_counted_once(found: list[Row]) -> None:
    # an end may tell no outcome
    found = [one | {"end_ns": one["until_ns"]} if number % 2 else one for number, one in enumerate(found)]
    counts = durations(frame(found)).select("count", "n_failed", "n_canceled", "n_censored").sum()
    assert sum(counts.row(0)) == sum(one["role"] != "auxiliary" for one in found)


def test_a_task_that_never_succeeded_has_counts_and_no_numbers() -> None:
    found = durations(frame([row("A", "x", 0, SECOND, outcome="failed")])).to_dicts()[0]
    assert (found["count"], found["n_failed"], found["success_rate"], found["success_low"]) == (0, 1, 0.0, 0.0)
    assert {found[name] for name in ("mean_s", "std_s", "median_s", "q25_s", "min_s", *NAMES)} == {None}


def test_a_single_execution_has_a_mean_and_no_deviation() -> None:
    found = durations(frame([row("A", "x", 0, 3 * SECOND)])).to_dicts()[0]
    assert (found["mean_s"], found["median_s"], found["std_s"], found["gamma_shape"]) == (3.0, 3.0, None, None)


def test_identical_durations_have_no_deviation_and_no_fit() -> None:
    found = durations(frame([row("A", "x", n, n + 3 * SECOND) for n in range(5)])).to_dicts()[0]
    assert (found["mean_s"], found["std_s"]) == (3.0, 0.0)
    assert {found[name] for name in NAMES} == {None}


def test_quartiles_interpolate_and_the_deviation_is_that_of_a_sample() -> None:
    lengths = np.array([2.0, 3.5, 4.0, 8.0, 9.25, 30.0])
    found = durations(frame([row("A", "x", 0, round(length * 1e9)) for length in lengths])).to_dicts()[0]
    assert (found["q25_s"], found["q75_s"]) == pytest.approx(tuple(np.quantile(lengths, (0.25, 0.75))))
    assert found["std_s"] == pytest.approx(lengths.std(ddof=1))


def test_no_executions_give_no_rows() -> None:
    assert durations(frame([])).schema == DURATIONS


@pytest.mark.parametrize(("family", "scale"), [("lognormal", 1.0), ("gamma", 1.0), ("gamma", 200.0)])
@pytest.mark.parametrize("seed", range(3))
def test_fits_are_the_maximum_likelihood_estimates_of_scipy(family: str, scale: float, seed: int) -> None:
    source = np.random.default_rng(seed)
    seconds = scale * (source.lognormal(1.5, 0.4, 60) if family == "lognormal" else source.gamma(7.0, 0.9, 60))
    found = fit_distributions(seconds)
    sigma, _, median = stats.lognorm.fit(seconds, floc=0)
    shape, _, gamma_scale = stats.gamma.fit(seconds, floc=0)
    expected = {
        "lognormal_mu": math.log(median),
        "lognormal_sigma": sigma,
        "lognormal_aic": 4 - 2 * stats.lognorm.logpdf(seconds, sigma, scale=median).sum(),
        "gamma_shape": shape,
        "gamma_scale_s": gamma_scale,
        "gamma_aic": 4 - 2 * stats.gamma.logpdf(seconds, shape, scale=gamma_scale).sum(),
    }
    assert found == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("spread", [1e-1, 1e-2, 1e-3, 1e-5, 1e-7, 1e-9])
def test_durations_that_hardly_differ_still_have_a_gamma_fit(spread: float) -> None:
    seconds = 5 + spread * np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    found = fit_distributions(seconds)
    # a gamma this narrow is a normal: shape = (mean / std)^2, and its AIC is the normal's
    assert found["gamma_shape"] == pytest.approx(25 / (2 * spread**2), rel=max(spread, 1e-4))
    normal = 4 - 2 * stats.norm.logpdf(seconds, 5, spread * math.sqrt(2)).sum()
    assert found["gamma_aic"] == pytest.approx(normal, abs=max(spread, 1e-3))
    assert found["lognormal_aic"] == pytest.approx(normal, abs=max(spread, 1e-3))


@pytest.mark.parametrize("shape", [100.0, 130.0, 300.0])
def test_the_series_for_large_shapes_continue_scipys_functions(shape: float) -> None:
    value, slope = distributions._log_minus_digamma(shape)
    assert value == pytest.approx(math.log(shape) - special.digamma(shape), rel=1e-10)
    assert slope == pytest.approx(1 / shape - special.polygamma(1, shape), rel=1e-9)
    rest = shape * math.log(shape) - shape - math.lgamma(shape)
    assert distributions._stirling_rest(shape) == pytest.approx(rest, rel=1e-11)


def test_durations_many_orders_apart_have_a_fit() -> None:
    found = fit_distributions(np.array([1e-9, 1.0, 1e9]))
    assert all(value is not None and math.isfinite(value) for value in found.values())


def test_the_wilson_interval_is_the_textbook_one() -> None:
    # 7 of 10: Wilson 1927, as in scipy.stats.binomtest(7, 10).proportion_ci(method="wilson")
    assert wilson(7, 10) == pytest.approx((0.7, 0.39677815, 0.89220873), abs=1e-8)
    interval = stats.binomtest(50, 51).proportion_ci(method="wilson")
    assert wilson(50, 51)[1:] == pytest.approx((interval.low, interval.high))
    assert wilson(0, 0) == (None, None, None)


@pytest.mark.parametrize("trials", [1, 5, 102, 10_000])
def test_the_wilson_interval_encloses_the_rate_within_zero_and_one(trials: int) -> None:
    for successes in (0, trials // 2, trials):
        rate, low, high = wilson(successes, trials)
        assert 0 <= low <= rate <= high <= 1
