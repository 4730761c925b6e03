"""What is known of task times: to JSON and back, and guesses that fade."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hrclog.errors import ScenarioError
from hrclog.json_record import JsonRecord
from hrclog.knowledge.task_times import (
    GUESS_SIGMA,
    NOTHING,
    PRIOR_WEIGHT,
    Factor,
    Gap,
    TaskTime,
    TaskTimes,
    task_times_from_json,
    with_guesses,
)

KEY = ("robot", "pick")

NAMES = st.text(min_size=1, max_size=4).filter(lambda text: text.isprintable() and text.strip() == text)
FINITE = st.floats(-30, 30)
POSITIVE = st.floats(1e-6, 1e6)


@st.composite
def task_times(draw: st.DrawFn) -> TaskTimes:
    """Draw what may be known."""
    keys = draw(st.lists(st.tuples(NAMES, NAMES), unique=True, max_size=3))
    times = {}
    for key in sorted(keys):
        factors = draw(st.lists(st.builds(Factor, NAMES, NAMES, FINITE, st.integers(0, 999)), max_size=2))
        size = 2 + len(factors)
        row = st.lists(FINITE, min_size=size, max_size=size)
        covariance = draw(st.none() | st.lists(row, min_size=size, max_size=size).map(np.array))
        times[key] = TaskTime(
            *key,
            draw(FINITE),
            draw(st.floats(0, 5)),
            draw(st.integers(0, 999)),
            tuple(factors),
            covariance,
            draw(st.none() | POSITIVE),
            draw(st.none() | POSITIVE),
            *draw(st.just((0.0, 0.0)) | st.tuples(st.floats(0.01, 0.99), POSITIVE)),
        )
    agents = draw(st.lists(NAMES, unique=True, max_size=3))
    return TaskTimes(
        times, {a: Gap(a, draw(POSITIVE), draw(st.floats(0, 9)), draw(st.integers(0, 9))) for a in sorted(agents)}
    )


def read(value: object) -> TaskTimes:
    return task_times_from_json(JsonRecord(value, "here", ("times", "gaps")))


@given(task_times())
def test_times_come_back_from_json_as_they_were(times: TaskTimes) -> None:
    text = json.dumps(times.to_json(), allow_nan=False)
    found = read(json.loads(text))
    assert found.to_json() == times.to_json()
    assert list(found.times) == list(times.times)
    assert list(found.gaps) == list(times.gaps)
    for key, time in found.times.items():
        other = times.times[key].covariance
        assert (time.covariance is None) == (other is None)
        assert other is None or np.array_equal(time.covariance, other)  # type: ignore[arg-type] - neither is None


def test_nothing_is_written_as_nothing() -> None:
    assert read({}).to_json() == NOTHING.to_json() == {"times": [], "gaps": []}


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"mu": "x"}, "mu"),
        ({"sigma": -1.0}, "sigma"),
        ({"n": 1.5}, "n"),
        ({"observed_s": 0.0}, "observed_s"),
        ({"factors": [{"other_agent": "human"}]}, "other_task"),
        ({"unheard_of": 1}, "unheard_of"),
    ],
)
def test_a_wrong_field_is_named(changes: dict[str, Any], told: str) -> None:
    entry = TaskTime(*KEY, 1.0, 0.1, 4).to_json() | changes
    with pytest.raises(ScenarioError, match=told):
        read({"times": [entry]})


def learnt(n: int, mu: float = 2.0, sigma: float = 0.1) -> TaskTimes:
    factor = Factor("human", "put", 0.7, n)
    return TaskTimes({KEY: TaskTime(*KEY, mu, sigma, n, (factor,), np.eye(3) / max(n, 1), math.exp(mu))}, {})


def blended(n: int, guess_s: float, weight: float = PRIOR_WEIGHT) -> TaskTime:
    return with_guesses(learnt(n), {KEY: guess_s}, weight).times[KEY]


def test_a_guess_stands_in_for_what_nobody_has_seen() -> None:
    for known in (NOTHING, TaskTimes({KEY: TaskTime(*KEY, 9.0, 9.0, 0)}, {})):
        time = with_guesses(known, {KEY: 5.0}).times[KEY]
        assert (time.mu, time.sigma, time.n, time.guess_s, time.source) == (math.log(5), GUESS_SIGMA, 0, 5.0, "guess")
        assert time.covariance is not None
        assert np.diag(time.covariance).tolist() == [GUESS_SIGMA**2, 1 / (2 * PRIOR_WEIGHT)]


def test_a_guess_that_counts_nothing_changes_nothing_that_was_learnt() -> None:
    time = blended(5, 100.0, weight=0.0)
    assert (time.mu, time.sigma) == (2.0, pytest.approx(0.1))


def test_a_guess_fades_as_executions_are_seen() -> None:
    guess_s = 20.0
    means = [math.log(guess_s), *(blended(n, guess_s).mu for n in (1, 2, 4, 8, 16, 1000, 10**9))]
    assert means == sorted(means, reverse=True)
    assert means[-1] == pytest.approx(2.0, abs=1e-8)
    assert blended(10**9, guess_s).sigma == pytest.approx(0.1, abs=1e-6)
    assert blended(2, guess_s).mu == pytest.approx((math.log(guess_s) + 2.0) / 2)  # it is worth two executions
    assert blended(2, guess_s).source == "blend"


@given(st.integers(1, 500), st.floats(0.1, 100.0), st.floats(1e-6, 50.0))
def test_a_blend_lies_between_and_moves_with_the_guess(n: int, guess_s: float, more: float) -> None:
    time, other = blended(n, guess_s), blended(n, guess_s + more)
    low, high = sorted((2.0, math.log(guess_s)))
    assert low - 1e-12 <= time.mu <= high + 1e-12
    assert 0 <= other.mu - time.mu <= math.log1p(more / guess_s) + 1e-12
    assert time.sigma >= min(0.1, GUESS_SIGMA)
    assert abs(blended(n + 1, guess_s).mu - time.mu) <= (high - low) / n  # no jump from one execution to the next


def test_a_blend_keeps_the_factors_and_what_is_not_certain_of_them() -> None:
    known = learnt(4)
    time, before = with_guesses(known, {KEY: 20.0}).times[KEY], known.times[KEY]
    assert (time.factors, time.observed_s, time.n) == (before.factors, before.observed_s, 4)
    assert time.covariance is before.covariance


def test_a_blend_of_two_that_contradict_each_other_is_less_certain_than_either() -> None:
    assert blended(2, math.exp(2.0)).sigma == pytest.approx(math.sqrt((GUESS_SIGMA**2 + 0.1**2) / 2))
    assert blended(2, 100.0).sigma > 1.0


def test_times_with_guesses_are_sorted_and_guesses_of_others_are_added() -> None:
    known = TaskTimes({("b", "x"): TaskTime("b", "x", 1.0, 0.1, 3)}, {"b": Gap("b", 1.0, 0.1, 3)})
    found = with_guesses(known, {("c", "x"): 1.0, ("a", "z"): 1.0, ("a", "x"): 1.0})
    assert list(found.times) == [("a", "x"), ("a", "z"), ("b", "x"), ("c", "x")]
    assert found.times["b", "x"] is known.times["b", "x"]
    assert found.times["b", "x"].source == "learnt"
    assert found.gaps is known.gaps


def test_what_was_observed_of_a_pair_goes_one_way() -> None:
    times = learnt(3)
    assert times.observed(KEY, ("human", "put"))
    assert not times.observed(("human", "put"), KEY)
    assert not times.observed(KEY, ("human", "pick"))
