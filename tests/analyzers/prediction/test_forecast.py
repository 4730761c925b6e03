"""Scoring rules against closed forms and integrals, and the density of a forecast."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from interval_frames import frame, row
from scipy.stats import norm

from hrclog.analyzers.prediction.forecast import score_forecast
from hrclog.analyzers.prediction.scoring_rules import HIGH, LEVELS, LOW, crps, interval_score
from hrclog.analyzers.prediction.timelines import Timeline, Timelines
from hrclog.analyzers.synergy.log_work import LogWork, NormalLogWork, SampledLogWork, StudentLogWork

S = 1_000_000_000
ALONE = Timeline(np.array([0.0]), np.array([0.0]), np.array([]))


def busy() -> Timeline:
    """Return a timeline with segments of log factors 0, 0.7, 1.1 + 0.7, 1.1 and -0.4."""
    found = [
        row("H", "h", 0, S),
        row("R", "r", S, 5 * S),
        row("S", "s", 2 * S, 7 * S),
        row("R", "fast", 8 * S, 12 * S),
    ]
    factors = {("R", "r"): 0.7, ("S", "s"): 1.1, ("R", "fast"): -0.4}
    return Timelines(frame(found).filter(agent="H"), frame(found)).along(0, factors)


@pytest.mark.parametrize("observed", [-4.0, -1.0, 0.0, 0.3, 2.5])
def test_crps_of_a_normal_forecast_is_its_closed_form(observed: float) -> None:
    center, deviation = 3.0, 1.7
    expected = deviation * (
        observed * (2 * norm.cdf(observed) - 1) + 2 * norm.pdf(observed) - 1 / math.sqrt(math.pi)
    )  # Gneiting and Raftery 2007, eq. 20
    found = crps(center + deviation * norm.ppf(LEVELS), center + deviation * observed)
    assert found == pytest.approx(expected, rel=0.01)


@settings(max_examples=50)
@given(st.lists(st.floats(0.1, 100), min_size=len(LEVELS), max_size=len(LEVELS)), st.floats(0.01, 200))
def test_crps_is_the_integral_of_the_squared_distance_between_distributions(
    values: list[float], observed: float
) -> None:
    quantiles = np.sort(values)
    edges = np.sort(np.append(quantiles, observed))
    middles = (edges[1:] + edges[:-1]) / 2
    distribution = np.searchsorted(quantiles, middles, "right") / len(quantiles)
    expected = float(((distribution - (observed <= middles)) ** 2 * np.diff(edges)).sum())
    assert crps(quantiles, observed) == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_crps_of_a_forecast_without_spread_is_the_absolute_error() -> None:
    assert crps(np.full(len(LEVELS), 5.0), 3.0) == pytest.approx(2.0)
    assert crps(np.full(len(LEVELS), 5.0), 5.0) == 0.0


def test_the_interval_score_is_the_width_and_twenty_times_the_miss() -> None:
    assert interval_score(2.0, 5.0, 3.0) == 3.0
    assert interval_score(2.0, 5.0, 5.0) == 3.0
    assert interval_score(2.0, 5.0, 5.5) == pytest.approx(3 + 20 * 0.5)
    assert interval_score(2.0, 5.0, 1.0) == pytest.approx(3 + 20 * 1.0)
    assert (LOW, HIGH) == (0.05, 0.95)


@pytest.mark.parametrize(
    "log_work",
    [
        NormalLogWork(1.2, 0.3),
        StudentLogWork(1.2, 0.2, 4.0),
        SampledLogWork(np.array([0.8, 1.2, 1.5, 1.6])),
        SampledLogWork(np.linspace(0.5, 2.0, 30), conformal=True),
    ],
)
@pytest.mark.parametrize("timeline", [ALONE, busy()])
def test_the_density_of_a_duration_integrates_to_one(log_work: LogWork, timeline: Timeline) -> None:
    edges = np.unique([1e-4, *timeline.time_s[1:], *np.geomspace(0.02, 3e4, 30)])
    total = 0.0
    for low, high in pairwise(edges):
        nodes, weights = np.polynomial.legendre.leggauss(20)
        at = (low + high) / 2 + (high - low) / 2 * nodes
        densities = [math.exp(score_forecast(timeline, log_work, float(duration)).log_density) for duration in at]
        total += (high - low) / 2 * float(weights @ densities)
    assert total == pytest.approx(1, abs=2e-3)


@settings(max_examples=40)
@given(st.floats(-3, 4), st.floats(1e-4, 1.5), st.floats(1e-3, 100))
def test_quantiles_of_a_duration_are_where_its_work_has_that_quantile(
    center: float, deviation: float, observed: float
) -> None:
    timeline, log_work = busy(), NormalLogWork(center, deviation)
    found = score_forecast(timeline, log_work, observed)
    for level, duration in ((LOW, found.low_s), (0.5, found.median_s), (HIGH, found.high_s)):
        assert math.log(timeline.work_after(duration)) == pytest.approx(center + deviation * norm.ppf(level), abs=1e-9)
    assert found.low_s < found.median_s < found.high_s
    assert found.crps_s >= 0
    assert found.interval_score_s >= found.high_s - found.low_s


def test_the_density_is_that_of_the_factor_at_work_just_before_the_end() -> None:
    # equal parts of work before and after an instant: the density jumps there by the ratio of rates
    timeline, log_work = busy(), NormalLogWork(0.5, 0.4)
    before, after = (
        score_forecast(timeline, log_work, duration).log_density for duration in (2.0, np.nextafter(2.0, 3.0))
    )
    assert before - after == pytest.approx(1.1, abs=1e-6)


@pytest.mark.parametrize("center", [-20.0, 0.0, 30.0])
def test_forecasts_of_absurd_scale_stay_finite(center: float) -> None:
    for log_work in (NormalLogWork(center, 1e-6), StudentLogWork(center, 20.0, 2.0)):
        for observed in (1e-9, 1.0, 1e9):
            found = score_forecast(busy(), log_work, observed)
            assert all(math.isfinite(getattr(found, name)) for name in found.__slots__)
