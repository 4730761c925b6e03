"""Worlds drawn from what is known: their moments are those of the posterior, and the same seed gives the same ones."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hrclog.analyzers.search.worlds import UNKNOWN_DEVIATION, Worlds, drawn_worlds, expected_world
from hrclog.errors import ScenarioError
from hrclog.knowledge.task_times import Factor, Gap, TaskTime, TaskTimes

AGENTS = ("H", "R", "S")
KEYS = [("H", "a"), ("H", "b"), ("R", "x"), ("S", "y")]
H, R = ("H", "a"), ("R", "x")
SIZE = 3
MANY = 40_000

FACTORS = (Factor("R", "x", math.log(2.0), 20), Factor("S", "y", math.log(0.8), 20))
COVARIANCE = np.array(
    [
        [0.040, 0.002, 0.010, -0.005],
        [0.002, 0.010, 0.000, 0.001],
        [0.010, 0.000, 0.090, 0.020],
        [-0.005, 0.001, 0.020, 0.060],
    ]
)
TIMES = TaskTimes(
    {
        H: TaskTime(*H, 1.5, 0.3, 20, FACTORS, COVARIANCE),
        ("H", "b"): TaskTime("H", "b", 1.0, 0.2, 20, (Factor("R", "x", 0.1, 5),), np.zeros((3, 3))),
        R: TaskTime(*R, 2.0, 0.1, 20),
        ("S", "y"): TaskTime("S", "y", 0.5, 0.0, 20),
    },
    {"H": Gap("H", 1.2, 0.6, 30), "R": Gap("R", 0.4, 0.0, 30)},
)


@pytest.fixture(scope="module")
def worlds() -> Worlds:
    """Return many worlds."""
    return drawn_worlds(TIMES, KEYS, AGENTS, SIZE, MANY, seed=1)


def test_the_expected_world_is_that_of_expected_works_best_factors_and_mean_gaps() -> None:
    world = expected_world(TIMES, KEYS, AGENTS, SIZE)
    assert (world.count, world.work_s.shape, world.rate.shape, world.gap_s.shape) == (
        1,
        (1, 4, 3),
        (1, 5, 5),
        (1, 3, 3),
    )
    assert world.work_s[0, :, 0].tolist() == pytest.approx([TIMES.times[key].mean_s for key in KEYS])
    expected = np.ones((5, 5))
    expected[0, 2], expected[0, 3], expected[1, 2] = 1 / 2.0, 1 / 0.8, math.exp(-0.1)
    assert world.rate[0] == pytest.approx(expected)
    assert world.gap_s[0, :, 1].tolist() == [1.2, 0.4, 0.0]
    alone = expected_world(TIMES, KEYS, AGENTS, SIZE, synergies=False)
    assert (alone.rate == 1.0).all()
    assert (alone.work_s == world.work_s).all()


def test_work_has_the_moments_of_the_posterior_and_of_the_noise(worlds: Worlds) -> None:
    log_work = np.log(worlds.work_s[:, 0])
    noise = math.exp(2 * math.log(0.3) + 2 * 0.01)  # E sigma^2 of a lognormal sigma
    assert log_work.mean() == pytest.approx(1.5, abs=0.01)
    assert log_work.var() == pytest.approx(0.04 + noise, rel=0.03)
    between = np.cov(log_work, rowvar=False)[0, 1:]
    assert between == pytest.approx(0.04, rel=0.05)  # executions share what is not known of the task
    other = np.log(worlds.work_s[:, 2])
    assert other.var() == pytest.approx(0.01, rel=0.03)
    assert np.corrcoef(other, rowvar=False)[0, 1] == pytest.approx(0.0, abs=0.02)
    assert np.corrcoef(log_work[:, 0], other[:, 0])[0, 1] == pytest.approx(0.0, abs=0.02)
    assert worlds.work_s[:, 3] == pytest.approx(math.exp(0.5), rel=1e-6)


def test_factors_have_the_moments_of_the_posterior_and_go_with_the_work(worlds: Worlds) -> None:
    log_s = -np.log(worlds.rate[:, 0, 2:4])
    assert log_s.mean(axis=0) == pytest.approx([math.log(2.0), math.log(0.8)], abs=0.01)
    assert np.cov(log_s, rowvar=False) == pytest.approx(COVARIANCE[2:, 2:], abs=0.002)
    with_work = np.cov(np.log(worlds.work_s[:, 0, 0]), log_s[:, 0])[0, 1]
    assert with_work == pytest.approx(0.010, abs=0.002)
    assert worlds.rate[:, 1, 2] == pytest.approx(math.exp(-0.1))  # known for certain


def test_factors_that_nobody_saw_come_from_their_prior_and_nobody_hinders_himself(worlds: Worlds) -> None:
    unseen = -np.log(np.stack([worlds.rate[:, 1, 3], worlds.rate[:, 2, 0], worlds.rate[:, 3, 2]], axis=1))
    assert unseen.mean(axis=0) == pytest.approx(0.0, abs=0.01)
    assert unseen.std(axis=0) == pytest.approx(UNKNOWN_DEVIATION, rel=0.02)
    assert np.corrcoef(unseen, rowvar=False) == pytest.approx(np.eye(3), abs=0.02)
    for own, other in ((0, 1), (1, 0), (0, 0), (0, 4), (4, 0), (4, 4)):
        assert (worlds.rate[:, own, other] == 1.0).all()


def test_gaps_have_their_mean_and_deviation(worlds: Worlds) -> None:
    assert worlds.gap_s[:, 0].mean(axis=0) == pytest.approx(1.2, rel=0.02)
    assert worlds.gap_s[:, 0].std(axis=0) == pytest.approx(0.6, rel=0.04)
    assert worlds.gap_s[:, 1] == pytest.approx(0.4)
    assert (worlds.gap_s[:, 2] == 0.0).all()
    assert np.corrcoef(worlds.gap_s[:, 0], rowvar=False)[0, 1] == pytest.approx(0.0, abs=0.02)


def test_worlds_come_in_pairs_of_opposite_sign() -> None:
    found = drawn_worlds(TIMES, KEYS, AGENTS, SIZE, 10, seed=3)
    log_s = -np.log(found.rate[:, 0, 2])
    assert log_s[:5] + log_s[5:] == pytest.approx(2 * math.log(2.0))
    quiet = replace(TIMES, times={key: replace(time, covariance=None) for key, time in TIMES.times.items()})
    log_work = np.log(drawn_worlds(quiet, KEYS, AGENTS, SIZE, 10, seed=3).work_s[:, 0])
    assert log_work[:5] + log_work[5:] == pytest.approx(np.full((5, SIZE), 3.0))
    log_gap = np.log(found.gap_s[:, 0])
    assert log_gap[:5] + log_gap[5:] == pytest.approx(np.full((5, SIZE), 2 * math.log(1.2) - math.log(1.25)))


def test_the_same_seed_gives_the_same_worlds_and_another_gives_others() -> None:
    one, same, other = (drawn_worlds(TIMES, KEYS, AGENTS, SIZE, 8, seed) for seed in (5, 5, 6))
    for name in ("work_s", "rate", "gap_s"):
        assert np.array_equal(getattr(one, name), getattr(same, name))
    assert not np.array_equal(one.work_s, other.work_s)
    assert not np.array_equal(one.rate, other.rate)
    assert not np.array_equal(one.gap_s, other.gap_s)


@given(st.integers(1, 9), st.integers(1, 6), st.integers(0, 99))
def test_worlds_are_as_many_and_as_large_as_asked_for_and_sound(count: int, size: int, seed: int) -> None:
    found = drawn_worlds(TIMES, KEYS, AGENTS, size, count, seed)
    assert found.count == count
    assert (found.work_s.shape, found.rate.shape, found.gap_s.shape) == (
        (count, 4, size),
        (count, 5, 5),
        (count, 3, size),
    )
    assert (found.work_s > 0).all()
    assert (found.rate > 0).all()
    assert (found.gap_s >= 0).all()


def test_tasks_of_which_nothing_is_known_are_named() -> None:
    keys = [*KEYS, *(("H", name) for name in ("m", "n", "o", "p", "q", "r"))]
    told = r"m by H, n by H, o by H, p by H and 2 more.*expected_s.*hrclog kb update"
    with pytest.raises(ScenarioError, match=told):
        drawn_worlds(TIMES, keys, AGENTS, SIZE, 4)
    with pytest.raises(ScenarioError, match=told):
        expected_world(TIMES, keys, AGENTS, SIZE)


def test_attempts_that_fail_add_their_time_and_a_gap_until_one_succeeds() -> None:
    time = TaskTime(*H, 1.0, 0.0, 20, failure_rate=0.25, failed_s=2.0)
    times = TaskTimes({H: time}, {"H": Gap("H", 1.0, 0.0, 9)})
    expected = math.exp(1.0) + (2.0 + 1.0) / 3  # 1/3 of a failure for each success
    assert expected_world(times, [H], ["H"], 1).work_s.item() == pytest.approx(expected)
    work = drawn_worlds(times, [H], ["H"], 1, MANY, seed=2).work_s.ravel()
    assert work.mean() == pytest.approx(expected, rel=0.01)
    failures = np.round((work - math.exp(1.0)) / 3.0)
    assert work == pytest.approx(math.exp(1.0) + 3.0 * failures)
    for count in range(4):
        assert (failures == count).mean() == pytest.approx(0.75 * 0.25**count, abs=0.01)
