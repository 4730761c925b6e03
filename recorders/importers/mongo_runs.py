"""The events of the paper authors' MongoDB dumps: a run per recipe, every id derived from its row.

A dump is an array of extended-JSON documents, one per execution. `recipe` names the run; `t_start` and `t_end` are
binary floats in epoch seconds, converted exactly; planned instants are seconds from the start of the run.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from hrclog.diagnostic import Diagnostic
from hrclog.errors import ImportDataError
from hrclog.events import Event, RunEnded, RunStarted, TaskEnded, TaskStarted
from hrclog.ids import derived_id
from hrclog.recorders.importers.importer import Foreign
from hrclog.recorders.importers.mongo_dump import document_id, finite_number, read_task_results
from hrclog.recorders.importers.mongo_outcomes import Outcomes
from hrclog.recorders.importers.writing import exact_ns

SOURCE: Final = "mongo"

_KEPT_IN_DETAILS: Final = ("duration_real", "date")


def read_dumps(sources: Sequence[Path], outcomes: Outcomes) -> Foreign:
    """Return the runs of dumps, one per recipe.

    Raises:
        ImportDataError: no source is such a dump.
    """
    diagnostics: list[Diagnostic] = []
    recipes = _group_by_recipe(_read_all(list(sources), diagnostics), diagnostics)
    diagnostics += outcomes.diagnostics(row for rows in recipes.values() for row in rows)
    n_executions = sum(map(len, recipes.values()))

    def events(recipe: str) -> list[Event]:
        return run_events(recipe, (row for _, row in recipes[recipe]), outcomes)

    return Foreign(sorted(recipes), events, n_executions, diagnostics)


def run_events(recipe: str, rows: Iterable[Mapping[str, Any]], outcomes: Outcomes | None = None) -> list[Event]:
    """Return the events of one recipe, in order of time.

    Args:
        recipe: its name.
        rows: its executions.
        outcomes: what their outcomes mean, where that is not just 1, 0 and hrclog's own words.
    """
    outcomes = outcomes or Outcomes()
    ordered = sorted(rows, key=lambda row: (exact_ns(row["t_start"]), row["agent"], document_id(row)))
    run_id = derived_id(SOURCE, recipe)
    run_start_ns = exact_ns(ordered[0]["t_start"])
    run_end_ns = max(exact_ns(row["t_end"]) for row in ordered)
    agents = tuple(sorted({row["agent"] for row in ordered}))
    task_events: list[tuple[tuple[int, int, int], Event]] = []
    for number, row in enumerate(ordered):
        started, ended = _execution_events(row, run_id, run_start_ns, outcomes)
        # at one instant ends come before starts, but an execution of no length still starts before it ends
        no_length = started.time_ns == ended.time_ns
        task_events.append(((started.time_ns, 1, number), started))
        task_events.append(((ended.time_ns, 1 if no_length else 0, number), ended))
    task_events.sort(key=lambda item: item[0])
    return [
        RunStarted(time_ns=run_start_ns, run_id=run_id, name=recipe, agents=agents, details={"source": SOURCE}),
        *(event for _, event in task_events),
        RunEnded(time_ns=run_end_ns, run_id=run_id),
    ]


def _execution_events(
    row: Mapping[str, Any], run_id: str, run_start_ns: int, outcomes: Outcomes
) -> tuple[TaskStarted, TaskEnded]:
    identity = {
        "run_id": run_id,
        "agent": row["agent"],
        "task": row["name"],
        "task_type": str(row.get("type") or ""),
        "execution_id": derived_id(SOURCE, row["recipe"], document_id(row)),
    }
    started = TaskStarted(
        time_ns=exact_ns(row["t_start"]),
        planned_start_ns=_planned_ns(row, "t_start_planned", run_start_ns),
        planned_end_ns=_planned_ns(row, "t_end_planned", run_start_ns),
        **identity,
    )
    ended = TaskEnded(
        time_ns=exact_ns(row["t_end"]),
        outcome=outcomes.of(row),
        reason=outcomes.reason(row),
        planned_duration_s=finite_number(row, "duration_planned"),
        planning_time_s=finite_number(row, "planning_time"),
        path_length=finite_number(row, "path_length"),
        details={name: row[name] for name in _KEPT_IN_DETAILS if _is_json_value(row.get(name))}
        | outcomes.not_told(row),
        **identity,
    )
    return started, ended


def _read_all(sources: list[Path], diagnostics: list[Diagnostic]) -> list[tuple[Path, dict[str, Any]]]:
    """Return (source, document) of all sources; one that cannot be read hides no other."""
    executions: list[tuple[Path, dict[str, Any]]] = []
    failures: list[ImportDataError] = []
    for source in sources:
        try:
            rows, row_diagnostics = read_task_results(source)
        except ImportDataError as error:
            failures.append(error)
            continue
        executions += [(source, row) for row in rows]
        diagnostics += row_diagnostics
    if failures and len(failures) == len(sources):
        raise failures[0]
    diagnostics += [Diagnostic("unreadable_file", error.reason, str(error.path)) for error in failures]
    return executions


def _planned_ns(row: Mapping[str, Any], name: str, run_start_ns: int) -> int | None:
    seconds = finite_number(row, name)
    return None if seconds is None else run_start_ns + exact_ns(seconds)


def _is_json_value(value: Any) -> bool:  # noqa: ANN401 - any JSON value
    if value is None:
        return False
    try:
        json.dumps(value, allow_nan=False)
    except ValueError:
        return False
    return True


def _group_by_recipe(
    executions: Iterable[tuple[Path, Mapping[str, Any]]], diagnostics: list[Diagnostic]
) -> dict[str, list[tuple[Path, Mapping[str, Any]]]]:
    """Group documents, each with its source, by recipe; the same document given twice counts once."""
    runs: dict[str, dict[str, tuple[Path, Mapping[str, Any]]]] = {}
    for source, row in executions:
        _, first_row = runs.setdefault(row["recipe"], {}).setdefault(document_id(row), (source, row))
        if repr(first_row) != repr(row):  # NaN differs from itself, its text does not
            text = (
                f"a second, different document has the id {document_id(row)} in {row['recipe']!r}; the first was kept"
            )
            diagnostics.append(Diagnostic("skipped_row", text, str(source)))
    return {recipe: list(documents.values()) for recipe, documents in runs.items()}
