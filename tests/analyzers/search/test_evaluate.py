"""Plans judged by exact discrete events: equal to the simulator, whatever the plan and the mode."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from planning import makespan_s, timeline_s, true_times, world_of
from sizes import many

from hrclog.analyzers.search.encoded import encode_plans, encode_queues
from hrclog.analyzers.search.evaluate import Begun, evaluate
from hrclog.analyzers.search.worlds import Worlds, drawn_worlds, expected_world
from hrclog.errors import ScenarioError
from hrclog.planning.dispatch_mode import DispatchMode, schedule_of
from hrclog.planning.plan import Plan, PlanItem
from hrclog.planning.problem import Problem
from hrclog.planning.random_plans import random_plans
from hrclog.recorders.dispatch.policy import DispatchPolicy
from hrclog.sim.run import carry_out, fitting_plan
from hrclog.sim.scenario import Scenario, load_scenario


def _check(given: Scenario, mode: DispatchMode, count: int, seed: int) -> None:
    """Hold the evaluator against the discrete-event simulator, plan by plan."""
    scenario = replace(given, works=tuple(replace(work, failure_probability=0.0) for work in given.works))
    keys = scenario.problem.agent_tasks()
    policy = DispatchPolicy(mode=mode, max_wait_s=0.0)
    plans = (plan for plan in random_plans(scenario.problem, seed) if _possible(plan, mode, scenario.problem))
    for index, plan in zip(range(count), plans, strict=False):
        timed = fitting_plan(scenario, plan)
        run = carry_out(scenario, timed, seed, index, policy)
        encoded = encode_plans(scenario.problem, keys, [timed], mode)
        found = evaluate(encoded, world_of(scenario, encoded, run), timeline=True)
        assert found.makespan_s[0, 0] == pytest.approx(makespan_s(run), abs=1e-6)
        assert found.start_s is not None
        for agent, starts in timeline_s(run, encoded.agents).items():
            queue = found.start_s[0, 0, encoded.agents.index(agent), : len(starts)]
            assert queue == pytest.approx(starts, abs=1e-6)


def _possible(plan: Plan, mode: DispatchMode, problem: Problem) -> bool:
    """Return whether a plan's barriers and precedences make no circle."""
    try:
        schedule_of(plan, mode, problem)
    except ScenarioError:
        return False
    return True


