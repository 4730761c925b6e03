"""Simulated executions with known truth, straight as rows of an intervals frame."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import polars as pl
from interval_frames import Row, frame, row

Key = tuple[str, str, str, str]


def simulated(
    seed: int,
    n_runs: int,
    work: Mapping[str, Mapping[str, tuple[float, float]]],
    factors: Mapping[Key, float] | None = None,
    per_agent: int = 8,
    idle_s: float = 2.0,
    failures_per_s: float = 0.0,
) -> list[Row]:
    """Return runs in which everyone does random tasks, slowed down by what the others do at that moment.

    Args:
        seed: of everything.
        n_runs: how many runs.
        work: per agent and task, mu and sigma of log work in seconds.
        factors: s of (agent, task, other agent, other task); 1 where none is named.
        per_agent: executions in a run.
        idle_s: mean time between executions of an agent.
        failures_per_s: rate at which running executions fail.
    """
    source = np.random.default_rng(seed)
    found: list[Row] = []
    for number in range(n_runs):
        found += _run(source, f"run{number:04}", work, factors or {}, per_agent, idle_s, failures_per_s)
    return found


def simulated_frame(
    seed: int,
    n_runs: int,
    work: Mapping[str, Mapping[str, tuple[float, float]]],
    factors: Mapping[Key, float] | None = None,
    per_agent: int = 8,
    idle_s: float = 2.0,
    failures_per_s: float = 0.0,
) -> pl.DataFrame:
    """Return the same as an intervals frame."""
    return frame(simulated(seed, n_runs, work, factors, per_agent, idle_s, failures_per_s))


def _run(
    source: np.random.Generator,
    run: str,
    work: Mapping[str, Mapping[str, tuple[float, float]]],
    factors: Mapping[Key, float],
    per_agent: int,
    idle_s: float,
    failures_per_s: float,
) -> list[Row]:
    found: list[Row] = []
    agents = list(work)
    doing: dict[str, str] = dict.fromkeys(agents, "")
    left = {agent: source.exponential(idle_s) for agent in agents}  # seconds of idling, or of work at full rate
    fails = dict.fromkeys(agents, math.inf)
    start = dict.fromkeys(agents, 0.0)
    count = dict.fromkeys(agents, 0)
    now = 0.0
    while left:
        slow = {
            agent: math.prod(
                factors.get((agent, doing[agent], other, doing[other]), 1.0) for other in agents if other != agent
            )
            for agent in left
        }
        agent = min(left, key=lambda one: min(left[one] * slow[one], fails[one]))
        step = min(left[agent] * slow[agent], fails[agent])
        failed = fails[agent] <= left[agent] * slow[agent]
        now += step
        for one in left:
            left[one] -= step / slow[one]
            fails[one] -= step
        if doing[agent]:
            identity = {"run_id": run, "execution_id": f"{run}-{agent}-{count[agent]:04}"}
            outcome = "failed" if failed else "succeeded"
            found.append(
                row(agent, doing[agent], round(start[agent] * 1e9), round(now * 1e9), outcome=outcome, **identity)
            )
            doing[agent], fails[agent] = "", math.inf
            count[agent] += 1
            left[agent] = source.exponential(idle_s)
            if count[agent] == per_agent:
                del left[agent]
        else:
            task = list(work[agent])[source.integers(len(work[agent]))]
            doing[agent], start[agent] = task, now
            left[agent] = math.exp(source.normal(*work[agent][task]))
            if failures_per_s:
                fails[agent] = source.exponential(1 / failures_per_s)
    return found
