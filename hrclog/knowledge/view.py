"""What one state of a knowledge base holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import Connection, Table, select

from hrclog.errors import KnowledgeError, ScenarioError
from hrclog.json_text import parse_json
from hrclog.knowledge.tables import (
    RESULT_ORDER,
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

if TYPE_CHECKING:
    import polars as pl

    from hrclog.knowledge.properties import TaskProperties
    from hrclog.knowledge.task_times import TaskTimes

_IDS_AT_ONCE: Final = 500


@dataclass(frozen=True, slots=True)
class RunEntry:
    """A run that is kept.

    `snapshot` is the id of what it declares of tasks, `withdrawn` why statistics leave it out, None if they do not.
    """

    run_id: str
    digest: str
    name: str
    outcome: str
    start_ns: int
    n_events: int
    n_executions: int
    snapshot: str
    withdrawn: str | None = None


@dataclass(frozen=True, slots=True)
class StatisticsEntry:
    """What the statistics are made from: `runs` holds (run_id, digest), sorted."""

    statistics_id: str
    estimator: str
    estimator_version: int
    outliers: str
    runs: tuple[tuple[str, str], ...]


class View:
    """Reads from one state, whatever others write meanwhile.

    Args:
        connection: in a transaction that sees one state.
        where: the knowledge base, for messages.
    """

    def __init__(self, connection: Connection, where: str = "the knowledge base") -> None:
        self._connection = connection
        self._where = where

    def runs(self) -> list[RunEntry]:
        """Return all runs, withdrawn ones too, by (start_ns, run_id)."""
        columns = [RUNS.c[field.name] for field in fields(RunEntry) if field.name in RUNS.c]
        source = RUNS.outerjoin(WITHDRAWALS, RUNS.c.run_id == WITHDRAWALS.c.run_id)
        rows = self._connection.execute(select(*columns, WITHDRAWALS.c.reason.label("withdrawn")).select_from(source))
        return sorted((RunEntry(**row) for row in rows.mappings()), key=lambda run: (run.start_ns, run.run_id))

    def versions(self, run_ids: Sequence[str]) -> dict[str, tuple[int, str]]:
        """Return (number of events, digest) of those of some runs that are kept."""
        by_id: dict[str, tuple[int, str]] = {}
        for first in range(0, len(run_ids), _IDS_AT_ONCE):
            condition = RUNS.c.run_id.in_(run_ids[first : first + _IDS_AT_ONCE])
            rows = self._connection.execute(select(RUNS.c.run_id, RUNS.c.n_events, RUNS.c.digest).where(condition))
            by_id |= {run: (n_events, digest) for run, n_events, digest in rows}
        return by_id

    def used_runs(self) -> tuple[tuple[str, str], ...]:
        """Return (run_id, digest) of the runs that are not withdrawn, sorted."""
        rows = self._connection.execute(select(RUNS.c.run_id, RUNS.c.digest).where(_is_used(RUNS)))
        return tuple(sorted((run, digest) for run, digest in rows))

    def withdrawals(self) -> dict[str, str]:
        """Return why runs are withdrawn, by id; also runs that are not there (yet)."""
        rows = self._connection.execute(select(WITHDRAWALS.c.run_id, WITHDRAWALS.c.reason))
        return dict(sorted((run, reason) for run, reason in rows))

    def results(self, *, withdrawn: bool = False) -> pl.DataFrame:
        """Return the executions of the runs that are not withdrawn, or with `withdrawn` of those that are.

        Returns:
            One row per started execution with the columns of intervals, ordered as they are; `path` is "".
        """
        import polars as pl

        is_used = _is_used(TASK_RESULTS)
        frame = self._frame(TASK_RESULTS, ~is_used if withdrawn else is_used)
        return frame.sort(RESULT_ORDER).with_columns(pl.lit("").alias("path"))

    def durations(self) -> pl.DataFrame:
        """Return what is known of durations, one row per (agent, task); columns of the durations of an analysis."""
        return self._frame(TASK_DURATIONS).sort("agent", "task")

    def synergies(self) -> pl.DataFrame:
        """Return the synergies of pairs of tasks; columns of the synergies of an analysis."""
        return self._frame(TASK_SYNERGIES).sort("agent", "task", "other_agent", "other_task")

    def times(self) -> TaskTimes:
        """Return the task times for judging plans; none if there are no statistics yet."""
        from hrclog.json_record import JsonRecord
        from hrclog.knowledge.task_times import task_times_from_json

        values: dict[str, list[Any]] = {"time": [], "gap": []}
        try:
            for kind, value in self._connection.execute(select(TASK_TIMES.c.kind, TASK_TIMES.c.value)):
                values[kind].append(parse_json(value))
            record = {"times": values["time"], "gaps": values["gap"]}
            return task_times_from_json(JsonRecord(record, "task_times", ("times", "gaps")))
        except (ValueError, KeyError, ScenarioError) as error:
            what = f"task_times hold what hrclog did not write ({error})"
            remedy = f"make it anew from the logs: hrclog kb rebuild LOG... --kb {self._where}"
            raise KnowledgeError(self._where, what, remedy) from error

    def snapshots(self) -> dict[str, list[TaskProperties]]:
        """Return what runs declare of tasks, by the ids of the snapshots, sorted by name."""
        from hrclog.knowledge.properties import properties_from_row

        by_id: dict[str, list[TaskProperties]] = {}
        rows = self._connection.execute(select(TASK_PROPERTIES)).mappings()
        for row in sorted(rows, key=lambda row: (row["snapshot"], row["task"])):
            task = properties_from_row({str(name): value for name, value in row.items()})
            by_id.setdefault(row["snapshot"], []).append(task)
        return by_id

    def properties(self) -> list[TaskProperties]:
        """Return the tasks as the latest run that is not withdrawn declares each, sorted by name."""
        declared = self.snapshots()
        in_time = dict.fromkeys(reversed([run.snapshot for run in self.runs() if run.withdrawn is None]))
        latest_last = [task for snapshot in reversed(in_time) for task in declared.get(snapshot, [])]
        tasks = {task.task: task for task in latest_last}
        return [tasks[name] for name in sorted(tasks)]

    def statistics(self) -> StatisticsEntry | None:
        """Return what the statistics are made from, None where there are none yet."""
        row = self._connection.execute(select(STATISTICS)).mappings().one_or_none()
        if row is None:
            return None
        runs = self._connection.execute(select(STATISTICS_RUNS.c.run_id, STATISTICS_RUNS.c.digest))
        return StatisticsEntry(**row, runs=tuple(sorted((run, digest) for run, digest in runs)))

    def _frame(self, table: Table, *conditions: Any) -> pl.DataFrame:  # noqa: ANN401 - SQL expressions
        from hrclog.knowledge.rows import frame_of, frame_schema

        rows = self._connection.execute(select(table).where(*conditions)).all()
        return frame_of(rows, frame_schema(table))


def _is_used(table: Table) -> Any:  # noqa: ANN401 - an SQL expression
    return table.c.run_id.not_in(select(WITHDRAWALS.c.run_id))
