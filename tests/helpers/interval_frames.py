"""Intervals frames made by hand, at random and by hypothesis."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import polars as pl
from hypothesis import strategies as st

from hrclog.analyzers.projections.intervals import SORT
from hrclog.analyzers.projections.schemas import INTERVALS

Row = dict[str, Any]

_DEFAULTS: Row = {name: "" if kind == pl.String else None for name, kind in INTERVALS.items()} | {
    "run_id": "run",
    "role": "primary",
    "attempt": 1,
    "outcome": "succeeded",
    "paused_ns": 0,
}


def row(agent: str, task: str, start: int, end: int | None, **others: object) -> Row:
    """Return one execution; an open one names `until_ns`."""
    times = {"start_ns": start, "end_ns": end, "until_ns": end}
    return _DEFAULTS | {"agent": agent, "task": task} | times | others


def frame(rows: Iterable[Mapping[str, Any]]) -> pl.DataFrame:
    """Return an intervals frame; executions without an id are numbered."""
    numbered = [dict(one) | {"execution_id": one["execution_id"] or f"x{number}"} for number, one in enumerate(rows)]
    return pl.DataFrame(numbered, schema=INTERVALS).sort(SORT)


def seconds(agent: str, *spans: tuple[float, float], **others: object) -> list[Row]:
    """Return executions given as (start, length) in seconds, of tasks t0, t1, …."""
    return [
        row(agent, f"t{number}", round(start * 1e9), round((start + length) * 1e9), **others)
        for number, (start, length) in enumerate(spans)
    ]


_OUTCOMES = ("succeeded", "succeeded", "succeeded", "failed", "canceled", "timed_out", "unknown")


@st.composite
def rows(
    draw: st.DrawFn, *, max_size: int = 14, scale: int = 1, plain: bool = False, runs: str = "rs", agents: str = "ABC"
) -> list[Row]:
    """Draw executions on a small grid, so that ties, touching and self-overlap are common."""
    count = draw(st.integers(0, max_size))
    found = []
    for number in range(count):
        start, length = draw(st.integers(-5, 20)), draw(st.integers(0, 8))
        run, agent, task = draw(st.tuples(st.sampled_from(runs), st.sampled_from(agents), st.sampled_from("xyz")))
        others: Row = {"run_id": run, "execution_id": f"x{number}"}
        if not plain:
            others["outcome"] = draw(st.sampled_from(_OUTCOMES))
            others["role"] = draw(st.sampled_from(("primary",) * 5 + ("auxiliary",)))
            others["parent_execution_id"] = draw(st.sampled_from(("",) * 5 + ("x0",)))
        one = row(agent, task, start * scale, (start + length) * scale, **others)
        found.append(one | {"end_ns": None} if others.get("outcome") == "unknown" else one)
    return found


def random_runs(
    seed: int, n_runs: int = 20, per_agent: int = 8, agents: str = "HR", tasks: int = 4, overlap_itself: str = ""
) -> list[Row]:
    """Return runs of executions with gaps; the agents in `overlap_itself` begin before they have ended."""
    source = np.random.default_rng(seed)
    found: list[Row] = []
    for run in range(n_runs):
        for agent in agents:
            now = int(source.integers(0, 3_000_000_000))
            for number in range(per_agent):
                length = int(source.integers(500_000_000, 9_000_000_000))
                task = f"{agent.lower()}{int(source.integers(0, tasks))}"
                identity = {"run_id": f"run{run:03}", "execution_id": f"{run}-{agent}-{number}"}
                outcome = "failed" if source.random() < 0.05 else "succeeded"
                found.append(row(agent, task, now, now + length, outcome=outcome, **identity))
                low = -2_000_000_000 if agent in overlap_itself else 0
                now += length + int(source.integers(low, 1_500_000_000))
    return found
