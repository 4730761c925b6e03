"""The common part of all importers: write the events of foreign runs to one log per run, and overwrite none."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from decimal import ROUND_HALF_EVEN, Decimal
from pathlib import Path
from typing import Any, Final

import polars as pl

from hrclog.errors import HrclogError, ImportDataError, OutputError
from hrclog.event_rows import from_row, to_row
from hrclog.events import COLUMNS, Event, RunStarted
from hrclog.file_names import file_stem
from hrclog.files import sync_folder
from hrclog.ids import derived_id
from hrclog.log.messages.decode import frame_of_rows
from hrclog.log.one_log import read_log
from hrclog.log.writing.writer import pack_events, packed_bytes, write_log, write_packed
from hrclog.recorders.importers.importer import Foreign, Imported, Importer
from hrclog.tags import NO_TAGS
from hrclog.units import NS_PER_S
from hrclog.wording import counted

_DEBUG: Final = "`hrclog --debug import ...` shows where"
_LONGEST_NAME: Final = 120  # bytes; file systems take 255, and a log grows a suffix while it is written


def import_files(
    importer: Importer,
    sources: Sequence[Path],
    folder: Path | None,
    on_run: Callable[[Path], None] = lambda _: None,
    *,
    run_tags: Mapping[str, str] = NO_TAGS,
    **options: Any,  # noqa: ANN401 - what the importer's options hold
) -> Imported:
    """Write one log per run. A run whose log already exists is not written again.

    Args:
        importer: reads the sources.
        sources: files of the other system.
        folder: where the logs go; None to read the sources and write nothing.
        on_run: called after each run, for progress.
        run_tags: facts of every run, beside those that the source tells.
        options: of the importer; those that are not given have their defaults.

    Raises:
        ImportDataError: no source can be read, the importer failed, or an existing log says something else than its
            run; then nothing is written.
        OutputError: the folder cannot be made.
    """
    all_options = {option.name: option.default for option in importer.options} | options
    foreign = _tagged(_read_sources(importer, sources, all_options), run_tags)
    if folder is None:
        return Imported([], [], foreign.n_executions, list(foreign.diagnostics), list(foreign.names), foreign.reading)
    paths = {run: folder / f"{file_name(importer.name, run)}.mcap" for run in foreign.names}
    logs = _PackedLogs(foreign.columns) if foreign.columns else _EventLogs(importer, foreign, sources)
    written = _write_runs(paths, logs, folder, on_run)
    unchanged = [path for path in paths.values() if path not in set(written)]
    return Imported(written, unchanged, foreign.n_executions, list(foreign.diagnostics), list(paths), foreign.reading)


def _tagged(foreign: Foreign, tags: Mapping[str, str]) -> Foreign:
    """Return runs with further tags; they stand above what the source tells."""
    if not tags:
        return foreign

    def events(run: str) -> list[Event]:
        return [
            replace(event, tags={**event.tags, **tags}) if isinstance(event, RunStarted) else event
            for event in foreign.events(run)
        ]

    columns = (_tagged_columns(foreign.columns[0], tags), foreign.columns[1]) if foreign.columns else None
    return replace(foreign, events=events, columns=columns)


def _tagged_columns(events: pl.DataFrame, tags: Mapping[str, str]) -> pl.DataFrame:
    details = [
        _tagged_details(text, tags) if kind == RunStarted.kind else text
        for kind, text in events.select("kind", "details").iter_rows()
    ]
    return events.with_columns(pl.Series("details", details, pl.String))


def _tagged_details(text: str, tags: Mapping[str, str]) -> str:
    started = from_row({"kind": RunStarted.kind, "time_ns": 0, "details": text})
    assert isinstance(started, RunStarted)  # noqa: S101 - by its kind
    return str(to_row(replace(started, tags={**started.tags, **tags}))["details"])


def write_packed_logs(
    events: pl.DataFrame, spans: Mapping[str, tuple[int, int]], names: Mapping[str, str], folder: Path
) -> list[Path]:
    """Write one log per run from columns of events, and return the paths of all; one that exists is left alone.

    Args:
        events: an events frame, run after run, each numbered by `seq` from 0.
        spans: where each run lies in it.
        names: of the runs, for their files.
        folder: where the logs go.

    Raises:
        ImportDataError: an existing log says something else than its run; then nothing is written.
        OutputError: the folder cannot be made.
    """
    stems = {run: file_name("", names[run]) for run in spans}
    counts = Counter(stems.values())
    paths = {run: folder / f"{stem if counts[stem] == 1 else f'{stem}_{run}'}.mcap" for run, stem in stems.items()}
    _write_runs(paths, _PackedLogs((events, spans)), folder)
    return list(paths.values())


def _write_runs(
    paths: Mapping[str, Path],
    logs: _PackedLogs | _EventLogs,
    folder: Path,
    on_run: Callable[[Path], None] = lambda _: None,
) -> list[Path]:
    """Write the logs that are not there, once all that are there are known to say the same; return those written."""
    existing_paths = {path for path in paths.values() if path.exists()}
    for run, path in paths.items():
        logs.check(run, path, exists=path in existing_paths)
    _make_folder(folder)
    written: list[Path] = []
    for run, path in paths.items():
        if path not in existing_paths:
            logs.write(run, path)
            written.append(path)
        on_run(path)
    sync_folder(folder)
    return written


class _EventLogs:
    """Logs of runs whose events come one by one."""

    def __init__(self, importer: Importer, foreign: Foreign, sources: Sequence[Path]) -> None:
        self._importer, self._foreign, self._sources = importer, foreign, sources

    def _events(self, run: str) -> Sequence[Event]:
        return _run_events(self._importer, self._foreign, run, self._sources)

    def check(self, run: str, path: Path, *, exists: bool) -> None:
        """Raise if the events of a run are none, or the log that exists says something else."""
        events = self._events(run)
        if exists:
            rows = [to_row(replace(event, seq=seq)) for seq, event in enumerate(events)]
            _check_unchanged(path, frame_of_rows(rows).select(COLUMNS))

    def write(self, run: str, path: Path) -> None:
        """Write the log of a run."""
        write_log(path, self._events(run), self._foreign.signals(run))


class _PackedLogs:
    """Logs of runs whose events are columns."""

    def __init__(self, columns: tuple[pl.DataFrame, Mapping[str, tuple[int, int]]]) -> None:
        self._events, self._spans = columns
        self._packed = pack_events(self._events)

    def check(self, run: str, path: Path, *, exists: bool) -> None:
        """Raise if the log that exists says something else; equal bytes need no decoding."""
        if not exists or (path.is_file() and path.read_bytes() == packed_bytes(self._packed, *self._spans[run])):
            return
        _check_unchanged(path, self._events[slice(*self._spans[run])].select(COLUMNS))

    def write(self, run: str, path: Path) -> None:
        """Write the log of a run."""
        write_packed(path, self._packed, *self._spans[run])


def file_name(source: str, run: str) -> str:
    """Return a file name for a run: its name where that is safe, else cleaned and told apart by a hash."""
    clean = file_stem(run, _LONGEST_NAME)
    return clean if clean == run else f"{clean}_{derived_id(source, run)[:8]}"


def exact_ns(seconds: float | Decimal) -> int:
    """Return seconds, a decimal or a binary float, as nanoseconds, rounded once and to even.

    The float is converted exactly: `round(seconds * 1e9)` would be off by up to 128 ns at today's epoch.
    """
    return int((Decimal(seconds) * NS_PER_S).to_integral_value(ROUND_HALF_EVEN))


def _read_sources(importer: Importer, sources: Sequence[Path], options: dict[str, Any]) -> Foreign:
    try:
        foreign: object = importer.read(sources, **options)
    except HrclogError:
        raise
    except (Exception, SystemExit) as error:
        problem = f"importer {importer.name!r} raised {type(error).__name__}: {error}"
        raise ImportDataError(sources[0], problem, "runs", _DEBUG) from error
    if not isinstance(foreign, Foreign):
        problem = f"importer {importer.name!r} returned {type(foreign).__name__}"
        raise ImportDataError(sources[0], problem, "a Foreign")
    return foreign


def _run_events(importer: Importer, foreign: Foreign, run: str, sources: Sequence[Path]) -> Sequence[Event]:
    """Return the events of a run, checked: a user's importer may return anything."""
    who = f"importer {importer.name!r}, events of run {run!r}"
    try:
        events = list(foreign.events(run))
    except HrclogError:
        raise
    except (Exception, SystemExit) as error:
        raise ImportDataError(sources[0], f"{who}: {type(error).__name__}: {error}", "events", _DEBUG) from error
    strange = next((type(event).__name__ for event in events if not isinstance(event, Event)), None)
    if strange or not events:
        returned = f"{who}: {f'an entry of type {strange}' if strange else 'none'}"
        raise ImportDataError(sources[0], returned, "events of hrclog.events, run_started first")
    return events


