"""Searches for plans: what they find is what judging every plan finds, and nothing beats the bound."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planning import true_times
from planning_problems import space_with, spaces
from sizes import many

from hrclog.analyzers.search.bound import lower_bound_s
from hrclog.analyzers.search.exhaustive import judge_all
from hrclog.analyzers.search.judge import Judge
from hrclog.analyzers.search.local_search import Effort, local_search
from hrclog.analyzers.search.rates import fastest, overlap_weight, slowest
from hrclog.analyzers.search.space import Space, space_of
from hrclog.analyzers.search.worlds import Worlds, drawn_worlds, expected_world
from hrclog.planning.problem import Count, Problem, Task
from hrclog.sim.scenario import load_scenario

_EFFORT = Effort(1500)


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(spaces(rules=False))
def test_local_search_finds_the_best_of_all_plans(problem: tuple[Space, Worlds]) -> None:
    judge = Judge(*problem)
    assert local_search(judge, _EFFORT).best[0].score == pytest.approx(judge_all(judge).best[0].score, rel=1e-12)


@pytest.mark.slow
@settings(max_examples=many(20, fuzz=60), deadline=None)
@given(spaces())
def test_local_search_finds_the_best_of_all_plans_whatever_the_rules(problem: tuple[Space, Worlds]) -> None:
    judge = Judge(*problem)
    every, found = judge_all(judge), local_search(judge, _EFFORT)
    assert [one.score for one in found.best[:1]] == pytest.approx([one.score for one in every.best[:1]], rel=1e-12)


@settings(max_examples=40, deadline=None)
@given(spaces())
def test_no_plan_beats_the_bound(problem: tuple[Space, Worlds]) -> None:
    best = judge_all(Judge(*problem)).best
    assert lower_bound_s(*problem) <= (best[0].score if best else math.inf) * (1 + 1e-9)


def test_an_agent_that_waits_for_a_release_does_not_start_the_clock() -> None:
    """A would be the first to start, but its task is released late: B's gap is before the first start after all."""
    tasks = (Task("x", ("A",), release_s=10.0), Task("y", ("B",)))
    problem = Problem(("A", "B"), tasks, (Count("x", 1), Count("y", 1)))
    space, world = space_with(problem, {("A", "x"): 2.0, ("B", "y"): 20.0}, 1.0, {"A": 0.1, "B": 1.0})
    assert judge_all(Judge(space, world)).best[0].score == pytest.approx(20.0)
    assert lower_bound_s(space, world) == pytest.approx(20.0)


@settings(max_examples=30, deadline=None)
@given(spaces((3,), rules=False), st.randoms(use_true_random=False))
def test_overlaps_lengthen_a_task_by_no_less_than_their_weights_say(
    problem: tuple[Space, Worlds], source: random.Random
) -> None:
    """Whatever runs beside a task, one second of it is 1 - rate longer than its work."""
    space, world = problem
    rate = world.rate[0]
    for i, (agent, _) in enumerate(space.keys):
        others = [[j for j, (name, _) in enumerate(space.keys) if name == a] for a in space.agents if a != agent]
        company = [source.choice([*row, None]) for row in others]
        beside = [j for j in company if j is not None]
        together = math.prod(rate[i, j] for j in beside)
        assert sum(overlap_weight(space.keys, rate, i, j) for j in beside) <= 1.0 - together + 1e-12
        assert slowest(space.keys, rate, i) <= together * (1 + 1e-12)
        assert together <= fastest(space.keys, rate, i) * (1 + 1e-12)


def test_with_two_agents_an_overlap_lengthens_by_one_less_the_rate() -> None:
    judge = _paper(0)
    keys, rate = judge.space.keys, judge.worlds.rate[0]
    assert overlap_weight(keys, rate, 0, len(keys) - 1) == 1.0 - rate[0, len(keys) - 1]


def _paper(worlds: int) -> Judge:
    scenario = load_scenario("paper")
    space, times = space_of(scenario.problem), true_times(scenario)
    size = space.longest()
    expected = expected_world(times, space.keys, space.agents, size)
    return Judge(space, drawn_worlds(times, space.keys, space.agents, size, worlds, 1) if worlds else expected)


@pytest.mark.slow
def test_the_paper_s_cell_has_225_plans_and_both_searches_find_the_same_best() -> None:
    judge = _paper(0)
    every = judge_all(judge)
    found = local_search(judge, Effort(3000))
    assert (every.judged, every.exhaustive, found.exhaustive) == (225, True, False)
    assert every.best[0] == found.best[0]
    assert [one.score for one in every.best] == sorted(one.score for one in every.best)
    assert 100 < found.judged <= 225, "none is judged twice"
    assert found.stopped == f"nothing better in {found.judged:,} plans"


@pytest.mark.slow
def test_the_same_seed_finds_the_same_plans() -> None:
    judge = _paper(4)
    first, again = (local_search(judge, Effort(1500), seed=7) for _ in range(2))
    assert first == again
    assert local_search(judge, Effort(1500), seed=8).judged > 0


def test_the_scores_of_plans_do_not_depend_on_their_order_or_number(monkeypatch: pytest.MonkeyPatch) -> None:
    judge = _paper(6)
    candidates = list(judge.space.candidates())
    scores = judge.scores(candidates)
    order = np.random.default_rng(2).permutation(len(candidates))
    assert (judge.scores([candidates[index] for index in order]) == scores[order]).all()
    assert judge.scores(candidates[17:18])[0] == scores[17]
    monkeypatch.setattr("hrclog.analyzers.search.judge.MOST_LANES", 42)
    assert (judge.scores(candidates) == scores).all()
    assert len(judge.scores([])) == 0


def test_a_search_begins_with_the_plans_it_is_given() -> None:
    judge = _paper(0)
    best = judge_all(judge).best[0]
    found = local_search(judge, Effort(0), starts=[best.candidate])
    assert found.best[0] == best


def test_a_search_stops_when_its_time_is_over() -> None:
    found = local_search(_paper(0), Effort(10**9, 0.01))
    assert (found.stopped, found.exhaustive) == ("after 0.01 s", False)
    assert found.best


def test_a_task_that_is_late_costs_more_than_any_makespan() -> None:
    judge = _paper(0)
    problem = judge.space.problem
    late = replace(problem, tasks=tuple(replace(t, due_s=40.0) if "orange" in t.name else t for t in problem.tasks))
    space = space_of(late)
    best = judge_all(Judge(space, judge.worlds)).best[0]
    orange_last = [c for c in space.candidates() if c[1][:2] == (3, 3)]
    assert best.score < min(Judge(space, judge.worlds).scores(orange_last))
    assert best.score > 1e5


def test_a_world_without_synergies_has_its_bound_reached() -> None:
    scenario = load_scenario("paper")
    space = space_of(scenario.problem)
    times = true_times(scenario)
    world = expected_world(times, space.keys, space.agents, space.longest(), synergies=False)
    assert judge_all(Judge(space, world)).best[0].score == pytest.approx(lower_bound_s(space, world))


def test_a_search_ends_where_there_is_nothing_more_to_find() -> None:
    given = load_scenario("paper").problem
    lonely = Problem(given.agents, given.tasks[:1], (Count(given.tasks[0].name, 2, given.tasks[0].agents[0]),))
    space = space_of(lonely)
    times = true_times(load_scenario("paper"))
    judge = Judge(space, expected_world(times, space.keys, space.agents, space.longest()))
    found = local_search(judge, Effort(10**9))
    assert found.best == judge_all(judge).best
    assert found.stopped.startswith("nothing better")
