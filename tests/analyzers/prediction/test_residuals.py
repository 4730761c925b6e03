"""The session that is under way: shifts, drifts, tails, repeats."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.analyzers.prediction.residuals import Learning, Observed, Session
from hrclog.analyzers.prediction.scoring_rules import HIGH, LOW
from hrclog.analyzers.synergy.log_work import NormalLogWork
from hrclog.arrays import FloatArray

KEYS = [("H", "a"), ("H", "b"), ("R", "a"), ("R", "c")]
START = {key: NormalLogWork(1.0, 0.2) for key in KEYS}
NINE_IN_TEN = HIGH - LOW
Noise = Callable[[np.random.Generator, int, int], FloatArray]


def inside(session: Session, one: Observed) -> bool:
    forecast = session.predict(one.key, one.cell)
    return abs(one.log_work - forecast.center) <= forecast.half_width(NINE_IN_TEN)


def carry_out(values: FloatArray, n_plans: int, seed: int = 0) -> tuple[Session, list[bool]]:
    """Predict and learn runs; values of shape (runs, executions), executions are of the tasks in turn.

    Each run follows one of some plans; return the session, and which executions were within their interval.
    """
    source = np.random.default_rng(seed)
    session, hits = Session(START), []
    for of_run in values:
        plan = source.integers(n_plans)
        run = [Observed(KEYS[n % len(KEYS)], f"{n}|{plan}", float(value)) for n, value in enumerate(of_run)]
        hits += [inside(session, one) for one in run]
        session.learn(run)
    return session, hits


def test_before_anything_is_learnt_the_forecast_is_centred_on_the_training_runs() -> None:
    forecast = Session({("H", "a"): NormalLogWork(2.0, 0.3)}).predict(("H", "a"), "anywhere")
    assert forecast.center == 2.0
    assert forecast.freedom == 4.0
    assert forecast.scale == pytest.approx(0.3 * math.sqrt(1.5))


def test_one_run_is_learnt_as_the_normal_inverse_gamma_model_says() -> None:
    session = Session({("H", "a"): NormalLogWork(2.0, 0.3)}, Learning(width_step=0.0))
    session.learn([Observed(("H", "a"), "cell", 2.6)])
    forecast = session.predict(("H", "a"), "elsewhere")
    kappa, nu = 0.95 * 2, 0.95 * 4
    variance = (nu * 0.09 + kappa / (kappa + 1) * 0.6**2) / (nu + 1)
    assert forecast.center == pytest.approx(2 + 0.6 / (kappa + 1))
    assert forecast.freedom == pytest.approx(nu + 1)
    assert forecast.scale == pytest.approx(math.sqrt(variance * (1 + 1 / (kappa + 1))))


@pytest.mark.parametrize("shift", [-0.7, 0.4])
def test_a_shift_is_learnt_within_a_few_runs(shift: float) -> None:
    source = np.random.default_rng(2)
    session = Session(START)
    for run in range(5):
        session.learn([Observed(key, f"{run}", float(source.normal(1 + shift, 0.1))) for key in KEYS * 2])
    for key in KEYS:
        assert session.predict(key, "a new plan").center == pytest.approx(1 + shift, abs=0.15)


def drifting(source: np.random.Generator, runs: int, each: int) -> FloatArray:
    return 1 + np.cumsum(source.normal(0, 0.03, (runs, 1)), axis=0) + source.normal(0, 0.15, (runs, each))


def heavy(source: np.random.Generator, runs: int, each: int) -> FloatArray:
    return 1.3 + 0.1 * source.standard_t(2, (runs, each))


def skewed(source: np.random.Generator, runs: int, each: int) -> FloatArray:
    return 0.8 + 0.2 * source.exponential(1, (runs, each))


@pytest.mark.parametrize("noise", [drifting, heavy, skewed])
@pytest.mark.parametrize("n_plans", [1, 10, 10_000])
def test_nine_in_ten_are_covered_in_sessions_that_drift_or_have_tails(noise: Noise, n_plans: int) -> None:
    _, hits = carry_out(noise(np.random.default_rng(5), 250, 8), n_plans)
    assert np.mean(hits) == pytest.approx(0.9, abs=0.03)
    assert 0.87 < np.mean(hits[1000:]) < 0.94


def test_after_a_sudden_change_coverage_comes_back() -> None:
    source = np.random.default_rng(3)
    values = np.concatenate([source.normal(1, 0.1, (40, 8)), source.normal(2.5, 0.1, (40, 8))])
    hits = np.array(carry_out(values, 10_000)[1]).reshape(80, 8).mean(axis=1)
    assert hits[40] == 0
    assert hits[50:].mean() > 0.82


def test_a_repeated_plan_narrows_to_what_it_repeats() -> None:
    source = np.random.default_rng(1)
    places = source.normal(1, 0.3, (5, 8))  # by plan and place
    session, plans = Session(START), source.integers(0, 5, 60)
    for plan in plans:
        values = places[plan] + source.normal(0, 0.02, 8)
        session.learn([Observed(KEYS[n % 4], f"{n}|{plan}", float(value)) for n, value in enumerate(values)])
    for plan in range(5):
        for place in range(8):
            known = session.predict(KEYS[place % 4], f"{place}|{plan}")
            new = session.predict(KEYS[place % 4], "never seen")
            assert known.center == pytest.approx(places[plan, place], abs=0.05)
            assert known.half_width(NINE_IN_TEN) < 0.35 * new.half_width(NINE_IN_TEN)


@pytest.mark.parametrize("deviation", [0.0, 1e-12, 0.2])
def test_exact_repeats_stay_finite_and_hit(deviation: float) -> None:
    key = ("H", "a")
    session = Session({key: NormalLogWork(0.5, deviation)})
    for _ in range(3000):
        session.learn([Observed(key, "cell", 0.5), Observed(key, "cell", 0.5)])
    forecast = session.predict(key, "cell")
    assert forecast.scale > 0
    assert math.isfinite(float(forecast.log_density(np.array([0.5]))[0]))
    assert forecast.center == pytest.approx(0.5, abs=1e-9)
    assert forecast.half_width(NINE_IN_TEN) < 1e-4


def test_a_run_without_executions_only_forgets() -> None:
    session = Session(START)
    for _ in range(500):
        session.learn([])
    forecast = session.predict(("H", "a"), "")
    assert forecast.center == 1.0
    assert forecast.freedom == 2.0
    assert math.isfinite(forecast.half_width(NINE_IN_TEN))


def test_all_executions_of_a_run_are_judged_by_what_was_known_before_it() -> None:
    run = [Observed(("H", "a"), "cell", value) for value in (1.0, 1.5, 9.0, -3.0)]
    one, other = Session(START), Session(START)
    one.learn(run)
    other.learn(reversed(run))
    # the same misses widen both; what is learnt is the same up to the order of the updates
    assert one._log_width == other._log_width
    assert one.predict(("H", "a"), "new").center == pytest.approx(other.predict(("H", "a"), "new").center)


@settings(max_examples=30)
@given(
    st.lists(
        st.lists(st.tuples(st.sampled_from(KEYS), st.sampled_from("xy"), st.floats(-30, 30)), max_size=4), max_size=12
    )
)
def test_whatever_is_observed_forecasts_are_finite_and_the_same_every_time(
    runs: list[list[tuple[tuple[str, str], str, float]]],
) -> None:
    one, other = Session(START), Session(START)
    for run in runs:
        for session in (one, other):
            session.learn([Observed(*values) for values in run])
        for key in KEYS:
            for cell in "xyz":
                forecast = one.predict(key, cell)
                assert forecast == other.predict(key, cell)
                assert forecast.scale > 0
                assert np.isfinite(np.exp(forecast.quantile(np.array([0.005, 0.995])))).all()
