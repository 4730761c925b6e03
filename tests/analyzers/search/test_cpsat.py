"""The constraint solver: what it says of a plan is what the evaluator says, and its bound holds."""

from __future__ import annotations

import math
import sys
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from planning import true_times
from planning_problems import space_with, spaces
from sizes import many

from hrclog.analyzers.search.cpsat import CpSat, cpsat
from hrclog.analyzers.search.exhaustive import judge_all
from hrclog.analyzers.search.judge import Judge
from hrclog.analyzers.search.space import Space, space_of
from hrclog.analyzers.search.worlds import Worlds, drawn_worlds, expected_world
from hrclog.errors import ScenarioError
from hrclog.planning.problem import Count, Problem, Task
from hrclog.sim.scenario import load_scenario

pytestmark = pytest.mark.slow  # each test lets the solver work

_ROUNDING_S = 0.01


def _cell(name: str, fewer: int = 0) -> tuple[Space, Worlds]:
    """Return what is to be planned in a cell, and how long it takes; each agent may have fewer of each task to do."""
    scenario = load_scenario(name)
    counts = tuple(replace(count, count=count.count - fewer) for count in scenario.problem.counts)
    space = space_of(replace(scenario.problem, counts=counts))
    return space, expected_world(true_times(scenario), space.keys, space.agents, space.longest())


def _check(problem: tuple[Space, Worlds], found: CpSat) -> None:
    best = judge_all(Judge(*problem)).best
    if not best:
        assert not found.search.best
        return
    assert math.isfinite(found.objective_s), "the plan that is proposed keeps all constraints"
    assert found.bound_s <= best[0].score * (1 + 1e-9)
    assert found.search.best[0].score == pytest.approx(best[0].score, rel=1e-12)
    assert all(math.isfinite(one.score) for one in found.search.best)
    if found.optimal:
        assert best[0].score - found.bound_s <= _ROUNDING_S


@settings(max_examples=5, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(spaces((2,), rules=False))
def test_without_rules_the_solver_s_makespan_is_the_evaluator_s(problem: tuple[Space, Worlds]) -> None:
    found = cpsat(*problem, 5.0)
    _check(problem, found)
    if not found.search.stopped:
        assert found.optimal
        assert found.objective_s == pytest.approx(found.search.best[0].score, abs=_ROUNDING_S)


def test_what_helps_makes_tasks_shorter_than_their_work() -> None:
    problem = Problem(("A", "B"), (Task("x", ("A",)), Task("y", ("B",))), (Count("x", 1), Count("y", 1)))
    found = cpsat(*space_with(problem, {("A", "x"): 4.0, ("B", "y"): 4.0}, 2.0, {"A": 0.2, "B": 0.2}), 10.0)
    assert (found.optimal, found.objective_s) == (True, pytest.approx(2.0, abs=_ROUNDING_S))


def test_a_run_that_begins_late_is_not_cut_short() -> None:
    problem = Problem(("A",), (Task("x", ("A",), release_s=50.0),), (Count("x", 2),))
    found = cpsat(*space_with(problem, {("A", "x"): 2.0}, 1.0, {"A": 0.5}), 10.0)
    assert (found.optimal, found.objective_s) == (True, pytest.approx(4.5, abs=_ROUNDING_S))


def test_a_break_that_would_pay_is_no_choice_that_a_plan_has() -> None:
    """The works of x and z differ by 1 s; if A waited for that second, y and z would not slow each other down."""
    tasks = (Task("x", ("A",)), Task("y", ("A",)), Task("z", ("B",)))
    problem = Problem(("A", "B"), tasks, tuple(Count(task.name, 1) for task in tasks))
    work = {("A", "x"): 10.0, ("A", "y"): 10.0, ("B", "z"): 11.0}
    space, world = space_with(problem, work, 0.2, {"A": 0.0, "B": 0.0})
    world.rate[0, 0, 2] = world.rate[0, 2, 0] = 1.0
    found = cpsat(space, world, 20.0)
    assert found.search.best[0].score == pytest.approx(24.0)
    assert (found.optimal, found.objective_s) == (True, pytest.approx(24.0, abs=_ROUNDING_S))


@pytest.mark.slow
@settings(max_examples=many(8, fuzz=40), deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(spaces(dues=False))
def test_no_plan_beats_the_solver_s_bound_whatever_the_rules(problem: tuple[Space, Worlds]) -> None:
    _check(problem, cpsat(*problem, 2.0))


def test_the_best_plan_of_the_kitting_cell_is_proved_although_its_agents_wait() -> None:
    problem = _cell("kitting")
    found = cpsat(*problem, 60.0)
    _check(problem, found)
    assert found.optimal
    assert found.search.stopped == ""
    assert found == cpsat(*problem, 60.0), "the same again"


@pytest.mark.slow
def test_the_best_plan_of_the_paper_s_cell_is_proved() -> None:
    problem = _cell("paper", fewer=many(1, fuzz=0))
    found = cpsat(*problem, 180.0)
    _check(problem, found)
    assert found.optimal


def test_a_solver_stopped_by_time_says_so_and_still_has_a_plan() -> None:
    space, world = _cell("paper")
    found = cpsat(space, world, 0.2, starts=[next(space.candidates())])
    assert (found.search.stopped, found.optimal) == ("after 0.2 s", False)
    assert found.bound_s <= found.search.best[0].score


def test_without_or_tools_the_message_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ortools", None)
    with pytest.raises(ScenarioError, match=r"pip install 'hrclog\[plan\]'"):
        cpsat(*_cell("paper"), 1.0)


def test_what_the_solver_cannot_weigh_is_refused() -> None:
    space, world = _cell("paper")
    due = replace(space.problem, tasks=tuple(replace(task, due_s=50.0) for task in space.problem.tasks))
    with pytest.raises(ScenarioError, match="due time, not supported"):
        cpsat(space_of(due), world, 1.0)
    with pytest.raises(ScenarioError, match="begun"):
        cpsat(replace(space, begun={"human": ("pick_white_box",)}), world, 1.0)
    scenario = load_scenario("paper")
    drawn = drawn_worlds(true_times(scenario), space.keys, space.agents, space.longest(), 4)
    with pytest.raises(ScenarioError, match="4 worlds"):
        cpsat(space, drawn, 1.0)
