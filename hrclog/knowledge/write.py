"""The changes that a knowledge base knows, each within a transaction that another function holds."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sqlalchemy import Connection, Table, delete, insert, select

from hrclog.knowledge.records import RunRecord, Version
from hrclog.knowledge.rows import clean
from hrclog.knowledge.tables import (
    DERIVED,
    OF_RUNS,
    RUNS,
    STATISTICS,
    STATISTICS_RUNS,
    TASK_DURATIONS,
    TASK_PROPERTIES,
    TASK_RESULTS,
    TASK_SYNERGIES,
    TASK_TIMES,
    WITHDRAWALS,
)
from hrclog.knowledge.view import StatisticsEntry

if TYPE_CHECKING:
    import polars as pl

    from hrclog.knowledge.task_times import TaskTimes


@dataclass(frozen=True, slots=True)
class Taught:
    """What an estimator makes of runs; frames with the columns of durations and synergies of an analysis."""

    durations: pl.DataFrame
    synergies: pl.DataFrame
    times: TaskTimes


def put_run(connection: Connection, run: RunRecord) -> str:
    """Keep a run, in place of an earlier version; return added, replaced or unchanged."""
    where = RUNS.c.run_id == run.run_id
    existing = connection.execute(select(RUNS.c.n_events, RUNS.c.digest).where(where)).one_or_none()
    if not run.version.supersedes(None if existing is None else Version(*existing)):
        return "unchanged"
    if existing is not None:
        connection.execute(delete(RUNS).where(where))
        connection.execute(delete(TASK_RESULTS).where(TASK_RESULTS.c.run_id == run.run_id))
    _insert(connection, RUNS, [_run_row(run)])
    _insert(connection, TASK_RESULTS, run.results.to_dicts())
    _put_snapshot(connection, run)
    if existing is not None:
        used_snapshots = select(RUNS.c.snapshot)
        connection.execute(delete(TASK_PROPERTIES).where(TASK_PROPERTIES.c.snapshot.not_in(used_snapshots)))
    return "added" if existing is None else "replaced"


def clear_runs(connection: Connection) -> None:
    """Delete everything that comes from logs; withdrawals stay."""
    for table in OF_RUNS:
        connection.execute(delete(table))


def put_statistics(connection: Connection, taught: Taught, made_from: StatisticsEntry) -> None:
    """Put statistics in the place of those that are there."""
    for table in DERIVED:
        connection.execute(delete(table))
    _insert(connection, TASK_DURATIONS, _rows(TASK_DURATIONS, taught.durations))
    _insert(connection, TASK_SYNERGIES, _rows(TASK_SYNERGIES, taught.synergies))
    _insert(connection, TASK_TIMES, _times(taught.times))
    key = {"statistics_id": made_from.statistics_id}
    entry = {name: getattr(made_from, name) for name in STATISTICS.c.keys()}  # noqa: SIM118 - columns are no mapping
    _insert(connection, STATISTICS, [entry])
    _insert(connection, STATISTICS_RUNS, [key | {"run_id": run, "digest": digest} for run, digest in made_from.runs])


def put_withdrawal(connection: Connection, run_id: str, reason: str | None) -> None:
    """Withdraw a run, or with `reason` None take it back in."""
    connection.execute(delete(WITHDRAWALS).where(WITHDRAWALS.c.run_id == run_id))
    if reason is not None:
        _insert(connection, WITHDRAWALS, [{"run_id": run_id, "reason": reason}])


def _insert(connection: Connection, table: Table, rows: list[dict[str, Any]]) -> None:
    if rows:
        connection.execute(insert(table), rows)


def _run_row(run: RunRecord) -> dict[str, Any]:
    return {
        "run_id": run.run_id,
        "digest": run.version.digest,
        "name": run.name,
        "outcome": run.outcome,
        "start_ns": run.start_ns,
        "n_events": run.version.n_events,
        "n_executions": run.results.height,
        "snapshot": run.snapshot,
    }


def _put_snapshot(connection: Connection, run: RunRecord) -> None:
    same_snapshot = select(TASK_PROPERTIES.c.task).where(TASK_PROPERTIES.c.snapshot == run.snapshot).limit(1)
    if run.tasks and connection.execute(same_snapshot).first() is None:
        _insert(connection, TASK_PROPERTIES, [{"snapshot": run.snapshot, **task.to_row()} for task in run.tasks])


def _rows(table: Table, frame: pl.DataFrame) -> list[dict[str, Any]]:
    return clean(frame.select(table.columns.keys())).to_dicts()


def _times(times: TaskTimes) -> list[dict[str, str]]:
    """Return times and gaps as rows; an entry with a number that is not finite is left out."""
    entries = [("time", entry) for entry in times.to_json()["times"]]
    entries += [("gap", entry) for entry in times.to_json()["gaps"]]
    return [
        {"kind": kind, "agent": entry["agent"], "task": entry.get("task", ""), "value": _json(entry)}
        for kind, entry in entries
        if _is_finite(entry)
    ]


def _is_finite(value: Any) -> bool:  # noqa: ANN401 - any JSON value
    if isinstance(value, float):
        return math.isfinite(value)
    entries = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return all(map(_is_finite, entries))


def _json(value: Any) -> str:  # noqa: ANN401 - any JSON value
    return json.dumps(value, ensure_ascii=False, sort_keys=True, allow_nan=False)
