"""Predict how long a run takes: each agent works through its tasks, all at rates that depend on the others."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import polars as pl

from hrclog.analyzers.intervals import counted
from hrclog.analyzers.segments import AgentTask

Factor = Callable[[AgentTask, AgentTask], float]
"""log s of the first task while the second runs."""

_DONE: Final = 1e-12  # of an execution's work; what rounding leaves


@dataclass(frozen=True, slots=True)
class Step:
    """One task of an agent's sequence."""

    task: str
    work_s: float
    planned_start_s: float = -math.inf


@dataclass(slots=True)
class _Agent:
    """Where an agent is in its sequence: free since `free_s`, or with `remaining_s` of work to go."""

    steps: Sequence[Step]
    gap_s: float
    free_s: float
    position: int = 0
    remaining_s: float = math.nan  # NaN while waiting

    @property
    def running(self) -> bool:
        return not math.isnan(self.remaining_s)

    @property
    def waiting(self) -> bool:
        return not self.running and self.position < len(self.steps)

    @property
    def ready_s(self) -> float:
        """When the next step starts: not before its planned start, nor before the agent is free, and a gap later."""
        if not self.position:
            return self.free_s
        return max(self.free_s, self.steps[self.position].planned_start_s) + self.gap_s


def predicted_makespan_s(
    sequences: Mapping[str, Sequence[Step]], gaps_s: Mapping[str, float], starts_s: Mapping[str, float], factor: Factor
) -> float:
    """Return the time from the first start to the last end.

    Args:
        sequences: each agent's tasks in order, with their work in seconds.
        gaps_s: from when an agent could start its next task until it does.
        starts_s: when each agent's first task starts.
        factor: log factors; with several others they add up.
    """
    agents = {name: _Agent(steps, gaps_s[name], starts_s[name]) for name, steps in sorted(sequences.items()) if steps}
    now = first = min(agent.ready_s for agent in agents.values())
    while any(agent.running or agent.waiting for agent in agents.values()):
        for agent in agents.values():
            if agent.waiting and agent.ready_s <= now:
                agent.remaining_s = agent.steps[agent.position].work_s
        rates = {name: _rate(name, agents, factor) for name, agent in agents.items() if agent.running}
        ends = {name: now + agents[name].remaining_s / rate for name, rate in rates.items()}
        waits = [agent.ready_s for agent in agents.values() if agent.waiting]
        then = min([*ends.values(), *waits])
        for name, rate in rates.items():
            agent = agents[name]
            agent.remaining_s -= (then - now) * rate
            if ends[name] <= then or agent.remaining_s <= _DONE * agent.steps[agent.position].work_s:
                agent.position += 1
                agent.remaining_s, agent.free_s = math.nan, then
        now = then
    return now - first


def _rate(name: str, agents: Mapping[str, _Agent], factor: Factor) -> float:
    own = agents[name]
    key = (name, own.steps[own.position].task)
    others = (
        (other, agent.steps[agent.position].task) for other, agent in agents.items() if other != name and agent.running
    )
    return math.exp(-sum(factor(key, other) for other in others))


def mean_gaps_s(intervals: pl.DataFrame) -> dict[str, float]:
    """Return how many seconds an agent takes on average from when it could start its next task until it does.

    It could when it was free and the planned start had come; the first task of a run has no gap.

    Args:
        intervals: a frame of schema `INTERVALS`.
    """
    rows = intervals.filter(counted()).sort("run_id", "agent", "start_ns", "until_ns", "task", "execution_id")
    free = pl.col("until_ns").shift(1).over("run_id", "agent")
    could = pl.when(free.is_not_null()).then(pl.max_horizontal(free, "planned_start_ns"))
    gap = (pl.col("start_ns") - could).clip(0) / 1e9
    gaps = rows.select("agent", gap.alias("gap_s")).drop_nulls().group_by("agent").agg(pl.col("gap_s").sort().mean())
    return dict(gaps.sort("agent").iter_rows())
