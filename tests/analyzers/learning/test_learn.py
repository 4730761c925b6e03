"""What runs teach: gaps from the best that a log says of them, and times in the order that planners expect."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from interval_frames import Row, frame, random_runs, row, rows

from hrclog.analyzers.learning.learn import gaps, learn
from hrclog.analyzers.synergy.estimators import ESTIMATORS
from hrclog.analyzers.synergy.observations import observe
from hrclog.knowledge.task_times import GUESS_SIGMA, NOTHING, TaskTimes

S = 1_000_000_000


def spans(agent: str, run: str, *times: tuple[int, int, int | None, int | None]) -> list[Row]:
    """Return executions by start, end, planned start and dispatch."""
    return [
        row(
            agent,
            "t",
            start * S,
            end * S,
            planned_start_ns=None if planned is None else planned * S,
            dispatched_ns=None if dispatched is None else dispatched * S,
            run_id=run,
        )
        for start, end, planned, dispatched in times
    ]


def means_s(found: list[Row]) -> dict[str, float]:
    return {agent: gap.mean_s for agent, gap in gaps(frame(found)).items()}


def test_gaps_are_from_when_an_agent_could_start_until_it_does() -> None:
    found = [
        *spans("H", "a", (5, 6, 0, None), (8, 9, None, None), (12, 13, 11, None)),  # 2 and 1, none before the first
        *spans("H", "b", (0, 4, None, None), (3, 5, None, None)),  # it overlaps itself: 0
        *spans("R", "a", (0, 9, None, None)),
        row("R", "home", 100 * S, 101 * S, role="auxiliary", run_id="a"),
    ]
    assert means_s(found) == {"H": pytest.approx(1.0)}
    assert gaps(frame(found))["H"].n == 3
    assert gaps(frame(found))["H"].std_s == pytest.approx(1.0)


def test_being_told_to_start_counts_before_the_plan_and_before_being_free() -> None:
    assert means_s(spans("H", "a", (0, 4, 0, None), (10, 12, 9, 7))) == {"H": pytest.approx(3.0)}


def test_the_first_item_of_a_run_has_a_gap_if_it_was_told_to_start() -> None:
    assert means_s(spans("H", "a", (5, 6, 3, 4))) == {"H": pytest.approx(1.0)}
    assert means_s(spans("H", "a", (5, 6, 3, None))) == {}


def test_an_agent_that_was_told_before_it_was_free_has_no_negative_gap() -> None:
    assert means_s(spans("H", "a", (0, 4, None, None), (3, 6, None, 9))) == {"H": 0.0}


def test_one_gap_has_no_deviation() -> None:
    [found] = gaps(frame(spans("H", "a", (5, 6, None, 4)))).values()
    assert (found.agent, found.std_s, found.n) == ("H", 0.0, 1)


@settings(max_examples=40)
@given(rows(max_size=12), st.integers(0, 100))
def test_gaps_do_not_depend_on_the_order_of_rows(found: list[Row], seed: int) -> None:
    planned = [one | {"planned_start_ns": one["start_ns"] - number % 7} for number, one in enumerate(found)]
    expected = gaps(frame(planned))
    assert gaps(frame(planned).sample(fraction=1.0, shuffle=True, seed=seed)) == expected
    assert all(gap.mean_s >= 0 for gap in expected.values())


def test_gaps_of_executions_at_the_same_time_do_not_depend_on_the_order_of_rows() -> None:
    found = frame([*spans("H", "a", (0, 1, None, None), (5, 6, 2, None), (5, 6, 4, None))])
    assert gaps(found) == gaps(found.reverse())


def test_nothing_teaches_nothing() -> None:
    assert gaps(pl.DataFrame(frame([]))) == {}
    assert learn(frame([])).times == NOTHING


def slowed(n_runs: int, seed: int = 0) -> pl.DataFrame:
    """Return runs in which the human's h takes twice as long beside the robot's r, and the robot does not mind."""
    source = np.random.default_rng(seed)
    found: list[Row] = []
    for run in range(n_runs):
        work, begin, length = 10 * math.exp(source.normal(0, 0.05)), source.uniform(0, 8), source.uniform(0.5, 14)
        end = min(work + length / 2, 2 * work - begin)  # h is done before r, or after it
        name = f"run{run:03}"
        found += [
            row("H", "h", 0, round(end * S), run_id=name),
            row("R", "r", round(begin * S), round((begin + length) * S), run_id=name),
            row("H", "g", round((end + 1) * S), round((end + 1 + source.uniform(4, 6)) * S), run_id=name),
        ]
    return frame(found)


@pytest.mark.slow
@pytest.mark.parametrize("estimator", sorted(ESTIMATORS))
def test_every_estimator_gives_finite_times_of_all_that_succeeded(estimator: str) -> None:
    found = learn(frame(random_runs(3, n_runs=15)), estimator).times
    assert list(found.times) == sorted(found.times)
    assert {agent for agent, _ in found.times} == set(found.gaps) == {"H", "R"}
    for time in found.times.values():
        assert time.n > 0
        assert time.observed_s is not None
        assert time.covariance is not None
        assert time.covariance.shape == (2 + len(time.factors),) * 2
        assert np.isfinite([time.mu, time.sigma, time.mean_s, *(f.log_s for f in time.factors)]).all()
        assert np.isfinite(time.covariance).all()
        assert (np.diag(time.covariance) >= 0).all()
        assert [f.other_agent for f in time.factors] == ["R" if time.agent == "H" else "H"] * len(time.factors)
        assert list(time.factors) == sorted(time.factors, key=lambda f: (f.other_agent, f.other_task))


@pytest.mark.parametrize("estimator", sorted(ESTIMATORS))
def test_one_execution_is_enough_to_be_planned_with(estimator: str) -> None:
    found = learn(frame([row("H", "h", 0, 4 * S), row("R", "r", 0, 3 * S)]), estimator).times
    for time in found.times.values():
        assert np.isfinite([time.mu, time.sigma, time.mean_s]).all()
        assert time.covariance is not None
        assert np.isfinite(time.covariance).all()


def test_a_factor_is_that_on_the_task_it_belongs_to() -> None:
    times = learn(slowed(40)).times.times
    [factor] = times["H", "h"].factors
    assert (factor.other_agent, factor.other_task) == ("R", "r")
    assert math.exp(factor.log_s) == pytest.approx(2.0, rel=0.15)
    assert factor.n > 30
    assert times["H", "h"].mean_s == pytest.approx(10.0, rel=0.05)
    assert times["H", "h"].sigma == pytest.approx(0.05, rel=0.5)


@pytest.mark.slow
def test_covariances_are_in_the_order_of_mu_log_sigma_and_the_factors() -> None:
    """Hold the variances against the spread of what independent campaigns teach."""
    drawn: list[list[float]] = []
    told: list[Any] = []
    for seed in range(40):
        time = learn(slowed(25, seed)).times.times["H", "h"]
        assert time.covariance is not None
        drawn.append([time.mu, math.log(time.sigma), *(f.log_s for f in time.factors)])
        told.append(np.diag(time.covariance))
    spread, expected = np.std(drawn, axis=0), np.sqrt(np.mean(told, axis=0))
    assert np.abs(np.log(spread / expected)).max() < math.log(1.8)
    assert expected[1] > 3 * expected[0]  # so that exchanged places are seen


def test_covariances_are_those_of_the_estimator_whatever_the_order_of_its_parameters(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    intervals = frame(random_runs(5, n_runs=12, tasks=2))
    fit = ESTIMATORS["aft"].fit(observe(intervals), "none")
    turned = replace(
        fit,
        covariances=tuple(
            replace(c, parameters=c.parameters[::-1], matrix=c.matrix[::-1, ::-1]) for c in fit.covariances
        ),
    )
    found = []
    for one in (fit, turned):
        monkeypatch.setattr(type(ESTIMATORS["ols"]), "fit", lambda *_, one=one: one)
        found.append(learn(intervals, "ols").times.times)
    matrices = [covariance.matrix for covariance in fit.covariances]
    for key, time in found[0].items():
        other = found[1][key].covariance
        assert time.covariance is not None
        assert other is not None
        assert np.array_equal(time.covariance, other)
        assert any(np.isclose(matrix, time.covariance[0, 0], rtol=1e-12).any() for matrix in matrices)


def test_how_often_attempts_fail_is_learnt_and_how_long_those_take() -> None:
    found = [
        row("H", "h", 10 * n * S, (10 * n + length) * S, outcome=outcome)
        for n, (length, outcome) in enumerate(
            [(4, "succeeded"), (1, "failed"), (4, "succeeded"), (3, "timed_out"), (4, "succeeded"), (9, "canceled")]
        )
    ]
    time = learn(frame([*found, row("R", "r", 0, S)])).times.times["H", "h"]
    assert (time.n, time.failure_rate, time.failed_s) == (3, pytest.approx(2 / 5), pytest.approx(2.0))


def test_what_is_learnt_is_less_spread_than_a_guess() -> None:
    found: TaskTimes = learn(slowed(20)).times
    time = found.times["H", "h"]
    assert time.covariance is not None
    assert time.covariance[0, 0] < GUESS_SIGMA**2 / 20
