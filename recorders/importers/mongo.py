"""Import the paper authors' MongoDB dumps: one log per recipe, every id derived from its row.

A dump is an array of extended-JSON documents, one per execution. `recipe` names the run; `t_start` and `t_end` are
binary floats in epoch seconds, converted exactly; planned instants are seconds from the start of the run.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from decimal import ROUND_HALF_EVEN, Decimal
from pathlib import Path
from typing import Any, Final

from hrclog.diagnostic import Diagnostic
from hrclog.errors import ImportDataError, OutputError
from hrclog.event_rows import to_row
from hrclog.events import COLUMNS, Event, Outcome, RunEnded, RunStarted, TaskEnded, TaskStarted
from hrclog.file_names import file_stem
from hrclog.ids import derived_id
from hrclog.log.decode import frame_of_rows
from hrclog.log.reader import read_log
from hrclog.log.writer import write_log
from hrclog.recorders.importers.mongo_dump import document_id, finite_number, read_task_results
from hrclog.wording import counted

SOURCE: Final = "mongo"

_LONGEST_NAME: Final = 120  # bytes; file systems take 255, and a log grows a suffix while it is written
_KEPT_IN_DETAILS: Final = ("duration_real", "date")


@dataclass(frozen=True, slots=True)
class Imported:
    """What an import did."""

    written: list[Path] = field(default_factory=list)
    unchanged: list[Path] = field(default_factory=list)
    n_executions: int = 0
    diagnostics: list[Diagnostic] = field(default_factory=list)
    recipes: list[str] = field(default_factory=list)


def import_mongo(sources: Iterable[Path], folder: Path, on_run: Callable[[Path], None] = lambda _: None) -> Imported:
    """Write one log per recipe; a recipe whose log is there already is left alone.

    A source that cannot be read is a diagnostic beside the results of the others.

    Args:
        sources: dumps of task results.
        folder: where the logs go.
        on_run: called after each recipe, for progress.

    Raises:
        ImportDataError: no source is such a dump, or an existing log says something else than its recipe; then nothing
            is written.
        OutputError: the folder cannot be made.
    """
    diagnostics: list[Diagnostic] = []
    runs = _by_recipe(_read_all(list(sources), diagnostics), diagnostics)
    paths = {recipe: folder / f"{file_name(recipe)}.mcap" for recipe in sorted(runs)}
    known = {path for path in paths.values() if path.exists()}
    for recipe, path in paths.items():
        if path in known:
            _check_unchanged(path, run_events(recipe, runs[recipe]))
    _make_folder(folder)
    written: list[Path] = []
    for recipe, path in paths.items():
        if path not in known:
            write_log(path, run_events(recipe, runs[recipe]))
            written.append(path)
        on_run(path)
    unchanged = [path for path in paths.values() if path in known]
    return Imported(written, unchanged, sum(map(len, runs.values())), diagnostics, list(paths))


def run_events(recipe: str, rows: Iterable[Mapping[str, Any]]) -> list[Event]:
    """Return the events of one recipe, in order of time."""
    ordered = sorted(rows, key=lambda row: (exact_ns(row["t_start"]), row["agent"], document_id(row)))
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
    clean = file_stem(recipe, _LONGEST_NAME)
    return clean if clean == recipe else f"{clean}_{derived_id(SOURCE, recipe)[:8]}"


def _execution_events(row: Mapping[str, Any], run_id: str, zero: int) -> tuple[TaskStarted, TaskEnded]:
    identity = {
        "run_id": run_id,
        "agent": row["agent"],
        "task": row["name"],
        "task_type": str(row.get("type") or ""),
        "execution_id": derived_id(SOURCE, row["recipe"], document_id(row)),
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
        planned_duration_s=finite_number(row, "duration_planned"),
        planning_time_s=finite_number(row, "planning_time"),
        path_length=finite_number(row, "path_length"),
        details={name: row[name] for name in _KEPT_IN_DETAILS if _is_plain(row.get(name))},
        **identity,
    )
    return started, ended


def _read_all(sources: list[Path], diagnostics: list[Diagnostic]) -> list[tuple[Path, dict[str, Any]]]:
    """Return (source, document) of all sources; one that cannot be read hides no other."""
    executions: list[tuple[Path, dict[str, Any]]] = []
    failures: list[ImportDataError] = []
    for source in sources:
        try:
            rows, found = read_task_results(source)
        except ImportDataError as error:
            failures.append(error)
            continue
        executions += [(source, row) for row in rows]
        diagnostics += found
    if failures and len(failures) == len(sources):
        raise failures[0]
    diagnostics += [Diagnostic("unreadable_file", error.reason, str(error.path)) for error in failures]
    return executions


def _planned(row: Mapping[str, Any], name: str, zero: int) -> int | None:
    seconds = finite_number(row, name)
    return None if seconds is None else zero + exact_ns(seconds)


def _is_plain(value: Any) -> bool:  # noqa: ANN401 - any JSON value
    if value is None:
        return False
    try:
        json.dumps(value, allow_nan=False)
    except ValueError:
        return False
    return True


def _by_recipe(
    executions: Iterable[tuple[Path, Mapping[str, Any]]], diagnostics: list[Diagnostic]
) -> dict[str, list[Mapping[str, Any]]]:
    """Group documents by recipe; the same document given twice counts once."""
    runs: dict[str, dict[str, Mapping[str, Any]]] = {}
    for source, row in executions:
        kept = runs.setdefault(row["recipe"], {}).setdefault(document_id(row), row)
        if repr(kept) != repr(row):  # NaN differs from itself, its text does not
            text = (
                f"a second, different document has the id {document_id(row)} in {row['recipe']!r}; the first was kept"
            )
            diagnostics.append(Diagnostic("skipped_row", text, str(source)))
    return {recipe: list(documents.values()) for recipe, documents in runs.items()}


def _check_unchanged(path: Path, events: list[Event]) -> None:
    existing = read_log(path).events.sort("seq").select(COLUMNS)
    if set(existing["run_id"]) != {events[0].run_id}:
        found, expected = "a log of another run", "no file, or the log of the same recipe"
        raise ImportDataError(path, found, expected, "use an empty folder")
    remedy = "the dump has changed since: import into an empty folder"
    if existing.height != len(events):
        raise ImportDataError(
            path,
            f"a log of {counted(existing.height, 'event')}",
            f"{counted(len(events), 'event')} of this recipe",
            remedy,
        )
    imported = frame_of_rows([to_row(replace(event, seq=seq)) for seq, event in enumerate(events)]).select(COLUMNS)
    for seq, (old, new) in enumerate(zip(existing.rows(), imported.rows(), strict=True)):
        if old != new:
            name, was, now = next(fact for fact in zip(COLUMNS, old, new, strict=True) if fact[1] != fact[2])
            raise ImportDataError(path, f"{name} {was!r} in event {seq}", f"{now!r} as in the dump", remedy)


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(folder, f"the folder cannot be made ({error.strerror})") from error
