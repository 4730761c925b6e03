"""What is to be expected of a plan, against what comes of it in the simulator."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from statistics import NormalDist

import numpy as np
import pytest
from planning import makespan_s
from sure_times import less_sure, sure_times

from hrclog.analyzers.search.forecast import Forecast, forecast, with_expected_times
from hrclog.errors import ScenarioError
from hrclog.knowledge.task_times import Gap, TaskTime, TaskTimes
from hrclog.planning.dispatch_mode import DispatchMode
from hrclog.planning.plan import Plan, PlanItem, make_plan
from hrclog.planning.problem import Count, Problem, Task
from hrclog.planning.random_plans import random_plans
from hrclog.sim.run import simulate_run
from hrclog.sim.scenario import Scenario, load_scenario

MANY = 4000


@cache
def scenario_of(name: str) -> Scenario:
    return load_scenario(name)


def plan_of(name: str, number: int = 0) -> Plan:
    plans = [plan for plan, _ in zip(random_plans(scenario_of(name).problem, 5), range(number + 1), strict=False)]
    return plans[number]


def told_of(name: str, times: TaskTimes | None = None, worlds: int = 400, seed: int = 0) -> Forecast:
    known = times or sure_times(scenario_of(name))
    return forecast(scenario_of(name).problem, plan_of(name), known, worlds=worlds, seed=seed)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "number"), [("paper", 0), ("paper", 1), ("three-agents", 2)])
def test_a_forecast_is_that_of_runs_in_the_simulator(name: str, number: int) -> None:
    scenario, plan = scenario_of(name), plan_of(name, number)
    found = np.array([makespan_s(simulate_run(scenario, 11, index, plan)) for index in range(400)])
    told = forecast(scenario.problem, plan, sure_times(scenario), worlds=MANY, seed=1)
    error = math.hypot(found.std() / math.sqrt(len(found)), found.std() / math.sqrt(MANY))
    assert abs(told.mean_s - found.mean()) < 3 * error
    inside = ((found >= told.run_low_s) & (found <= told.run_high_s)).mean()
    assert abs(inside - 0.9) < 3 * math.sqrt(0.9 * 0.1 * (1 / len(found) + 1 / MANY))
    assert told.run_median_s == pytest.approx(np.median(found), abs=5 * error)


@pytest.mark.slow
def test_items_end_in_the_simulator_when_they_are_expected_to() -> None:
    scenario, plan = scenario_of("three-agents"), plan_of("three-agents")
    ends: dict[str, list[float]] = {item.item_id: [] for item in plan.items}
    for index in range(600):
        events = simulate_run(scenario, 12, index, plan).events
        for event in events:
            if event.kind == "task_ended":
                ends[event.item_id].append((event.time_ns - events[0].time_ns) / 1e9)
    told = forecast(scenario.problem, plan, sure_times(scenario), worlds=5 * MANY)
    inside = [np.mean([told.items[i][2] <= end <= told.items[i][3] for end in found]) for i, found in ends.items()]
    assert np.mean(inside) == pytest.approx(0.9, abs=0.02)
    assert min(inside) > 0.85
    for name, found in ends.items():
        assert told.items[name][1] == pytest.approx(np.mean(found), rel=0.06)


@pytest.mark.parametrize("name", ["paper", "kitting", "three-agents", "machine-tending"])
def test_intervals_are_ordered_and_hold_the_mean(name: str) -> None:
    told = told_of(name, less_sure(sure_times(scenario_of(name)), 0.1))
    assert told.run_low_s < told.run_median_s < told.run_high_s
    assert told.mean_low_s < told.mean_s < told.mean_high_s
    assert told.run_low_s < told.mean_s < told.run_high_s
    assert told.worlds == 400
    for start, end, low, high in told.items.values():
        assert 0 <= start < end
        assert 0 < low < high
    assert told.undisturbed_s == pytest.approx(told.mean_s, rel=0.1)


def width_s(told: Forecast) -> float:
    return told.mean_high_s - told.mean_low_s


def test_the_more_is_known_the_narrower_the_interval_of_the_mean() -> None:
    sure = sure_times(scenario_of("paper"))
    tolds = [told_of("paper", less_sure(sure, deviation)) for deviation in (0.2, 0.1, 0.05, 0.0)]
    widths = [width_s(told) for told in tolds]
    assert widths == sorted(widths, reverse=True)
    assert widths[-1] == pytest.approx(0.0, abs=1e-6)
    assert widths[1] == pytest.approx(2 * widths[2], rel=0.2)
    spreads = [told.run_high_s - told.run_low_s for told in tolds]
    assert spreads == sorted(spreads, reverse=True)
    assert spreads[-1] > 3.0  # executions vary, however much is known


def test_what_nobody_saw_of_a_pair_widens_the_interval_of_the_mean() -> None:
    sure = sure_times(scenario_of("paper"))
    fewer = {key: replace(time, factors=(), covariance=np.zeros((2, 2))) for key, time in sure.times.items()}
    assert width_s(told_of("paper", replace(sure, times=fewer))) > 5.0


ONE = Problem(("A",), (Task("x", ("A",)),), (Count("x", 3),))


def one_times(**changes: float) -> TaskTimes:
    time = TaskTime("A", "x", math.log(4.0), 0.2, 30, (), np.diag([0.1**2, 0.0]))
    return TaskTimes({("A", "x"): replace(time, **changes)}, {"A": Gap("A", 0.5, 0.0, 30)})  # type: ignore[arg-type] - fields of time


def test_an_agent_alone_has_the_mean_and_intervals_of_a_lognormal_sum() -> None:
    plan = make_plan(ONE, {"A": ("x", "x", "x")})
    told = forecast(ONE, plan, one_times(), worlds=40_000)
    work = 4.0 * math.exp(0.2**2 / 2)
    assert told.undisturbed_s == pytest.approx(3 * work + 2 * 0.5)
    assert told.mean_s == pytest.approx(3 * work * math.exp(0.1**2 / 2) + 1.0, rel=0.003)
    sure = 3 * work * np.exp(0.1 * np.array([NormalDist().inv_cdf(q) for q in (0.025, 0.975)]))
    assert told.mean_high_s - told.mean_low_s == pytest.approx(sure[1] - sure[0], rel=0.03)
    start, end, low, high = told.items["A-01"]
    assert (start, end) == (0.5, pytest.approx(0.5 + work))
    spread = math.hypot(0.2, 0.1) * NormalDist().inv_cdf(0.95)
    assert (low, high) == (
        pytest.approx(0.5 + 4 * math.exp(-spread), rel=0.01),
        pytest.approx(0.5 + 4 * math.exp(spread), rel=0.01),
    )


def test_attempts_that_fail_are_expected_and_do_not_widen_what_is_known_of_the_mean() -> None:
    plan = make_plan(ONE, {"A": ("x", "x", "x")})
    times = one_times(failure_rate=0.2, failed_s=2.0)
    told, never = (forecast(ONE, plan, known, worlds=40_000) for known in (times, one_times()))
    assert told.mean_s - never.mean_s == pytest.approx(3 * 0.25 * (2.0 + 0.5), rel=0.1)
    assert told.undisturbed_s - never.undisturbed_s == pytest.approx(3 * 0.25 * 2.5)
    assert told.run_high_s - told.run_low_s > 1.3 * (never.run_high_s - never.run_low_s)
    assert width_s(told) < 1.25 * width_s(never)


def test_the_same_seed_gives_the_same_forecast() -> None:
    assert told_of("paper", seed=3).to_json() == told_of("paper", seed=3).to_json()
    assert told_of("paper", seed=3).mean_s != told_of("paper", seed=4).mean_s


def test_a_plan_with_times_has_those_that_are_expected() -> None:
    plan, told = plan_of("paper"), told_of("paper")
    timed = with_expected_times(plan, told)
    for item in timed.items:
        assert (item.planned_start_s, item.planned_end_s) == told.items[item.item_id][:2]
    stripped = [replace(item, planned_start_s=None, planned_end_s=None) for item in timed.items]
    assert stripped == [replace(item, planned_start_s=None, planned_end_s=None) for item in plan.items]
    fewer = replace(told, items={})
    assert with_expected_times(timed, fewer) == timed


def test_a_mode_that_holds_items_back_takes_longer() -> None:
    scenario = scenario_of("paper")
    plan = with_expected_times(plan_of("paper"), told_of("paper"))
    late = replace(plan, items=tuple(replace(i, planned_start_s=2 * (i.planned_start_s or 0.0)) for i in plan.items))
    sequential, timed = (
        forecast(scenario.problem, late, sure_times(scenario), mode)
        for mode in (DispatchMode.SEQUENTIAL, DispatchMode.TIMED)
    )
    assert sequential.mean_s == pytest.approx(told_of("paper").mean_s)
    assert timed.mean_s > 1.5 * sequential.mean_s


def test_a_plan_that_comes_to_no_end_is_told() -> None:
    problem = Problem(("A", "B"), (Task("x", ("A",)), Task("y", ("B",))), (Count("x", 1), Count("y", 1)))
    items = (PlanItem("a", "A", "x", needs=("part",)), PlanItem("b", "B", "y"))
    times = TaskTimes({key: TaskTime(*key, 1.0, 0.1, 9) for key in problem.agent_tasks()}, {})
    with pytest.raises(ScenarioError, match="needs 'part'"):
        forecast(problem, Plan("p", items), times)
    with pytest.raises(ScenarioError, match="reactive"):
        forecast(problem, make_plan(problem, {"A": ["x"], "B": ["y"]}), times, DispatchMode.REACTIVE)
