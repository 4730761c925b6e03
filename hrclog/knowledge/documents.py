"""The four collections as documents of the paper authors' stack, whose readers find in them what they look for.

Documents are as MongoDB's extended JSON shows them; `hrclog.knowledge.mongo` turns them into what its driver sends.
What upstream has no field for is under `hrclog`, so that nothing is lost on the way back.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC, datetime
from typing import Any, Final

import polars as pl

from hrclog.events import COMPLETED, Outcome
from hrclog.knowledge.properties import TaskProperties
from hrclog.knowledge.tables import TASK_RESULTS
from hrclog.knowledge.view import RunEntry

Document = dict[str, Any]

OWN: Final = "hrclog"
"""The field that says that a document is from here, and holds what upstream has no field for."""


def property_documents(tasks: Iterable[TaskProperties]) -> list[Document]:
    """Return the documents of task_properties; `goal` lists the objects that a task chooses from."""
    return [
        {
            "_id": _object_id("task", task.task),
            "name": task.task,
            "type": task.task_type,
            "description": "",
            "agent": list(task.agents),
            "goal": list(task.targets),
            OWN: {"role": task.role, "expected_s": dict(task.expected_s)},
        }
        for task in tasks
    ]


def recipes(runs: Iterable[RunEntry]) -> dict[str, str]:
    """Return the recipe by run: its name, or name and id where that is not the name of one run alone."""
    runs = list(runs)
    counts = Counter(run.name for run in runs)
    return {
        run.run_id: run.name if run.name and counts[run.name] == 1 else f"{run.name} {run.run_id}".strip()
        for run in runs
    }


def result_documents(results: pl.DataFrame, recipe_of: Mapping[str, str]) -> Iterator[tuple[str, list[Document]]]:
    """Yield (run_id, documents of its task_results).

    Args:
        results: executions with the columns of intervals, ordered as they are.
        recipe_of: the recipe by run_id.
    """
    executions = results.select(TASK_RESULTS.columns.keys())
    for (run_id,), part in executions.group_by("run_id", maintain_order=True):
        zero = int(part["start_ns"].to_list()[0])  # they are ordered by it
        yield str(run_id), [_result_document(row, recipe_of[str(run_id)], zero) for row in part.iter_rows(named=True)]


def duration_documents(durations: pl.DataFrame) -> list[Document]:
    """Return the documents of task_durations, of the tasks that succeeded at least once."""
    return [
        {
            "_id": {"agent": row["agent"], "name": row["task"]},
            "counter": row["count"],
            "success_rate": row["success_rate"],
            "min": row["min_s"],
            "max": row["max_s"],
            "name": row["task"],
            "agent": row["agent"],
            "expected_duration": row["mean_s"],
            "duration_stddev": row["std_s"],
            "median": row["median_s"],
            OWN: {},
        }
        for row in durations.iter_rows(named=True)
        if row["count"]
    ]


def synergy_documents(synergies: pl.DataFrame, durations: pl.DataFrame) -> list[Document]:
    """Return the documents of task_synergies, of the pairs that have one."""
    rates = {(agent, task): rate for agent, task, rate in durations.select("agent", "task", "success_rate").iter_rows()}
    return [
        {
            "_id": _object_id("synergy", row["agent"], row["task"], row["other_agent"], row["other_task"]),
            "agent": row["agent"],
            "concurrent_agent": row["other_agent"],
            "agent_skill": row["task"],
            "concurrent_skill": row["other_task"],
            "success_rate": rates.get((row["agent"], row["task"])),
            "dynamic_risk": row["synergy"],
            "std_err": row["std_err"],
            "counter": row["n"],
            OWN: {"status": row["status"], "estimator": row["estimator"]},
        }
        for row in synergies.iter_rows(named=True)
        if row["synergy"] is not None
    ]


def result_row(document: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """Return the execution that a document of `result_documents` was made from, None if it is from elsewhere."""
    row = document.get(OWN)
    return row if isinstance(row, Mapping) and set(row) == set(TASK_RESULTS.columns.keys()) else None


def _result_document(row: dict[str, Any], recipe: str, zero: int) -> Document:
    until = row["until_ns"]
    return {
        "_id": _object_id("result", row["run_id"], row["execution_id"]),
        "name": row["task"],
        "type": row["task_type"],
        "outcome": int(row["outcome"] in (Outcome.SUCCEEDED, COMPLETED)),
        "duration_planned": row["planned_duration_s"],
        "duration_real": (until - row["start_ns"]) / 1e9,
        "planning_time": row["planning_time_s"],
        "path_length": row["path_length"],
        "date": {"$date": _date(until)},
        "recipe": recipe,
        "agent": row["agent"],
        "t_start": row["start_ns"] / 1e9,
        "t_end": until / 1e9,
        "t_start_planned": _seconds_since(row["planned_start_ns"], zero),
        "t_end_planned": _seconds_since(row["planned_end_ns"], zero),
        OWN: row,
    }


def _seconds_since(instant: int | None, zero: int) -> float | None:
    return None if instant is None else (instant - zero) / 1e9


def _date(instant: int) -> str:
    return datetime.fromtimestamp(instant // 1_000_000 / 1e3, UTC).isoformat(timespec="milliseconds")[:-6] + "Z"


def _object_id(*parts: str) -> Document:
    """Return an ObjectId that is the same whenever the same thing is exported."""
    return {"$oid": hashlib.sha256("\0".join(parts).encode()).hexdigest()[:24]}
