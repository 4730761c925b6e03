"""The log posterior of the rate model: its derivatives, and that it is the density of a duration."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import polars as pl
import pytest
from interval_frames import Row, frame, random_runs, row
from scipy.optimize import minimize
from simulated_frames import simulated_frame

from hrclog.analyzers.projections.joint_states import AgentTask
from hrclog.analyzers.synergy.aft_likelihood import Prior, expected_information, log_posterior
from hrclog.analyzers.synergy.exposures import Exposure, exposures
from hrclog.analyzers.synergy.observations import observe
from hrclog.arrays import FloatArray

pytestmark = pytest.mark.slow

NO_PRIOR = Prior(tau=math.inf, freedom=0.0)


def exposure(intervals: pl.DataFrame, key: AgentTask) -> Exposure:
    return next(data for data in exposures(observe(intervals)) if data.key == key)


def exposed(seed: int) -> Exposure:
    """Return a task of one of three agents that overlap themselves and fail at times."""
    found = random_runs(seed, n_runs=6, agents="HRS", tasks=2, overlap_itself="RS")
    for one in found[::5]:
        one["outcome"] = "failed"
    data = exposure(frame(found), ("H", "h0"))
    assert 0 < data.finished.sum() < len(data.finished)
    assert data.members.max() >= 2
    assert (data.members > 0).sum(axis=1).max() >= 2
    return data


def anywhere(seed: int, data: Exposure) -> FloatArray:
    source = np.random.default_rng(seed)
    middle = float(np.log(data.work(np.zeros(len(data.others)))).mean())
    start = [middle + source.normal(0, 1), source.normal(-0.5, 0.7)]
    return np.concatenate([start, source.normal(0, 0.8, len(data.others))])


def numerically(function: Callable[[FloatArray], FloatArray], at: FloatArray) -> FloatArray:
    """Return the derivatives of a function, by Richardson's extrapolation of central differences."""

    def slopes(step: float) -> FloatArray:
        return np.array([(function(at + move) - function(at - move)) / (2 * step) for move in step * np.eye(len(at))])

    return (4 * slopes(5e-4) - slopes(1e-3)) / 3


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("prior", [Prior(), Prior(tau=0.3, sigma=0.5, freedom=4.0), NO_PRIOR])
def test_gradient_and_hessian_are_the_derivatives_of_the_value(seed: int, prior: Prior) -> None:
    data = exposed(seed)
    at, spent = anywhere(seed, data), 0.7 * seed
    found = log_posterior(at, data, prior, spent)
    gradient = numerically(lambda x: np.array(log_posterior(x, data, prior, spent).value), at)
    hessian = numerically(lambda x: log_posterior(x, data, prior, spent).gradient, at)
    np.testing.assert_allclose(found.gradient, gradient, rtol=1e-7, atol=1e-7 * np.abs(gradient).max())
    np.testing.assert_allclose(found.hessian, hessian, rtol=1e-7, atol=1e-7 * np.abs(hessian).max())
    np.testing.assert_allclose(found.hessian, found.hessian.T, rtol=1e-12)


@pytest.mark.parametrize("spent", [0.0, 3.5])
def test_the_value_is_the_formula(spent: float) -> None:
    data, prior = exposed(1), Prior()
    at = anywhere(1, data)
    mu, sigma, factors = at[0], math.exp(at[1]), np.exp(at[2:])
    value, stretches = 0.0, []
    for k, seconds in enumerate(data.seconds.toarray()):
        work = sum(
            time / math.prod(factor**count for factor, count in zip(factors, members, strict=True))
            for time, members in zip(seconds, data.members, strict=True)
        )
        z = (math.log(work) - mu) / sigma
        if data.finished[k]:
            value += -0.5 * math.log(2 * math.pi) - math.log(sigma) - z * z / 2 - math.log(work)
            at_end = sum(count * math.log(s) for count, s in zip(data.members[data.last[k]], factors, strict=True))
            value -= at_end
            stretches.append(math.log(work) - math.log(sum(seconds)) + at_end)
        else:
            value += math.log(math.erfc(z / math.sqrt(2)) / 2)
    value += sum(-0.5 * math.log(s) ** 2 / prior.tau**2 for s in factors)
    spread = math.log(sigma) + sum(stretches) / len(stretches)
    value -= prior.freedom * (spread + 0.5 * prior.sigma**2 / math.exp(2 * spread))
    assert log_posterior(at, data, prior, spent).value == pytest.approx(value + spent * spread, rel=1e-12)


