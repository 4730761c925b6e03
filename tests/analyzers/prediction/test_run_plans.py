"""Makespans of runs to predict against the simulator's, and for every run an end."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from interval_frames import Row, frame, row

from hrclog.analyzers.prediction.plan_cells import plan_cells
from hrclog.analyzers.prediction.run_plans import RunPlan, run_plans
from hrclog.analyzers.projections.joint_states import AgentTask
from hrclog.analyzers.synergy.fit import TaskModel
from hrclog.analyzers.synergy.log_work import NormalLogWork
from hrclog.events import TaskEnded, TaskStarted
from hrclog.planning.dispatch_mode import DispatchMode
from hrclog.planning.plan import Plan
from hrclog.sim.run import plan_of, simulate_run
from hrclog.sim.scenario import Gap, Lognormal, Scenario, Synergy, load_scenario

pytestmark = pytest.mark.slow

S = 1_000_000_000

Item = tuple[str, float | None]
"""A task and its planned start in seconds."""


def plan_of_rows(rows: Sequence[Row]) -> RunPlan:
    """Return what the one run of some rows was to do."""
    intervals = frame(rows)
    [(_, found)] = run_plans(intervals, plan_cells(intervals)).items()
    return found


def run_of(items: Mapping[str, Sequence[Item]], starts_s: Mapping[str, float]) -> RunPlan:
    """Return what a run was to do whose executions last a second each, one after the other."""
    first = min(starts_s.get(agent, 0.0) for agent, queue in items.items() if queue)
    return plan_of_rows(
        [
            row(
                agent,
                task,
                round((starts_s.get(agent, 0.0) + place) * S),
                round((starts_s.get(agent, 0.0) + place + 1) * S),
                planned_start_ns=None if planned is None else round((planned + first) * S),
                position=place,
            )
            for agent, queue in items.items()
            for place, (task, planned) in enumerate(queue)
        ]
    )


Factors = Mapping[tuple[AgentTask, AgentTask], float]


def predicted(
    plan: RunPlan,
    work_s: Mapping[AgentTask, float],
    gaps_s: Mapping[str, float] | None = None,
    logs: Factors | None = None,
) -> float:
    """Return the makespan where every task takes its work for certain."""

    def model_of(key: AgentTask, _: str) -> TaskModel:
        factors = {other: log_s for (own, other), log_s in (logs or {}).items() if own == key}
        return TaskModel(factors, NormalLogWork(math.log(work_s[key]), 0.0))

    found = plan.predicted_s(model_of, gaps_s or {})
    assert found is not None
    return found


def certain(name: str, mode: str, gap_s: float) -> Scenario:
    """Return a scenario without chance: no spread, no failures, no waiting for another agent."""
    scenario = load_scenario(name)
    agents = scenario.problem.agents
    return replace(
        scenario,
        problem=replace(scenario.problem, precedences=()),
        works=tuple(
            replace(work, time=replace(work.time, sigma=0.0), failure_probability=0.0) for work in scenario.works
        ),
        synergies=tuple(one for one in scenario.synergies if not math.isinf(one.factor)),
        gaps=tuple(Gap(agent, Lognormal(gap_s * (n + 1), 0.0)) for n, agent in enumerate(agents)) if gap_s else (),
        dispatch_mode=mode,
    )


def stretched(plan: Plan, factor: float) -> Plan:
    """Return a plan whose planned starts are further apart."""
    items = [
        replace(item, planned_start_s=(item.planned_start_s or 0) * factor, planned_end_s=None) for item in plan.items
    ]
    return replace(plan, items=tuple(items))


def predicted_of(scenario: Scenario, plan: Plan) -> float:
    timed = scenario.dispatch_mode == DispatchMode.TIMED
    gaps = {agent: scenario.gap[agent].median_s if agent in scenario.gap else 0.0 for agent in plan.agents()}
    queues = {agent: plan.queue(agent) for agent in plan.agents()}
    starts = {agent: gaps[agent] + (queue[0].planned_start_s or 0 if timed else 0) for agent, queue in queues.items()}
    first = min(starts.values())
    items = {
        agent: [(item.task, (item.planned_start_s or 0) - first if timed else None) for item in queue]
        for agent, queue in queues.items()
    }
    logs = {key: math.log(factor) for key, factor in scenario.factors.items()}
    works = {key: work.time.median_s for key, work in scenario.work.items()}
    return predicted(run_of(items, starts), works, gaps, logs)


def simulated(scenario: Scenario, plan: Plan) -> float:
    events = simulate_run(scenario, 1, 0, plan).events
    starts = [event.time_ns for event in events if isinstance(event, TaskStarted)]
    ends = [event.time_ns for event in events if isinstance(event, TaskEnded)]
    return (max(ends) - min(starts)) / 1e9


@pytest.mark.parametrize("name", ["paper", "three-agents", "machine-tending"])
@pytest.mark.parametrize(
    ("mode", "stretch"), [("sequential", 1.0), (DispatchMode.TIMED, 1.0), (DispatchMode.TIMED, 1.7)]
)
@pytest.mark.parametrize("gap_s", [0.0, 0.8])
def test_without_chance_the_makespan_is_that_of_the_simulator(
    name: str, mode: str, stretch: float, gap_s: float
) -> None:
    scenario = certain(name, mode, gap_s)
    for index in range(6):
        plan = stretched(plan_of(scenario, 7, index), stretch)
        assert predicted_of(scenario, plan) == pytest.approx(simulated(scenario, plan), abs=1e-6)


def test_huge_factors_are_those_of_the_simulator_too() -> None:
    scenario = certain("paper", "sequential", 0.3)
    keys = scenario.problem.agent_tasks()
    factors = [
        Synergy(*key, *other, factor)
        for n, key in enumerate(keys)
        for other, factor in zip(keys, (1e3, 1.0, 1e-3, 2.0, 0.5, 30.0, 1.0, 1e2)[n:] + (1.0,) * n, strict=True)
        if key[0] != other[0]
    ]
    scenario = replace(scenario, synergies=tuple(factors))
    plan = plan_of(scenario, 3, 0)
    assert predicted_of(scenario, plan) == pytest.approx(simulated(scenario, plan), rel=1e-6, abs=1e-5)


def test_one_agent_alone_takes_its_work_and_its_gaps() -> None:
    plan = run_of({"H": [("a", None), ("b", None), ("a", None)]}, {"H": 7.0})
    assert predicted(plan, {("H", "a"): 2.0, ("H", "b"): 3.0}, {"H": 0.5}) == pytest.approx(2 + 3 + 2 + 2 * 0.5)


def test_two_agents_slow_each_other_while_both_run() -> None:
    a, b = ("H", "a"), ("R", "b")
    plan = run_of({"H": [("a", None)], "R": [("b", None)]}, {})
    found = predicted(plan, {a: 2.0, b: 6.0}, logs={(a, b): math.log(2), (b, a): math.log(4)})
    assert found == pytest.approx(4 + (6 - 4 / 4))


def test_the_rates_of_several_others_multiply() -> None:
    key = ("H", "a")
    logs = {(key, ("R", "b")): math.log(2), (key, ("S", "c")): math.log(3)}
    plan = run_of({"H": [("a", None)], "R": [("b", None)], "S": [("c", None)]}, {})
    for others_s, expected in ((100.0, 100.0), (5.0, 5 + 1 / 6)):
        works = {key: 1.0, ("R", "b"): others_s, ("S", "c"): others_s}
        assert predicted(plan, works, logs=logs) == pytest.approx(expected)


def test_a_planned_start_is_waited_for_and_a_late_agent_does_not_wait() -> None:
    works = {("H", "a"): 2.0, ("H", "b"): 1.0}
    for planned, expected in ((10.0, 10 + 0.5 + 1), (1.0, 2 + 0.5 + 1)):
        plan = run_of({"H": [("a", None), ("b", planned)]}, {})
        assert predicted(plan, works, {"H": 0.5}) == pytest.approx(expected)


def test_the_first_item_of_an_agent_starts_when_it_did_whatever_was_planned() -> None:
    plan = run_of({"H": [("a", 3.0)], "R": [("b", 50.0)]}, {"H": 5.0, "R": 8.0})
    assert predicted(plan, {("H", "a"): 2.0, ("R", "b"): 1.0}, {"H": 9.0, "R": 9.0}) == pytest.approx(4)


def test_executions_of_a_task_may_have_models_of_their_own() -> None:
    plan = plan_of_rows([row("H", "a", place * S, place * S + S, position=place) for place in range(3)])
    works = dict(zip(plan.cells[0], (1.0, 20.0, 300.0), strict=True))
    found = plan.predicted_s(lambda _, cell: TaskModel({}, NormalLogWork(math.log(works[cell]), 0.0)), {})
    assert found == pytest.approx(sum(works.values()))
    assert plan.observed_s == 3.0


PLANNED = st.one_of(st.none(), st.floats(-1e3, 1e3))
ITEMS = st.lists(st.tuples(st.sampled_from("ab"), PLANNED), min_size=1, max_size=5)
WORK = st.floats(1e-6, 1e4)


@settings(max_examples=60)
@given(st.dictionaries(st.sampled_from("HRS"), ITEMS, min_size=1), st.data())
def test_every_run_comes_to_an_end_not_before_anybody_is_through(
    items: dict[str, list[Item]], data: st.DataObject
) -> None:
    times = st.one_of(st.just(0.0), st.floats(0, 1e3))
    plan = run_of(items, {agent: data.draw(times) for agent in items})
    gaps = {agent: data.draw(times) for agent in items}
    keys = [(agent, task) for agent in "HRS" for task in "ab"]
    works = {key: data.draw(WORK) for key in keys}
    logs = {(key, other): data.draw(st.floats(-7, 7)) for key in keys for other in keys if key[0] != other[0]}
    found = predicted(plan, works, gaps, logs)
    assert math.isfinite(found)
    assert found >= 0
    least = max(sum(works[agent, task] for task, _ in queue) for agent, queue in items.items())
    assert predicted(plan, works, gaps) >= least * (1 - 1e-9) - 1e-6


@settings(max_examples=30)
@given(st.lists(WORK, min_size=2, max_size=2), st.floats(1e-3, 1e3))
def test_time_has_no_unit(work_s: list[float], unit: float) -> None:
    a, b = ("H", "a"), ("R", "b")
    plan = run_of({"H": [("a", None)] * 3, "R": [("b", None)] * 4}, {})

    def scaled(by: float) -> float:
        works = dict(zip((a, b), (by * work for work in work_s), strict=True))
        return predicted(plan, works, {"H": by, "R": 2 * by}, {(a, b): 0.8, (b, a): -0.3})

    assert scaled(unit) == pytest.approx(unit * scaled(1.0), rel=1e-6)


def test_runs_without_executions_that_count_have_no_plan() -> None:
    home = frame([row("H", "home", 0, S, role="auxiliary")])
    assert run_plans(home, plan_cells(home)) == {}
    nothing = pl.DataFrame(frame([]))
    assert run_plans(nothing, plan_cells(nothing)) == {}
