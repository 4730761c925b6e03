"""A simulated run is a pure function of scenario, seed and number."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import pytest

from hrclog.errors import ScenarioError
from hrclog.events import RunStarted, TaskFact, TaskStarted
from hrclog.planning.plan import Plan, make_plan
from hrclog.planning.problem import Count, Problem, Task
from hrclog.sim.run import BASE_EPOCH_NS, PlanSequence, Run, plan_of, simulate_run
from hrclog.sim.scenario import Gap, Lognormal, Safety, Scenario, Synergy, Work, load_scenario, scenario_names

PAPER = load_scenario("paper")


def test_the_same_arguments_give_the_same_run_whatever_was_simulated_before() -> None:
    runs = [simulate_run(PAPER, 3, index) for index in range(4)]
    assert [simulate_run(PAPER, 3, index) for index in reversed(range(4))] == runs[::-1]


@pytest.mark.parametrize("name", scenario_names())
def test_another_seed_or_number_gives_another_run(name: str) -> None:
    scenario = load_scenario(name)
    works = {
        tuple(row.work_s for row in simulate_run(scenario, seed, index).truth.executions)
        for seed in (1, 2)
        for index in (0, 1)
    }
    assert len(works) == 4


def test_runs_of_a_campaign_do_not_share_an_instant_and_their_ids_sort_by_time() -> None:
    runs = [simulate_run(PAPER, 1, index) for index in range(5)]
    assert runs[0].events[0].time_ns == BASE_EPOCH_NS
    assert all(a.events[-1].time_ns < b.events[0].time_ns for a, b in pairwise(runs))
    assert [run.truth.run_id for run in runs] == sorted(run.truth.run_id for run in runs)


def test_no_id_is_used_twice_in_a_campaign() -> None:
    runs = [simulate_run(PAPER, 1, index) for index in range(20)]
    starts = [event for run in runs for event in run.events if isinstance(event, TaskStarted)]
    ids = [run.truth.run_id for run in runs] + [i for e in starts for i in (e.execution_id, e.command_id)]
    assert len(set(ids)) == len(ids) == 20 + 2 * 24 * 20


def test_the_random_part_of_ids_differs_between_runs_and_seeds() -> None:
    ids = [simulate_run(PAPER, seed, index).truth.run_id for seed in (1, 2) for index in (0, 1)]
    assert len({run_id[-12:] for run_id in ids}) == 4


def ids_of(scenario: Scenario) -> set[str]:
    """Return the ids of run 0 of seed 7: its own, of its executions and of their commands."""
    run = simulate_run(scenario, 7, 0)
    starts = [event for event in run.events if isinstance(event, TaskStarted)]
    return {run.truth.run_id} | {own for start in starts for own in (start.execution_id, start.command_id)}


def test_scenarios_do_not_share_an_id_at_the_same_seed_and_number() -> None:
    changed = [
        replace(PAPER, name="other"),
        replace(PAPER, gaps=(*PAPER.gaps[:-1], Gap(PAPER.gaps[-1].agent, Lognormal(9.0, 0.1)))),
    ]
    ids = [ids_of(scenario) for scenario in (*map(load_scenario, scenario_names()), *changed)]
    assert len(set[str]().union(*ids)) == sum(map(len, ids))


def test_a_scenario_read_twice_gives_the_same_run() -> None:
    assert simulate_run(load_scenario("paper"), 7, 0) == simulate_run(PAPER, 7, 0)


def test_the_first_event_says_all_about_the_run() -> None:
    started = simulate_run(PAPER, 9, 2).events[0]
    assert isinstance(started, RunStarted)
    assert (started.name, started.agents, started.seed) == ("paper_0002", ("human", "robot"), 9)
    assert started.dispatch_mode == "sequential"
    assert set(started.software) == {"hrclog", "engine"}
    assert [task["name"] for task in started.task_properties] == [task.name for task in PAPER.problem.tasks]
    assert len(started.plan["items"]) == 24


def test_all_executions_carry_type_item_and_command() -> None:
    facts = [event for event in simulate_run(PAPER, 1, 0).events if isinstance(event, TaskFact)]
    assert all(fact.task_type in ("pick", "place") and fact.item_id and fact.command_id for fact in facts)


def test_chances_of_one_agent_do_not_depend_on_the_other() -> None:
    freed = replace(PAPER, synergies=())

    def human_work(run: Run) -> list[float]:
        return [row.work_s for row in run.truth.executions if row.agent == "human"]

    assert human_work(simulate_run(PAPER, 1, 0)) == human_work(simulate_run(freed, 1, 0))


def test_agents_do_not_share_their_chances() -> None:
    problem = Problem(("a", "b"), (Task("t", ("a", "b")),), (Count("t", 3, "a"), Count("t", 3, "b")))
    scenario = Scenario("twins", problem, tuple(Work(agent, "t", Lognormal(5.0, 0.3)) for agent in "ab"))
    works = [row.work_s for row in simulate_run(scenario, 1, 0).truth.executions]
    assert len(set(works)) == 6


def test_what_ends_at_an_instant_is_not_touched_by_what_begins_there() -> None:
    problem = Problem(("a", "b"), (Task("t", ("a", "b")),), (Count("t", 1, "a"), Count("t", 1, "b")))
    scenario = Scenario(
        "touching",
        problem,
        (Work("a", "t", Lognormal(10.0, 0.0)), Work("b", "t", Lognormal(5.0, 0.0))),
        (Synergy("a", "t", "b", "t", math.inf),),
        (Gap("b", Lognormal(10.0, 0.0)),),
        safety=Safety(("a",)),
    )
    events = simulate_run(scenario, 1, 0).events
    assert [(e.kind, e.agent) for e in events if isinstance(e, TaskFact)] == [
        ("task_dispatched", "a"),
        ("task_dispatched", "b"),
        ("task_started", "a"),
        ("task_ended", "a"),
        ("task_started", "b"),
        ("task_ended", "b"),
    ]
    assert events[5].time_ns == events[6].time_ns == BASE_EPOCH_NS + 10_000_000_000


def test_the_humans_blue_tasks_slow_the_robot_and_the_white_ones_hardly_do() -> None:
    for synergy in PAPER.synergies:
        if synergy.agent == "robot":
            assert (synergy.factor >= 1.5) if "blue" in synergy.other_task else (0.9 <= synergy.factor <= 1.1)


def test_the_papers_runs_have_24_executions_with_the_papers_counts() -> None:
    run = simulate_run(PAPER, 1, 0)
    keys = [(row.agent, row.task) for row in run.truth.executions]
    assert len(keys) == 24
    for agent, colour, count in (
        ("human", "white", 4),
        ("human", "blue", 2),
        ("robot", "orange", 4),
        ("robot", "blue", 2),
    ):
        assert keys.count((agent, f"pick_{colour}_box")) == keys.count((agent, f"place_{colour}_box")) == count


@pytest.mark.slow
def test_plans_of_a_campaign_differ_until_there_are_no_more_then_come_again_in_a_new_order() -> None:
    plans = PlanSequence(PAPER, 1)
    orders = [str(plans[index].orders()) for index in range(3 * 225)]
    rounds = [orders[start : start + 225] for start in (0, 225, 450)]
    assert all(len(set(names)) == 225 for names in rounds)
    assert len({tuple(names) for names in rounds}) == 3
    assert [str(plans[index].orders()) for index in (600, 300, 599, 3)] == [orders[i] for i in (600, 300, 599, 3)]


def test_a_given_plan_is_carried_out() -> None:
    orders = plan_of(PAPER, 5, 17).orders()
    run = simulate_run(PAPER, 1, 0, make_plan(PAPER.problem, orders, "mine"))
    starts = [event for event in run.events if isinstance(event, TaskStarted)]
    assert {agent: tuple(e.task for e in starts if e.agent == agent) for agent in orders} == orders
    assert all(start.planned_start_ns is not None for start in starts)


def test_a_plan_that_does_not_fit_is_refused() -> None:
    with pytest.raises(ScenarioError, match="plan 'short': 'pick_blue_box' is done 0 times, expected 4"):
        simulate_run(PAPER, 1, 0, Plan("short", ()))


def test_agents_that_stop_each_other_in_a_circle_are_named() -> None:
    agents = ("a", "b", "c")
    problem = Problem(agents, (Task("t", agents),), tuple(Count("t", 1, agent) for agent in agents))
    scenario = Scenario(
        "circle",
        problem,
        tuple(Work(agent, "t", Lognormal(10.0, 0.0)) for agent in agents),
        tuple(Synergy(one, "t", two, "t", math.inf) for one, two in (("a", "b"), ("b", "c"), ("c", "a"))),
        safety=Safety(agents),
    )
    with pytest.raises(ScenarioError, match=r"circle: standstill, .* at a-01 \(t\), b-01 \(t\), c-01 \(t\)"):
        simulate_run(scenario, 1, 0)


def test_rates_of_two_other_agents_multiply() -> None:
    agents = ("a", "b", "c")
    problem = Problem(agents, (Task("t", agents),), tuple(Count("t", 1, agent) for agent in agents))
    works = (Work("a", "t", Lognormal(2.0, 0.0)), *(Work(x, "t", Lognormal(100.0, 0.0)) for x in "bc"))
    synergies = (Synergy("a", "t", "b", "t", 3.0), Synergy("a", "t", "c", "t", 0.5))
    run = simulate_run(Scenario("three", problem, works, synergies), 1, 0)
    start_ns, end_ns = (
        e.time_ns for e in run.events if isinstance(e, TaskFact) and e.agent == "a" and e.kind != "task_dispatched"
    )
    assert end_ns - start_ns == 3_000_000_000  # 2 s of work at 1/3 * 2


def test_runs_of_two_given_plans_have_ids_of_their_own() -> None:
    scenario = load_scenario("paper")
    first, second = (simulate_run(scenario, 1, 0, plan_of(scenario, 1, index)) for index in (0, 1))
    assert first.truth.run_id != second.truth.run_id