def test_a_censored_execution_far_in_the_tail_has_a_value_and_derivatives() -> None:
    found = frame([row("H", "h", 0, 10**15, outcome="failed"), row("H", "h", 0, 10**9), row("R", "r", 5, 10**14)])
    data = exposure(found, ("H", "h"))
    at = np.array([0.0, math.log(0.1), 0.5])  # z is beyond 100
    result = log_posterior(at, data, Prior())
    assert np.isfinite([result.value, *result.gradient, *result.hessian.ravel()]).all()
    gradient = numerically(lambda x: np.array(log_posterior(x, data, Prior()).value), at)
    np.testing.assert_allclose(result.gradient, gradient, rtol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_the_expected_information_is_that_of_the_mean_of_log_work(seed: int) -> None:
    data, prior = exposed(seed), Prior()
    finished = data.rows(data.finished)
    at = anywhere(seed, finished)
    found = expected_information(at, finished, prior)
    sigma = math.exp(at[1])
    slopes = numerically(lambda x: np.log(finished.work(x[2:])) - x[0], at)  # of the residuals
    expected = slopes @ slopes.T / sigma**2
    expected[np.arange(2, len(at)), np.arange(2, len(at))] += 1 / prior.tau**2
    mean = [0, *range(2, len(at))]
    np.testing.assert_allclose(found[np.ix_(mean, mean)], expected[np.ix_(mean, mean)], rtol=1e-7, atol=1e-7)
    hessian = log_posterior(at, finished, prior).hessian
    assert found[1, 1] == pytest.approx(-hessian[1, 1], rel=1e-9)
    assert (found[1, mean] == 0).all()
    # executions that were cut off tell more of the mean, never less
    more = (expected_information(at, data, prior) - found)[np.ix_(mean, mean)]
    np.testing.assert_allclose(more, more.T, rtol=1e-9, atol=1e-9)
    assert np.linalg.eigvalsh(more).min() > -1e-9 * np.abs(found).max()


# --- the density of a duration ---


def others(seed: int, agents: str, itself: bool) -> list[Row]:
    """Return what the other agents do, the same in every run, with times in ns."""
    source = np.random.default_rng(seed)
    found = []
    for agent in agents:
        now = 0
        for _ in range(4):
            begin = now + int(source.integers(0, 10**9))
            end = begin + int(source.integers(2 * 10**8, 2 * 10**9))
            found.append(row(agent, f"{agent}{source.integers(2)}", begin, end))
            now = begin + (end - begin) // 2 if itself else end
    return found


class Density:
    """The likelihood of single executions of H's h beside given others, as a function of how long they take."""

    def __init__(self, beside: list[Row], seed: int) -> None:
        self.beside = beside
        source = np.random.default_rng(seed)
        tasks = sorted({(one["agent"], one["task"]) for one in beside})
        self.factors = dict(zip(tasks, np.exp(source.normal(0, 0.7, len(tasks))), strict=True))
        self.mu, self.sigma = 0.9, 0.4

    def log(self, durations_ns: FloatArray, outcome: str = "succeeded") -> FloatArray:
        """Return the log likelihood of each duration."""
        ends = np.round(durations_ns).astype(np.int64).tolist()
        own = [row("H", "h", 0, end, run_id=f"{k:05}", outcome=outcome) for k, end in enumerate(ends)]
        seen = [one | {"run_id": f"{k:05}"} for k in range(len(ends)) for one in self.beside]
        data = exposure(frame(own + seen), ("H", "h"))
        log_s = data.log_factors({task: math.log(factor) for task, factor in self.factors.items()})
        at = np.concatenate([[self.mu, math.log(self.sigma)], log_s])
        each = np.eye(len(ends), dtype=bool)
        return np.array([log_posterior(at, data.rows(one), NO_PRIOR).value for one in each])

    def integral(self, low: float = 0.0) -> float:
        """Integrate the density from some duration in ns on, piece by piece between the others' starts and ends."""
        edges = sorted({low, *(float(one[name]) for one in self.beside for name in ("start_ns", "until_ns"))})
        edges = [max(edge, low, 1e3) for edge in edges if edge >= low]
        nodes, weights = np.polynomial.legendre.leggauss(16)
        total = 0.0
        tail = edges[-1] * np.exp(np.linspace(0, 6, 13))  # nobody else is there any more: work goes on at full rate
        for a, b in zip([*edges[:-1], *tail[:-1]], [*edges[1:], *tail[1:]], strict=True):
            at = 0.5 * (a + b) + 0.5 * (b - a) * nodes
            total += float(np.exp(self.log(at)) @ weights) * 0.5 * (b - a) / 1e9
        return total


timelines = pytest.mark.parametrize(
    ("agents", "itself"), [("R", False), ("R", True), ("RS", False), ("RS", True), ("RST", False)]
)


@timelines
@pytest.mark.parametrize("seed", range(2))
def test_the_density_of_a_duration_integrates_to_one(agents: str, itself: bool, seed: int) -> None:
    assert Density(others(seed, agents, itself), seed).integral() == pytest.approx(1.0, abs=2e-6)


@pytest.mark.slow
@timelines
def test_a_censored_execution_counts_as_much_as_all_longer_ones_together(agents: str, itself: bool) -> None:
    density = Density(others(3, agents, itself), 3)
    for duration in (1.4e9, 2.3e9):
        survival = math.exp(float(density.log(np.array([duration]), outcome="failed")[0]))
        assert 0.002 < survival < 0.998
        assert density.integral(duration) == pytest.approx(survival, abs=2e-6)


# --- both terms of the Jacobian ---

Change = Callable[[Exposure, FloatArray], float]

TRUTH = {("R", "x"): 1.8, ("R", "y"): 3.0}


def without_work(data: Exposure, log_s: FloatArray) -> float:
    return float(np.log(data.work(log_s))[data.finished].sum())


def without_rate_at_the_end(data: Exposure, log_s: FloatArray) -> float:
    return float((data.members[data.last] @ log_s)[data.finished].sum())


def estimated(data: Exposure, prior: Prior, change: Change | None) -> FloatArray:
    """Return the factors that maximise the log posterior, with something added to it."""

    def loss(x: FloatArray) -> float:
        return -log_posterior(x, data, prior).value - (change(data, x[2:]) if change else 0.0)

    start = np.concatenate([[1.5, -1.5], np.zeros(len(data.others))])
    return np.exp(minimize(loss, start, method="Nelder-Mead", options={"maxfev": 4000, "fatol": 1e-9}).x[2:])


@pytest.fixture(scope="module")
def known() -> Exposure:
    """Return executions of a task that takes 1.8 and 3 times as long beside x and y."""
    work = {"H": {"h": (1.5, 0.6)}, "R": {"x": (1.4, 0.2), "y": (1.0, 0.2)}}
    factors = {("H", "h", *other): factor for other, factor in TRUTH.items()}
    return exposure(simulated_frame(5, 150, work, factors, idle_s=3.0), ("H", "h"))


@pytest.mark.parametrize("prior", [Prior(), NO_PRIOR])
def test_the_posterior_recovers_the_truth(known: Exposure, prior: Prior) -> None:
    found = dict(zip(known.others, estimated(known, prior, None), strict=True))
    assert found == pytest.approx(TRUTH, rel=0.1)


@pytest.mark.parametrize("change", [without_work, without_rate_at_the_end])
@pytest.mark.parametrize("prior", [Prior(), Prior(tau=5.0)])
def test_without_either_term_of_the_jacobian_the_truth_is_lost(known: Exposure, change: Change, prior: Prior) -> None:
    found = dict(zip(known.others, estimated(known, prior, change), strict=True))
    assert all(abs(math.log(found[other] / factor)) > 0.5 for other, factor in TRUTH.items()), found
