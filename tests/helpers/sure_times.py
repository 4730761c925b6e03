"""What somebody knows for certain of a scenario: every factor of every pair, and how gaps vary."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from planning import true_times

from hrclog.knowledge.task_times import Factor, Gap, TaskTime, TaskTimes
from hrclog.sim.scenario import Scenario


def sure_times(scenario: Scenario) -> TaskTimes:
    """Return times in which no factor is unknown: those that the scenario does not name are 1."""
    times = {key: _sure(time, scenario) for key, time in true_times(scenario).times.items()}
    gaps = {
        agent: Gap(agent, gap.mean_s, gap.mean_s * math.sqrt(math.expm1(gap.sigma**2)), 1000)
        for agent, gap in scenario.gap.items()
    }
    return TaskTimes(times, gaps)


def less_sure(times: TaskTimes, deviation: float) -> TaskTimes:
    """Return times whose log work and log factors are known up to a standard deviation."""
    found = {}
    for key, time in times.times.items():
        spread = np.full(2 + len(time.factors), deviation**2)
        spread[1] = 0.0
        found[key] = replace(time, covariance=np.diag(spread))
    return replace(times, times=found)


def _sure(time: TaskTime, scenario: Scenario) -> TaskTime:
    others = [other for other in scenario.problem.agent_tasks() if other[0] != time.agent]
    factors = tuple(Factor(*other, math.log(scenario.factors.get((time.key, other), 1.0)), 1000) for other in others)
    size = 2 + len(factors)
    return replace(time, factors=factors, covariance=np.zeros((size, size)))
