"""Sound runs of a made-up cell as rows of events, to put faults of meaning into."""

from __future__ import annotations

import json
from collections.abc import Callable
from random import Random

import polars as pl
from event_frames import Row, event, frame

from hrclog.analyzers.projections.intervals import rebuild
from hrclog.analyzers.projections.lints.lints import lint
from hrclog.analyzers.projections.overlaps import overlaps
from hrclog.analyzers.projections.runs import runs as runs_table
from hrclog.diagnostic import Diagnostic

NOON = 1_780_000_000 * 10**9
SECOND = 10**9
TASKS = {"robot": ("pick", "place"), "human": ("fetch", "screw", "inspect")}

Runs = dict[str, list[Row]]
"""The rows of each run, by its name; the run's id is the name with "id-" before it."""


def sound_runs(seed: int, *, n_runs: int = 5, n_each: int = 12, planned: bool = False, ids: bool = True) -> Runs:
    """Return runs that nothing is wrong with: declared, ended, with a failure, a pause and safety events in each.

    Args:
        seed: of durations.
        n_runs: how many.
        n_each: how many executions of each agent.
        planned: whether each run's start tells its plan.
        ids: whether executions and plans tell the ids of items.
    """
    random = Random(seed)
    return {
        f"rep_{number}": _sound_run(random, f"rep_{number}", NOON + 3600 * SECOND * number, n_each, planned, ids)
        for number in range(n_runs)
    }


def _sound_run(random: Random, name: str, start: int, n_each: int, planned: bool, ids: bool) -> list[Row]:
    rows: list[Row] = []
    items: list[Row] = []
    for agent, tasks in TASKS.items():
        now = start + SECOND
        for number in range(n_each):
            task = tasks[number % len(tasks)]
            item = {"item_id": f"{agent}-{number}"} if ids else {}
            identity = {
                "run_id": f"id-{name}",
                "agent": agent,
                "task": task,
                "execution_id": f"{name}-{agent}-{number}",
            }
            end = now + round(SECOND * (2 + tasks.index(task)) * random.lognormvariate(0, 0.2))
            plan = {"planned_start_ns": now - SECOND // 2, "planned_end_ns": end + SECOND // 2}
            rows.append(event("task_started", now, **identity, **item, **plan))
            if number == 3:
                rows.append(event("task_paused", now + SECOND // 4, **identity, **item))
                rows.append(event("task_resumed", now + SECOND // 2, **identity, **item))
            outcome = "failed" if agent == "robot" and number == 5 else "succeeded"
            rows.append(event("task_ended", end, outcome=outcome, **identity, **item))
            items.append({"agent": agent, "task": task} | item)
            now = end + SECOND // 2
    for moment in (1, 4, 9):
        safety = {"agent": "robot", "mode": "slow", "speed_scale": 0.5}
        rows.append(event("safety_state_changed", start + moment * SECOND, run_id=f"id-{name}", **safety))
    details = {"name": name, "agents": list(TASKS)} | ({"plan": {"items": items}} if planned else {})
    last = max(row["time_ns"] for row in rows)
    return [
        event("run_started", start, run_id=f"id-{name}", details=json.dumps(details)),
        *sorted(rows, key=lambda row: row["time_ns"]),
        event("run_ended", last + SECOND, run_id=f"id-{name}", outcome="succeeded"),
    ]


def events_of(runs: Runs) -> pl.DataFrame:
    """Return the events of runs as a frame in the order of time, each run in a file of its name."""
    rows = [row | {"seq": 0} for of_run in runs.values() for row in of_run]
    paths = {of_run[0]["run_id"]: f"{name}.mcap" for name, of_run in runs.items()}
    events = frame(sorted(rows, key=lambda row: (row["time_ns"], row["run_id"])))
    return events.with_columns(pl.col("run_id").replace_strict(paths, return_dtype=pl.String).alias("path"))


def remarks(runs: Runs) -> list[Diagnostic]:
    """Return what is remarkable about the meaning of runs."""
    events = events_of(runs)
    executions, illegal = rebuild(events)
    table = runs_table(events, executions)
    return [*illegal, *lint(events, executions, overlaps(executions), table)]


def executions_of(rows: list[Row], agent: str = "", task: str = "") -> list[str]:
    """Return the ids of the executions of a run, of an agent or a task, in order of their starts."""
    return [
        row["execution_id"]
        for row in rows
        if row["kind"] == "task_started"
        and row["agent"] in (agent or row["agent"])
        and row["task"] in (task or row["task"])
    ]


def without_executions(rows: list[Row], executions: list[str]) -> list[Row]:
    """Return the rows of a run without those of some executions."""
    return [row for row in rows if row["execution_id"] not in executions]


def change(rows: list[Row], where: Callable[[Row], bool], **values: object) -> None:
    """Set values of the rows of a run that are so."""
    for row in rows:
        if where(row):
            row.update(values)


def set_details(rows: list[Row], **facts: object) -> None:
    """Set facts of the start of a run; None takes one away."""
    start = next(row for row in rows if row["kind"] == "run_started")
    told = json.loads(start["details"]) | facts
    start["details"] = json.dumps({key: value for key, value in told.items() if value is not None})


def rescale(rows: list[Row], agent: str, factor: float) -> None:
    """Make the executions of an agent longer or shorter; their starts stay."""
    starts = {row["execution_id"]: row["time_ns"] for row in rows if row["kind"] == "task_started"}
    for row in rows:
        if row["kind"] in ("task_ended", "task_paused", "task_resumed") and row["agent"] == agent:
            start = starts[row["execution_id"]]
            row["time_ns"] = start + round((row["time_ns"] - start) * factor)