def _check_unchanged(path: Path, imported: pl.DataFrame) -> None:
    existing = read_log(path).events.sort("seq").select(COLUMNS)
    if set(existing["run_id"]) != {imported["run_id"][0]}:
        content, expected = "a log of another run", "no file, or the log of the same run"
        raise ImportDataError(path, content, expected, "use an empty folder")
    if existing.equals(imported):
        return
    remedy = "the source has changed since, or how it is read: import into an empty folder"
    if existing.height != imported.height:
        existing_count, expected_count = counted(existing.height, "event"), counted(imported.height, "event")
        raise ImportDataError(path, f"a log of {existing_count}", f"{expected_count} of this run", remedy)
    known = {_event_key(row): row for row in existing.iter_rows(named=True)}
    for row in imported.iter_rows(named=True):
        event = f"{row['kind']} of {row['agent']!r}, {row['task']!r}" if row["agent"] else str(row["kind"])
        before = known.get(_event_key(row))
        if before is None:
            raise ImportDataError(path, f"no {event}", f"it at {row['time_ns']} ns, as in the source", remedy)
        name = next((name for name in COLUMNS if name != "seq" and before[name] != row[name]), None)
        if name is not None:
            found = f"{name} {before[name]!r} in event {before['seq']} ({event})"
            raise ImportDataError(path, found, f"{row[name]!r} as in the source", remedy)


def _event_key(row: Mapping[str, Any]) -> tuple[object, ...]:
    """Return what an event of an import is known by: its execution, else its instant."""
    instant = row["time_ns"] if not row["execution_id"] or row["kind"] not in ("task_started", "task_ended") else None
    instant = None if row["kind"] in ("run_started", "run_ended") else instant
    return row["kind"], row["execution_id"], row["reason"] if instant is not None else None, instant


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(folder, f"the folder cannot be made ({error.strerror})") from error