@pytest.mark.parametrize("mode", [mode for mode in DispatchMode if mode is not DispatchMode.REACTIVE])
@pytest.mark.parametrize("name", ["paper", "three-agents", "machine-tending", "authors-areas"])
def test_a_plan_takes_as_long_as_the_simulator_takes_with_the_same_work(name: str, mode: DispatchMode) -> None:
    _check(load_scenario(name), mode, 12, 3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper", "three-agents"])
def test_hundreds_of_plans_take_as_long_as_in_the_simulator(name: str) -> None:
    _check(load_scenario(name), DispatchMode.SEQUENTIAL, many(250, fuzz=1000), 5)


@pytest.mark.parametrize("mode", [DispatchMode.SEQUENTIAL, DispatchMode.TIMED])
@pytest.mark.parametrize("name", ["paper", "three-agents", "kitting"])
def test_what_is_held_and_what_comes_late_is_waited_for_as_in_the_simulator(name: str, mode: DispatchMode) -> None:
    given = load_scenario(name)
    tasks = [task for task in given.problem.tasks if task.role != "auxiliary"]
    held = {
        task.name: replace(task, resources=(("vice",), ("vice", "crane"), (), ("crane",))[number % 4])
        for number, task in enumerate(tasks)
    }
    late = {tasks[-1].name: replace(held[tasks[-1].name], release_s=21.5)}
    changed = tuple((held | late).get(task.name, task) for task in given.problem.tasks)
    _check(replace(given, problem=replace(given.problem, tasks=changed)), mode, 20, 3)


def test_many_plans_and_worlds_at_once_are_each_judged_as_if_alone() -> None:
    scenario = load_scenario("three-agents")
    keys = scenario.problem.agent_tasks()
    plans = [plan for plan, _ in zip(random_plans(scenario.problem, 2), range(7), strict=False)]
    together = encode_plans(scenario.problem, keys, plans)
    worlds = drawn_worlds(true_times(scenario), keys, together.agents, together.task.shape[-1], 6, seed=1)
    found = evaluate(together, worlds).makespan_s
    for row, plan in enumerate(plans):
        for world in range(worlds.count):
            one = Worlds(*(array[world : world + 1] for array in (worlds.work_s, worlds.rate, worlds.gap_s)))
            encoded = encode_plans(scenario.problem, keys, [plan, *plans])
            assert evaluate(encoded, one).makespan_s[0, 0] == found[row, world]


@st.composite
def _two_queues(draw: st.DrawFn) -> tuple[list[float], list[float], float, float]:
    works = st.lists(st.floats(0.1, 9.0), min_size=1, max_size=5)
    return draw(works), draw(works), draw(st.floats(0.3, 4.0)), draw(st.floats(0.3, 4.0))


@given(_two_queues())
def test_work_done_is_the_integral_of_the_rate_over_each_execution(
    queues: tuple[list[float], list[float], float, float],
) -> None:
    first, second, factor, other_factor = queues
    keys = [("A", "x"), ("B", "y")]
    encoded = encode_queues(("A", "B"), keys, [{"A": ["x"] * len(first), "B": ["y"] * len(second)}])
    size = encoded.task.shape[-1]
    work = np.ones((1, 2, size))
    work[0, 0, : len(first)], work[0, 1, : len(second)] = first, second
    rate = np.ones((1, 3, 3))
    rate[0, 0, 1], rate[0, 1, 0] = 1 / factor, 1 / other_factor
    found = evaluate(encoded, Worlds(work, rate, np.full((1, 2, size), 0.25)), timeline=True)
    assert found.start_s is not None
    assert found.end_s is not None
    spans = [
        [(found.start_s[0, 0, a, i], found.end_s[0, 0, a, i]) for i in range(n)]
        for a, n in enumerate((len(first), len(second)))
    ]
    for own, others, works, s in ((0, 1, first, factor), (1, 0, second, other_factor)):
        for (begin, end), expected in zip(spans[own], works, strict=True):
            beside = sum(max(0.0, min(end, e) - max(begin, b)) for b, e in spans[others])
            assert (end - begin - beside) + beside / s == pytest.approx(expected, rel=1e-9)
        assert all(b[0] - a[1] == pytest.approx(0.25) for a, b in zip(spans[own], spans[own][1:], strict=False))
    last, start = max(e for side in spans for _, e in side), min(b for side in spans for b, _ in side)
    assert found.makespan_s[0, 0] == pytest.approx(last - start)


def _simple(work: float, size: int, n_keys: int, n_agents: int) -> Worlds:
    return Worlds(np.full((1, n_keys, size), work), np.ones((1, n_keys + 1, n_keys + 1)), np.zeros((1, n_agents, size)))


def test_what_runs_beside_what_costs_by_the_second() -> None:
    keys = [("A", "x"), ("B", "y")]
    encoded = encode_queues(("A", "B"), keys, [{"A": ["x", "x"], "B": ["y"]}])
    cost = np.zeros((3, 3))
    cost[0, 1] = cost[1, 0] = 2.0
    found = evaluate(encoded, _simple(4.0, 3, 2, 2), cost=cost)
    assert (found.makespan_s[0, 0], found.cost[0, 0]) == (8.0, 8.0)


def test_a_plan_in_which_two_stop_each_other_never_ends() -> None:
    keys = [("A", "x"), ("B", "y")]
    worlds = _simple(4.0, 2, 2, 2)
    worlds.rate[0, 0, 1] = worlds.rate[0, 1, 0] = 0.0
    found = evaluate(encode_queues(("A", "B"), keys, [{"A": ["x"], "B": ["y"]}]), worlds)
    assert math.isinf(found.makespan_s[0, 0])


def test_one_that_stands_while_another_works_goes_on_afterwards() -> None:
    keys = [("A", "x"), ("B", "y")]
    worlds = _simple(4.0, 2, 2, 2)
    worlds.rate[0, 0, 1] = 0.0
    found = evaluate(encode_queues(("A", "B"), keys, [{"A": ["x"], "B": ["y"]}]), worlds)
    assert found.makespan_s[0, 0] == 8.0


def test_a_run_goes_on_from_where_it_stands() -> None:
    """Stop a plan half-way, and carry the rest out: it ends when it would have ended."""
    scenario = load_scenario("paper")
    keys = scenario.problem.agent_tasks()
    plan = next(random_plans(scenario.problem, 4)).orders()
    agents = scenario.problem.agents
    whole = encode_queues(agents, keys, [plan])
    world = expected_world(true_times(scenario), keys, agents, whole.task.shape[-1])
    found = evaluate(whole, world, timeline=True)
    assert found.start_s is not None
    assert found.end_s is not None
    now = 30.0
    over = {a: int((found.end_s[0, 0, i] <= now).sum()) for i, a in enumerate(agents)}
    assert all((found.start_s[0, 0, i, over[a]] < now) for i, a in enumerate(agents)), "both work at that instant"
    left = {}
    for i, agent in enumerate(agents):
        begin = found.start_s[0, 0, i, over[agent]]
        own = keys.index((agent, plan[agent][over[agent]]))
        done = 0.0
        for j, other in enumerate(agents):
            if other == agent:
                continue
            spans = [(b, e, keys.index((other, t))) for b, e, t in
                     zip(found.start_s[0, 0, j], found.end_s[0, 0, j], plan[other], strict=True)]  # fmt: skip
            beside = [(max(0.0, min(now, e) - max(begin, b)), k) for b, e, k in spans]
            done = now - begin - sum(s for s, _ in beside) + sum(s * world.rate[0, own, k] for s, k in beside)
        left[agent] = np.array([world.work_s[0, own, 0] - done])
    begun = Begun(
        now,
        float(np.nanmin(found.start_s)),
        over,
        {a: float(found.start_s[0, 0, i, over[a]]) for i, a in enumerate(agents)},
        left,
    )
    assert evaluate(whole, world, begun=begun).makespan_s[0, 0] == pytest.approx(found.makespan_s[0, 0], abs=1e-9)


def test_the_reactive_order_cannot_be_judged_beforehand() -> None:
    scenario = load_scenario("paper")
    plan = next(random_plans(scenario.problem, 4))
    with pytest.raises(ScenarioError, match="reactive"):
        encode_plans(scenario.problem, scenario.problem.agent_tasks(), [plan], DispatchMode.REACTIVE)


def test_a_fact_that_never_arrives_is_told() -> None:
    scenario = load_scenario("paper")
    item = PlanItem("a", "human", "pick_white_box", needs=("part",))
    with pytest.raises(ScenarioError, match="needs 'part'"):
        encode_plans(scenario.problem, scenario.problem.agent_tasks(), [Plan("p", (item,))])
