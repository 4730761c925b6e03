"""Import the paper authors' MongoDB dumps: one log per recipe, every id derived from its row.

A dump is an array of extended-JSON documents, one per execution. `recipe` names the run; `t_start` and `t_end` are
binary floats in epoch seconds, converted exactly; planned instants are seconds from the start of the run.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from decimal import ROUND_HALF_EVEN, Decimal
from pathlib import Path
from typing import Any, Final

from hrclog.diagnostic import Diagnostic
from hrclog.errors import ImportDataError
from hrclog.events import Event, Outcome, RunEnded, RunStarted, TaskEnded, TaskStarted
from hrclog.ids import derived_id
from hrclog.log.reader import read_log
from hrclog.log.writer import write_log

SOURCE: Final = "mongo"

_TEXTS: Final = ("name", "agent", "recipe")
_INSTANTS: Final = ("t_start", "t_end")
_KEPT_IN_DETAILS: Final = ("duration_real", "date")
_UNSAFE: Final = re.compile(r"[^\w.+-]+")


@dataclass(frozen=True, slots=True)
class Imported:
    """What an import did."""

    written: list[Path] = field(default_factory=list)
    unchanged: list[Path] = field(default_factory=list)
    n_executions: int = 0
    diagnostics: list[Diagnostic] = field(default_factory=list)
    recipes: list[str] = field(default_factory=list)


def import_mongo(
    sources: Iterable[Path], folder: Path, on_run: Callable[[Path], None] = lambda _: None
) -> Imported:
    """Write one log per recipe; a recipe whose log is there already is left alone.

    Args:
        sources: dumps of task results.
        folder: where the logs go.
        on_run: called after each recipe, for progress.

    Raises:
        ImportDataError: a source is no such dump, or an existing log holds another run under the same name.
    """
    result = Imported()
    executions: list[dict[str, Any]] = []
    for source in sources:
        rows, skipped = read_task_results(source)
        executions += rows
        result.diagnostics.extend(skipped)
    folder.mkdir(parents=True, exist_ok=True)
    n_executions = 0
    for recipe, rows in sorted(_by_recipe(executions).items()):
        path = folder / f"{file_name(recipe)}.mcap"
        events = run_events(recipe, rows)
        if path.exists():
            _check_unchanged(path, events)
            result.unchanged.append(path)
        else:
            write_log(path, events)
            result.written.append(path)
        result.recipes.append(recipe)
        n_executions += len(rows)
        on_run(path)
    return Imported(result.written, result.unchanged, n_executions, result.diagnostics, result.recipes)


def read_task_results(source: Path) -> tuple[list[dict[str, Any]], list[Diagnostic]]:
    """Return the usable documents of a dump, and a diagnostic for each other.

    Raises:
        ImportDataError: the file is missing, not JSON, or no array of task results.
    """
    try:
        documents = json.loads(source.read_text(encoding="utf-8"))
    except OSError as error:
        raise ImportDataError(source, f"a file that cannot be opened ({error.strerror})", "a dump of task_results") from error
    except ValueError as error:
        raise ImportDataError(source, f"no JSON ({error})", "a JSON array of task results") from error
    if isinstance(documents, dict):
        documents = [documents]
    if not isinstance(documents, list):
        raise ImportDataError(source, f"a JSON {type(documents).__name__}", "an array of task results")
    rows: list[dict[str, Any]] = []
    skipped: list[Diagnostic] = []
    for number, document in enumerate(documents):
        problem = _problem(document)
        if problem:
            skipped.append(Diagnostic("skipped_row", f"document {number}: {problem}", str(source)))
        else:
            rows.append(document)
    if documents and not rows:
        remedy = "give the task_results collection, not task_durations, task_synergies or task_properties"
        raise ImportDataError(source, f"no task result ({skipped[0].message})", "documents with t_start and t_end", remedy)
    return rows, skipped


def run_events(recipe: str, rows: Iterable[Mapping[str, Any]]) -> list[Event]:
    """Return the events of one recipe, in order of time."""
    ordered = sorted(rows, key=lambda row: (exact_ns(row["t_start"]), row["agent"], _document_id(row)))
    run_id = derived_id(SOURCE, recipe)
    zero = exact_ns(ordered[0]["t_start"])
    end = max(exact_ns(row["t_end"]) for row in ordered)
    agents = tuple(sorted({row["agent"] for row in ordered}))
    task_events: list[tuple[tuple[int, int, int], Event]] = []
    for number, row in enumerate(ordered):
        started, ended = _execution_events(row, run_id, zero)
        # at one instant ends come before starts, but an execution of no length still starts before it ends
        no_length = started.time_ns == ended.time_ns
        task_events.append(((started.time_ns, 1, number), started))
        task_events.append(((ended.time_ns, 1 if no_length else 0, number), ended))
    task_events.sort(key=lambda item: item[0])
    return [
        RunStarted(time_ns=zero, run_id=run_id, name=recipe, agents=agents, details={"source": SOURCE}),
        *(event for _, event in task_events),
        RunEnded(time_ns=end, run_id=run_id),
    ]


def exact_ns(seconds: float) -> int:
    """Return a binary float of seconds as nanoseconds, rounded once and to even.

    The float is converted exactly: `round(seconds * 1e9)` would be off by up to 128 ns at today's epoch.
    """
    return int((Decimal(seconds) * 1_000_000_000).to_integral_value(ROUND_HALF_EVEN))


def file_name(recipe: str) -> str:
    """Return a file name for a recipe: the recipe where it is safe, else cleaned and told apart by a hash."""
    clean = _UNSAFE.sub("_", recipe).strip(".")[:120]
    return clean if clean == recipe else f"{clean}_{derived_id(SOURCE, recipe)[:8]}"


def _execution_events(row: Mapping[str, Any], run_id: str, zero: int) -> tuple[TaskStarted, TaskEnded]:
    identity = {
        "run_id": run_id,
        "agent": row["agent"],
        "task": row["name"],
        "task_type": str(row.get("type") or ""),
        "execution_id": derived_id(SOURCE, row["recipe"], _document_id(row)),
    }
    started = TaskStarted(
        time_ns=exact_ns(row["t_start"]),
        planned_start_ns=_planned(row, "t_start_planned", zero),
        planned_end_ns=_planned(row, "t_end_planned", zero),
        **identity,
    )
    succeeded = row.get("outcome", 1) == 1
    ended = TaskEnded(
        time_ns=exact_ns(row["t_end"]),
        outcome=Outcome.SUCCEEDED if succeeded else Outcome.FAILED,
        reason="" if succeeded else f"outcome {row['outcome']!r}",
        planned_duration_s=_number(row, "duration_planned"),
        planning_time_s=_number(row, "planning_time"),
        path_length=_number(row, "path_length"),
        details={name: row[name] for name in _KEPT_IN_DETAILS if _is_plain(row.get(name))},
        **identity,
    )
    return started, ended


def _problem(document: Any) -> str | None:  # noqa: ANN401 - any JSON value
    if not isinstance(document, dict):
        return f"found a {type(document).__name__}, expected an object"
    for name in _TEXTS:
        if not isinstance(document.get(name), str) or not document[name]:
            return f"{name} is {document.get(name)!r}, expected a name"
    for name in _INSTANTS:
        value = document.get(name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            return f"{name} is {value!r}, expected epoch seconds"
    if not 0 <= document["t_start"] <= document["t_end"] < 2**63 / 1e9:
        return f"t_start {document['t_start']!r} and t_end {document['t_end']!r} are no interval of time"
    return None


def _document_id(row: Mapping[str, Any]) -> str:
    identity = row.get("_id")
    if isinstance(identity, dict) and "$oid" in identity:
        return str(identity["$oid"])
    return json.dumps([row["agent"], row["name"], row["t_start"], row["t_end"]])


def _planned(row: Mapping[str, Any], name: str, zero: int) -> int | None:
    seconds = _number(row, name)
    return None if seconds is None else zero + exact_ns(seconds)


def _number(row: Mapping[str, Any], name: str) -> float | None:
    value = row.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def _is_plain(value: Any) -> bool:  # noqa: ANN401 - any JSON value
    return value is not None and not (isinstance(value, float) and not math.isfinite(value))


def _by_recipe(rows: Iterable[Mapping[str, Any]]) -> dict[str, list[Mapping[str, Any]]]:
    """Group documents by recipe; the same document given twice counts once."""
    runs: dict[str, dict[str, Mapping[str, Any]]] = {}
    for row in rows:
        runs.setdefault(row["recipe"], {}).setdefault(_document_id(row), row)
    return {recipe: list(documents.values()) for recipe, documents in runs.items()}


def _check_unchanged(path: Path, events: list[Event]) -> None:
    existing = read_log(path).events
    found = set(existing["run_id"].unique())
    if found != {events[0].run_id}:
        raise ImportDataError(path, "a log of another run", "no file, or the log of the same recipe", "use an empty folder")
    if existing.height != len(events):
        remedy = "the dump has changed since: import into an empty folder"
        raise ImportDataError(path, f"a log of {existing.height} events", f"{len(events)} events of this recipe", remedy)
