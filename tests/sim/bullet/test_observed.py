"""The truth about a campaign of the stepped cell: what its runs counted, summed up."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from cells import small_cell, small_scenario
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.sim.bullet.observed import LEAST_PROGRESS_S, observed_truth
from hrclog.sim.bullet.stepped import TICK_S
from hrclog.sim.truth import (
    ExecutionTruth,
    PairTruth,
    RunTruth,
    SynergyTruth,
    TaskTruth,
    Truth,
    read_truth,
    write_truth,
)

CELL = small_cell({"faults": [{"agent": "robot", "task": "carry_red", "probability": 0.25, "reason": "slipped"}]})
SCENARIO = small_scenario(CELL, (("robot", "carry_red"), ("human", "carry_white"), ("human", "go_home")))
RED, WHITE, HOME = ("robot", "carry_red"), ("human", "carry_white"), ("human", "go_home")


def execution(key: tuple[str, str], work_s: float, outcome: str = "succeeded") -> ExecutionTruth:
    return ExecutionTruth("e", "i", *key, 1, outcome, work_s, 0.25, 0.5)


def run(*parts: ExecutionTruth | PairTruth, contacts: int | None = 0) -> RunTruth:
    executions = tuple(part for part in parts if isinstance(part, ExecutionTruth))
    return RunTruth("r", "n", executions, tuple(part for part in parts if isinstance(part, PairTruth)), contacts)


def truth_of(*runs: RunTruth) -> Truth:
    return observed_truth(SCENARIO, CELL, 3, "bullet", runs)


def task(truth: Truth, key: tuple[str, str]) -> TaskTruth:
    return next(one for one in truth.tasks if (one.agent, one.task) == key)


def synergy(truth: Truth, key: tuple[str, str], other: tuple[str, str]) -> SynergyTruth:
    return next(
        one for one in truth.synergies if (one.agent, one.task, one.other_agent, one.other_task) == (*key, *other)
    )


def test_work_is_fitted_to_what_succeeded() -> None:
    truth = truth_of(
        run(execution(RED, 2.0), execution(RED, 8.0), execution(RED, 100.0, "failed")),
        run(execution(WHITE, 5.0), execution(WHITE, 0.0)),  # nothing was left to do
    )
    red = task(truth, RED)
    assert (red.mu, red.sigma) == pytest.approx((math.log(4.0), math.log(2.0)))
    assert red.failure_probability == 0.25
    white = task(truth, WHITE)
    assert (white.mu, white.sigma, white.failure_probability) == (math.log(5.0), 0.0, 0.0)
    assert (truth.engine, truth.seed, truth.safety) == ("bullet", 3, "areas")


def test_a_task_that_nobody_has_seen_has_a_row_without_numbers() -> None:
    home = task(truth_of(run(execution(RED, 2.0))), HOME)
    assert (home.mu, home.sigma) == (None, None)


def test_a_factor_is_overlap_by_progress_over_all_runs() -> None:
    truth = truth_of(run(PairTruth(*RED, *WHITE, 4.0, 1.0, 2.0)), run(PairTruth(*RED, *WHITE, 2.0, 2.0, 2.0)))
    red = synergy(truth, RED, WHITE)
    assert (red.synergy, red.caused, red.overlap_s) == (2.0, 1.5, 6.0)


def test_there_is_no_factor_where_hardly_anything_was_done_or_nothing_was_seen() -> None:
    truth = truth_of(run(PairTruth(*RED, *WHITE, 3.0, 0.0099, 1.5), PairTruth(*WHITE, *RED, 3.0, 0.01, 0.0)))
    red, white = synergy(truth, RED, WHITE), synergy(truth, WHITE, RED)
    assert (red.synergy, red.caused, red.overlap_s) == (None, 2.0, 3.0)
    assert (white.synergy, white.caused) == (pytest.approx(300.0), None)
    unseen = synergy(truth, RED, HOME)
    assert (unseen.synergy, unseen.caused, unseen.overlap_s) == (None, None, 0.0)


def test_hardly_anything_is_less_than_a_tick() -> None:
    assert LEAST_PROGRESS_S == TICK_S


def test_every_task_and_every_ordered_pair_has_a_row_as_in_the_other_engine() -> None:
    truth = truth_of()
    keys = SCENARIO.problem.agent_tasks()
    assert [(one.agent, one.task) for one in truth.tasks] == list(keys)
    assert [(one.agent, one.task, one.other_agent, one.other_task) for one in truth.synergies] == [
        (*key, *other) for key in keys for other in keys if key[0] != other[0]
    ]


seconds = st.integers(0, 3000).map(lambda ticks: ticks / 100)
keys = st.sampled_from([RED, WHITE])
pairs = st.builds(
    lambda turned, times: PairTruth(*(*WHITE, *RED) if turned else (*RED, *WHITE), *sorted(times, reverse=True)),
    st.booleans(),
    st.tuples(seconds, seconds, seconds),
)
executions = st.builds(execution, keys, seconds, st.sampled_from(["succeeded", "failed"]))
run_lists = st.lists(st.lists(st.one_of(pairs, executions), max_size=4).map(lambda parts: run(*parts)), max_size=5)


@given(run_lists, st.randoms(use_true_random=False))
@settings(max_examples=30)
def test_neither_the_order_of_the_runs_nor_their_bounds_matter(runs: list[RunTruth], random: object) -> None:
    truth = truth_of(*runs)
    turned = list(runs)
    random.shuffle(turned)  # type: ignore[attr-defined] - hypothesis gives a Random
    one = run(*(part for each in turned for part in (*each.executions, *each.pairs)))
    for other in (truth_of(*turned), truth_of(one)):
        assert other.tasks == truth.tasks
        assert other.synergies == truth.synergies


@given(run_lists)
@settings(max_examples=30)
def test_the_same_runs_twice_are_the_same_truth_and_factors_are_never_below_one(runs: list[RunTruth]) -> None:
    once, twice = truth_of(*runs), truth_of(*runs, *runs)
    for one, two in zip(once.synergies, twice.synergies, strict=True):
        if one.synergy is not None:
            assert two.synergy == pytest.approx(one.synergy)
            assert one.synergy >= 1.0
        assert two.overlap_s == pytest.approx(2.0 * (one.overlap_s or 0.0))
    for one_task, two_task in zip(once.tasks, twice.tasks, strict=True):
        assert two_task.mu == pytest.approx(one_task.mu)
        assert two_task.sigma == pytest.approx(one_task.sigma)


@given(run_lists)
@settings(max_examples=20)
def test_what_was_observed_comes_back_from_its_file(tmp_path: Path, runs: list[RunTruth]) -> None:
    path = tmp_path / "truth.json"
    path.unlink(missing_ok=True)
    truth = truth_of(*runs)
    write_truth(path, truth)
    assert read_truth(path) == truth
