"""Makespans against the simulator's, and for every plan an end."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from interval_frames import Row, frame, row, rows

from hrclog.analyzers.prediction.makespan import Step, mean_gaps_s, predicted_makespan_s
from hrclog.analyzers.segments import AgentTask
from hrclog.events import TaskEnded, TaskStarted
from hrclog.plan import Plan
from hrclog.sim.run import plan_of, simulate_run
from hrclog.sim.scenario import TIMED, Gap, Lognormal, Scenario, Synergy, load_scenario

pytestmark = pytest.mark.slow

S = 1_000_000_000


def no_effect(_: AgentTask, __: AgentTask) -> float:
    return 0.0


def together(
    sequences: Mapping[str, list[Step]],
    gaps: Mapping[str, float] | None = None,
    starts: Mapping[str, float] | None = None,
    factors: Mapping[tuple[AgentTask, AgentTask], float] | None = None,
) -> float:
    return predicted_makespan_s(
        sequences,
        gaps or dict.fromkeys(sequences, 0.0),
        starts or dict.fromkeys(sequences, 0.0),
        lambda key, other: (factors or {}).get((key, other), 0.0),
    )


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


def predicted(scenario: Scenario, plan: Plan) -> float:
    timed = scenario.dispatch_mode == TIMED
    gaps = {agent: scenario.gap[agent].median_s if agent in scenario.gap else 0.0 for agent in plan.agents()}
    sequences, starts = {}, {}
    for agent in plan.agents():
        queue = plan.queue(agent)
        sequences[agent] = [
            Step(
                item.task,
                scenario.work[agent, item.task].time.median_s,
                item.planned_start_s or 0 if timed else -math.inf,
            )
            for item in queue
        ]
        starts[agent] = gaps[agent] + (queue[0].planned_start_s or 0 if timed else 0)
    logs = {key: math.log(factor) for key, factor in scenario.factors.items()}
    return predicted_makespan_s(sequences, gaps, starts, lambda key, other: logs.get((key, other), 0.0))


def simulated(scenario: Scenario, plan: Plan) -> float:
    events = simulate_run(scenario, 1, 0, plan).events
    starts = [event.time_ns for event in events if isinstance(event, TaskStarted)]
    ends = [event.time_ns for event in events if isinstance(event, TaskEnded)]
    return (max(ends) - min(starts)) / 1e9


@pytest.mark.parametrize("name", ["paper", "three-agents", "machine-tending"])
@pytest.mark.parametrize(("mode", "stretch"), [("sequential", 1.0), (TIMED, 1.0), (TIMED, 1.7)])
@pytest.mark.parametrize("gap_s", [0.0, 0.8])
def test_without_chance_the_makespan_is_that_of_the_simulator(
    name: str, mode: str, stretch: float, gap_s: float
) -> None:
    scenario = certain(name, mode, gap_s)
    for index in range(6):
        plan = stretched(plan_of(scenario, 7, index), stretch)
        assert predicted(scenario, plan) == pytest.approx(simulated(scenario, plan), abs=1e-6)


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
    assert predicted(scenario, plan) == pytest.approx(simulated(scenario, plan), rel=1e-6, abs=1e-5)


def test_one_agent_alone_takes_its_work_and_its_gaps() -> None:
    steps = [Step("a", 2.0), Step("b", 3.0), Step("a", 4.0)]
    assert together({"H": steps}, {"H": 0.5}, {"H": 7.0}) == pytest.approx(2 + 3 + 4 + 2 * 0.5)


def test_two_agents_slow_each_other_while_both_run() -> None:
    a, b = ("H", "a"), ("R", "b")
    found = together({"H": [Step("a", 2.0)], "R": [Step("b", 6.0)]}, factors={(a, b): math.log(2), (b, a): math.log(4)})
    assert found == pytest.approx(4 + (6 - 4 / 4))


def test_the_rates_of_several_others_multiply() -> None:
    key = ("H", "a")
    factors = {(key, ("R", "b")): math.log(2), (key, ("S", "c")): math.log(3)}
    sequences = {"H": [Step("a", 1.0)], "R": [Step("b", 100.0)], "S": [Step("c", 100.0)], "T": []}
    assert together(sequences, factors=factors) == pytest.approx(100)
    assert together(sequences | {"R": [Step("b", 5.0)], "S": [Step("c", 5.0)]}, factors=factors) == pytest.approx(
        5 + 1 / 6
    )


def test_a_planned_start_is_waited_for_and_a_late_agent_does_not_wait() -> None:
    early, late = Step("b", 1.0, 10.0), Step("b", 1.0, 1.0)
    assert together({"H": [Step("a", 2.0), early]}, {"H": 0.5}) == pytest.approx(10 + 0.5 + 1)
    assert together({"H": [Step("a", 2.0), late]}, {"H": 0.5}) == pytest.approx(2 + 0.5 + 1)


def test_the_makespan_counts_from_the_first_start() -> None:
    sequences = {"H": [Step("a", 2.0)], "R": [Step("b", 1.0)]}
    assert together(sequences, starts={"H": 5.0, "R": 8.0}) == pytest.approx(4)


WORK = st.one_of(st.just(0.0), st.floats(1e-9, 1e9))
STEPS = st.lists(
    st.builds(Step, st.sampled_from("ab"), WORK, st.one_of(st.just(-math.inf), st.floats(-1e6, 1e6))), max_size=5
)
LOGS = st.one_of(st.just(0.0), st.floats(-7, 7), st.floats(-200, 200))


@settings(max_examples=150)
@given(st.dictionaries(st.sampled_from("HRS"), STEPS, min_size=1), st.data())
def test_every_plan_comes_to_an_end_not_before_anybody_is_through(
    sequences: dict[str, list[Step]], data: st.DataObject
) -> None:
    if not any(sequences.values()):
        sequences = {"H": [Step("a", 1.0)]}
    times = st.one_of(st.just(0.0), st.floats(0, 1e6))
    gaps = {agent: data.draw(times) for agent in sequences}
    starts = {agent: data.draw(times) for agent in sequences}
    keys = [(agent, task) for agent in "HRS" for task in "ab"]
    factors = {(key, other): data.draw(LOGS) for key in keys for other in keys if key[0] != other[0]}
    found = together(sequences, gaps, starts, factors)
    assert math.isfinite(found)
    assert found >= 0
    alone = together(sequences, gaps, starts)
    least = max(sum(step.work_s for step in steps) for steps in sequences.values())
    assert alone >= least * (1 - 1e-9) - 1e-6


@settings(max_examples=30)
@given(st.lists(WORK, min_size=1, max_size=5), st.lists(WORK, min_size=1, max_size=5), st.floats(1e-3, 1e3))
def test_time_has_no_unit(one: list[float], other: list[float], unit: float) -> None:
    factors = {(("H", "a"), ("R", "b")): 0.8, (("R", "b"), ("H", "a")): -0.3}

    def scaled(by: float) -> float:
        sequences = {"H": [Step("a", by * work) for work in one], "R": [Step("b", by * work) for work in other]}
        return together(sequences, {"H": by, "R": 2 * by}, {"H": 0.0, "R": by}, factors)

    assert scaled(unit) == pytest.approx(unit * scaled(1.0), rel=1e-6)


def spans(agent: str, run: str, *times: tuple[int, int, int | None]) -> list[Row]:
    return [
        row(agent, "t", start * S, end * S, planned_start_ns=None if planned is None else planned * S, run_id=run)
        for start, end, planned in times
    ]


def test_gaps_are_from_when_an_agent_could_start_until_it_does() -> None:
    found = [
        *spans("H", "a", (5, 6, 0), (8, 9, None), (12, 13, 11)),  # gaps 2 and 1, none before the first
        *spans("H", "b", (0, 4, None), (3, 5, None)),  # it overlaps itself: 0
        *spans("R", "a", (0, 9, None)),
        row("R", "home", 100 * S, 101 * S, role="auxiliary", run_id="a"),
    ]
    assert mean_gaps_s(frame(found)) == {"H": pytest.approx(1.0)}


@settings(max_examples=40)
@given(rows(max_size=12), st.integers(0, 100))
def test_gaps_do_not_depend_on_the_order_of_rows(found: list[Row], seed: int) -> None:
    planned = [one | {"planned_start_ns": one["start_ns"] - number % 7} for number, one in enumerate(found)]
    expected = mean_gaps_s(frame(planned))
    assert mean_gaps_s(frame(planned).sample(fraction=1.0, shuffle=True, seed=seed)) == expected
    assert all(gap >= 0 for gap in expected.values())


def test_gaps_of_executions_at_the_same_time_do_not_depend_on_the_order_of_rows() -> None:
    found = frame([*spans("H", "a", (0, 1, None), (5, 6, 2), (5, 6, 4))])
    assert mean_gaps_s(found) == mean_gaps_s(found.reverse())


def test_nothing_has_no_gaps() -> None:
    assert mean_gaps_s(pl.DataFrame(frame([]))) == {}
