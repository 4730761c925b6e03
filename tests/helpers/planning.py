"""What planner tests share: what is known of a scenario for certain, and the worlds of simulated runs."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from hrclog.analyzers.search.encoded import Encoded
from hrclog.analyzers.search.worlds import Worlds
from hrclog.events import TaskDispatched, TaskStarted
from hrclog.knowledge.task_times import Factor, Gap, TaskTime, TaskTimes
from hrclog.sim.run import Run
from hrclog.sim.scenario import Scenario


def true_times(scenario: Scenario) -> TaskTimes:
    """Return what somebody would know who had seen a scenario for ever."""
    times = {}
    for key, work in scenario.work.items():
        factors = tuple(
            Factor(*other, math.log(factor), 1000)
            for (own, other), factor in sorted(scenario.factors.items())
            if own == key and math.isfinite(factor)
        )
        covariance = np.zeros((2 + len(factors), 2 + len(factors)))
        mean_s = work.time.mean_s
        times[key] = TaskTime(*key, work.time.mu, work.time.sigma, 1000, factors, covariance, mean_s)
    gaps = {agent: Gap(agent, gap.mean_s, 0.0, 1000) for agent, gap in scenario.gap.items()}
    return TaskTimes(times, gaps)


def world_of(scenario: Scenario, plan: Encoded, run: Run) -> Worlds:
    """Return the world in which a simulated run took place: its works, gaps and the scenario's rates."""
    number = {key: index for index, key in enumerate(plan.keys)}
    size = plan.task.shape[-1]
    work = np.ones((1, len(plan.keys), size))
    gap = np.zeros((1, len(plan.agents), size))
    given: dict[str, int] = {}
    seen: dict[str, int] = defaultdict(int)
    repeats: dict[tuple[str, str], int] = defaultdict(int)
    truth = {execution.execution_id: execution for execution in run.truth.executions}
    for event in run.events:
        if isinstance(event, TaskDispatched):
            given[event.agent] = event.time_ns
        elif isinstance(event, TaskStarted):
            gap[0, plan.agents.index(event.agent), seen[event.agent]] = (event.time_ns - given[event.agent]) / 1e9
            seen[event.agent] += 1
            key = (event.agent, event.task)
            work[0, number[key], repeats[key]] = truth[event.execution_id].work_s
            repeats[key] += 1
    rate = np.ones((1, len(plan.keys) + 1, len(plan.keys) + 1))
    for key, row in scenario.rates.items():
        for other, value in row.items():
            rate[0, number[key], number[other]] = value
    return Worlds(work, rate, gap)


def makespan_s(run: Run) -> float:
    """Return the time from the first start to the last end of a simulated run."""
    starts = [event.time_ns for event in run.events if event.kind == "task_started"]
    ends = [event.time_ns for event in run.events if event.kind == "task_ended"]
    return (max(ends) - min(starts)) / 1e9


def timeline_s(run: Run, agents: Sequence[str]) -> dict[str, list[float]]:
    """Return by agent the starts of a simulated run since its first event."""
    zero = run.events[0].time_ns
    return {
        agent: [(e.time_ns - zero) / 1e9 for e in run.events if e.kind == "task_started" and e.agent == agent]
        for agent in agents
    }
