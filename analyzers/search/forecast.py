"""The forecast of a plan: its makespan with the uncertainty, and when each item starts and ends."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from hrclog.analyzers.search.encoded import encode_plans
from hrclog.analyzers.search.evaluate import Begun, evaluate
from hrclog.analyzers.search.worlds import drawn_worlds, expected_work_s, expected_world
from hrclog.arrays import FloatArray
from hrclog.errors import ScenarioError
from hrclog.knowledge.task_times import TaskTimes
from hrclog.planning.dispatch_mode import DispatchMode
from hrclog.planning.plan import Plan
from hrclog.planning.problem import Problem

WORLDS: Final = 400


@dataclass(frozen=True, slots=True)
class Forecast:
    """The makespan of a plan, in seconds, and its items in time.

    Attributes:
        undisturbed_s: if every execution took what is expected of it.
        mean_s: expected over what is not known and how executions vary.
        mean_low_s: 2.5 % quantile of that expectation, by what is not known of the tasks.
        mean_high_s: its 97.5 % quantile.
        run_low_s: 5 % quantile of one run's makespan.
        run_median_s: its median.
        run_high_s: its 95 % quantile.
        worlds: how many runs were drawn.
        items: of those that are not over, by item id: expected start and end, and 5 % and 95 % quantiles of the end,
            since the run's start.
    """

    undisturbed_s: float
    mean_s: float
    mean_low_s: float
    mean_high_s: float
    run_low_s: float
    run_median_s: float
    run_high_s: float
    worlds: int
    items: dict[str, tuple[float, float, float, float]]

    def to_json(self) -> dict[str, Any]:
        """Return the numbers as JSON values."""
        return {
            "undisturbed_s": self.undisturbed_s,
            "mean_s": self.mean_s,
            "mean_low_s": self.mean_low_s,
            "mean_high_s": self.mean_high_s,
            "run_p05_s": self.run_low_s,
            "run_p50_s": self.run_median_s,
            "run_p95_s": self.run_high_s,
            "worlds": self.worlds,
            "items": {
                item_id: {"start_s": start, "end_s": end, "end_p05_s": low, "end_p95_s": high}
                for item_id, (start, end, low, high) in self.items.items()
            },
        }


def forecast(
    problem: Problem,
    plan: Plan,
    times: TaskTimes,
    mode: DispatchMode = DispatchMode.SEQUENTIAL,
    *,
    worlds: int = WORLDS,
    seed: int = 0,
    begun: Begun | None = None,
) -> Forecast:
    """Return what is to be expected of a plan.

    Args:
        problem: what the plan solves.
        plan: any plan of it.
        times: what is known.
        mode: how it is handed out.
        worlds: how many runs to draw.
        seed: of the draws.
        begun: where it goes on from, default the start of a run.

    Raises:
        ScenarioError: nothing is known of a task, the mode is reactive, or the plan comes to no end.
    """
    keys = sorted({(item.agent, item.task) for item in plan.items})
    encoded = encode_plans(problem, keys, [plan], mode)
    size = encoded.task.shape[-1]
    expected = evaluate(
        encoded, expected_world(times, keys, encoded.agents, size), begun=_with_mean_work_left(begun), timeline=True
    )
    drawn = evaluate(encoded, drawn_worlds(times, keys, encoded.agents, size, worlds, seed), begun=begun, timeline=True)
    if not np.isfinite(drawn.makespan_s).all() or not np.isfinite(expected.makespan_s).all():
        raise ScenarioError(f"plan {plan.name!r}: it comes to no end, agents stop or wait for each other")
    makespan = drawn.makespan_s[0]
    noiseless = evaluate(
        encoded, drawn_worlds(_without_noise(times), keys, encoded.agents, size, worlds, seed), begun=begun
    ).makespan_s[0]
    mean = float(makespan.mean())
    low, high = (mean + float(np.quantile(noiseless, q)) - float(noiseless.mean()) for q in (0.025, 0.975))
    return Forecast(
        float(expected.makespan_s[0, 0]),
        mean,
        low,
        high,
        float(np.quantile(makespan, 0.05)),
        float(np.quantile(makespan, 0.5)),
        float(np.quantile(makespan, 0.95)),
        worlds,
        _item_times(plan, encoded.agents, expected.start_s, expected.end_s, drawn.end_s),
    )


def _with_mean_work_left(begun: Begun | None) -> Begun | None:
    if begun is None:
        return None
    return replace(begun, left_s={agent: left.mean(keepdims=True) for agent, left in begun.left_s.items()})


def _without_noise(times: TaskTimes) -> TaskTimes:
    """Return times whose executions do not vary and do not fail, with the same expected work."""
    noiseless = {}
    for key, time in times.times.items():
        covariance = None
        if time.covariance is not None:
            covariance = time.covariance.copy()
            covariance[1] = covariance[:, 1] = 0.0
        mu = math.log(expected_work_s(time, times))
        noiseless[key] = replace(time, mu=mu, sigma=0.0, covariance=covariance, failure_rate=0.0)
    gaps = {agent: replace(gap, std_s=0.0) for agent, gap in times.gaps.items()}
    return TaskTimes(noiseless, gaps)


def _item_times(
    plan: Plan, agents: tuple[str, ...], start: FloatArray | None, end: FloatArray | None, ends: FloatArray | None
) -> dict[str, tuple[float, float, float, float]]:
    assert start is not None  # noqa: S101 - timelines were asked for
    assert end is not None  # noqa: S101 - timelines were asked for
    assert ends is not None  # noqa: S101 - timelines were asked for
    low, high = np.quantile(ends[0], (0.05, 0.95), axis=0)
    index_of = {item.item_id: (agents.index(a), n) for a in plan.agents() for n, item in enumerate(plan.queue(a))}
    return {
        item_id: (float(start[0, 0][index]), float(end[0, 0][index]), float(low[index]), float(high[index]))
        for item_id, index in index_of.items()
        if np.isfinite(end[0, 0][index])  # the others were over before
    }


def with_expected_times(plan: Plan, found: Forecast) -> Plan:
    """Return the plan with the times that are expected of its items; those that are over keep theirs."""
    items = []
    for item in plan.items:
        start, end, _, _ = found.items.get(item.item_id, (item.planned_start_s, item.planned_end_s, None, None))
        items.append(replace(item, planned_start_s=start, planned_end_s=end))
    return replace(plan, items=tuple(items))
