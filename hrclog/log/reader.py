"""Read event logs of any state - finished, unfinished, damaged, out of order - into one events frame.

Payload times come first; ties are broken by `seq`. Nothing is repaired silently: what was lost or doubtful is a
diagnostic, and one bad file never hides the others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import polars as pl

from hrclog.diagnostic import Diagnostic
from hrclog.errors import LogReadError
from hrclog.events import COLUMNS, EVENT_CLASSES, SCHEMA_VERSION
from hrclog.ids import derived_id
from hrclog.log.bags import is_bag, read_bag
from hrclog.log.decode import (
    EVENT_COLUMNS,
    SIGNAL_COLUMNS,
    Complain,
    Decoded,
    decode_contents,
    decode_topics,
    is_event_channel,
    is_wanted,
)
from hrclog.log.discover import find_logs
from hrclog.log.message import EVENTS
from hrclog.log.records import MAGIC, Contents, read_contents

ORDER: Final = ("run_id", "time_ns", "seq", "kind", "execution_id")
"""The total order of events."""

_SQLITE: Final = b"SQLite format 3\x00"


@dataclass(frozen=True, slots=True)
class Logs:
    """What a set of files holds.

    `events` has the columns of `hrclog.log.message.EVENTS` in the order `ORDER`; `signals` run_id, name, time_ns, value.
    """

    events: pl.DataFrame
    signals: pl.DataFrame
    diagnostics: list[Diagnostic] = field(default_factory=list)
    paths: list[Path] = field(default_factory=list)


def read_logs(
    arguments: Iterable[str | Path], *, signals: bool = False, on_file: Callable[[Path], None] = lambda _: None
) -> Logs:
    """Read logs, folders and globs.

    Args:
        arguments: what to read.
        signals: also read scalar and joint signals.
        on_file: called after each file, for progress.

    Raises:
        LogReadError: nothing matched, or no file could be read at all.
    """
    arguments = [arguments] if isinstance(arguments, str | Path) else list(arguments)
    paths = find_logs(arguments)
    if not paths:
        names = ", ".join(map(str, arguments)) or "no argument"
        raise LogReadError(names, "no log", "paths, folders or globs of .mcap files")
    parts: list[Logs] = []
    failures: list[LogReadError] = []
    for path in paths:
        try:
            parts.append(read_log(path, signals=signals))
        except LogReadError as error:
            failures.append(error)
        on_file(path)
    if not parts:
        raise failures[0] if len(failures) == 1 else LogReadError(
            paths[0].parent, f"{len(failures)} files that cannot be read, the first: {failures[0]}", "at least one log"
        )
    return _combine(parts, failures)


def read_events(paths: str | Path | Iterable[str | Path]) -> pl.DataFrame:
    """Read the events of logs, folders and globs, ordered by (run_id, time_ns, seq).

    Returns:
        One row per event with the columns of `hrclog.log.message.EVENTS`; instants in ns on the recorder's clock,
        texts "" and numbers null where unset.

    Raises:
        LogReadError: nothing matched, or a file cannot be read; `read_logs` reads past such files.
    """
    logs = read_logs([paths] if isinstance(paths, str | Path) else paths)
    for diagnostic in logs.diagnostics:
        if diagnostic.code == "unreadable_file":
            raise LogReadError(diagnostic.path, diagnostic.message, "an event log", "leave it out, or use read_logs")
    return logs.events


def read_log(path: Path, *, signals: bool = False) -> Logs:
    """Read one file or bag.

    Raises:
        LogReadError: it is missing, cannot be opened, or is no event log at all.
    """
    diagnostics: list[Diagnostic] = []

    def complain(code: str, text: str, offset: int | None = None) -> None:
        diagnostics.append(Diagnostic(code, text, str(path), offset=offset))

    if not path.exists():
        raise LogReadError(path, "nothing", "an event log", "check the path")
    decoded = _decode_bag(path, complain) if is_bag(path) else _decode_mcap(path, complain, signals=signals)
    events = pl.concat(decoded.events) if decoded.events else pl.DataFrame(schema=EVENT_COLUMNS)
    events = events.with_columns(pl.lit(str(path)).alias("path"))
    events = _named_runs(events, path, complain)
    if events.is_empty() and not any(diagnostic.severity == "error" for diagnostic in diagnostics):
        complain("no_events", "the log carries no task events on /hrc/events")
    samples = pl.concat(decoded.signals) if decoded.signals else pl.DataFrame(schema=SIGNAL_COLUMNS)
    if events["run_id"].n_unique() == 1:
        samples = samples.with_columns(pl.lit(events["run_id"][0]).alias("run_id"))
    return Logs(events, samples, diagnostics, [path])


def _decode_bag(path: Path, complain: Complain) -> Decoded:
    return decode_topics(read_bag(path), complain)


def _decode_mcap(path: Path, complain: Complain, *, signals: bool) -> Decoded:
    contents = _read_mcap(path, signals=signals)
    for problem in contents.problems:
        complain(problem.code, problem.message, problem.offset)
    if not contents.finished and not any(problem.code == "no_header" for problem in contents.problems):
        complain("unfinished_log", "the log was not closed; `hrclog recover` closes it", None)
    return decode_contents(contents, complain)


def _read_mcap(path: Path, *, signals: bool) -> Contents:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise LogReadError(path, f"a file that cannot be opened ({error.strerror})", "an event log") from error
    if data.startswith(_SQLITE):
        raise LogReadError(path, "an SQLite file", "a log", "name the bag's folder, the one with metadata.yaml")
    if data.startswith(b"RRF"):
        raise LogReadError(path, "a Rerun recording", "an event log", f"open it with `hrclog view {path}`")
    # a kill before or within the magic bytes leaves a prefix of them
    if not data.startswith(MAGIC) and not MAGIC.startswith(data):
        raise LogReadError(path, f"a file that begins with {data[:8]!r}", "an MCAP log or a ROS bag")
    return read_contents(data, is_wanted if signals else is_event_channel)


def _named_runs(events: pl.DataFrame, path: Path, complain: Complain) -> pl.DataFrame:
    nameless = events.filter(pl.col("run_id") == "").height
    if not nameless:
        return events
    complain("no_run_id", f"{nameless} events name no run; they are taken as one run of this file", None)
    run_id = derived_id("file", str(path.resolve()))
    named = pl.when(pl.col("run_id") == "").then(pl.lit(run_id)).otherwise("run_id")
    return events.with_columns(named.alias("run_id"))


def _combine(parts: list[Logs], failures: list[LogReadError]) -> Logs:
    diagnostics = [diagnostic for part in parts for diagnostic in part.diagnostics]
    diagnostics += [Diagnostic("unreadable_file", str(failure), str(failure.path)) for failure in failures]
    events = pl.concat([part.events for part in parts])
    if len(parts) > 1:
        events = _without_copies(events, diagnostics)
    events = events.select(EVENTS.names()).sort(ORDER, maintain_order=True)
    diagnostics += _sequence_diagnostics(events) + _content_diagnostics(events)
    events = events.with_columns(_finite())
    samples = pl.concat([part.signals for part in parts])
    if len(parts) > 1:
        samples = samples.unique(maintain_order=True)
    samples = samples.sort("run_id", "name", "time_ns", maintain_order=True)
    return Logs(events, samples, diagnostics, [path for part in parts for path in part.paths])


def _finite() -> list[pl.Expr]:
    numbers = [name for name, kind in EVENTS.items() if kind == pl.Float64]
    return [pl.when(pl.col(name).is_finite()).then(pl.col(name)).alias(name) for name in numbers]


def _without_copies(events: pl.DataFrame, diagnostics: list[Diagnostic]) -> pl.DataFrame:
    """Drop events that another file holds too (a journal beside its finished log, a file given twice)."""
    unique = events.unique(subset=COLUMNS, keep="first", maintain_order=True)
    if unique.height < events.height:
        copies = events.join(unique, on=[*COLUMNS, "path"], how="anti", nulls_equal=True)
        for path, count in copies.group_by("path", maintain_order=True).len().iter_rows():
            text = f"{count} events are in another file too and were counted once"
            diagnostics.append(Diagnostic("duplicate_events", text, path))
    return unique


def _sequence_diagnostics(events: pl.DataFrame) -> list[Diagnostic]:
    found: list[Diagnostic] = []
    by_run = events.group_by("run_id", maintain_order=True).agg(
        pl.col("path").first(),
        pl.col("seq").min().alias("low"),
        pl.col("seq").max().alias("high"),
        pl.col("seq").n_unique().alias("distinct"),
        pl.len(),
        (pl.col("seq").diff() < 0).sum().alias("backwards"),
    )
    for row in by_run.iter_rows(named=True):
        path, run_id = row["path"], row["run_id"]
        missing = row["high"] + 1 - row["distinct"]
        if row["low"] >= 0 and missing > 0:
            found.append(Diagnostic("events_missing", f"{missing} events between seq 0 and {row['high']} are missing", path, run_id))
        if row["distinct"] < row["len"]:
            text = f"{row['len'] - row['distinct']} events share the sequence number of another, different event"
            found.append(Diagnostic("conflicting_seq", text, path, run_id))
        if row["backwards"]:
            text = f"{row['backwards']} times run backwards against the order of writing"
            found.append(Diagnostic("time_not_monotonic", text, path, run_id))
    return found


def _content_diagnostics(events: pl.DataFrame) -> list[Diagnostic]:
    found: list[Diagnostic] = []
    unknown = events.filter(~pl.col("kind").is_in(list(EVENT_CLASSES)))
    for path, run_id, kind, seq, count in _first_of(unknown, "kind"):
        text = f"{count} events are of the unknown kind {kind!r}"
        found.append(Diagnostic("unknown_event", text, path, run_id, seq))
    newer = events.filter(pl.col("schema_version") > SCHEMA_VERSION)
    for path, run_id, version, seq, count in _first_of(newer, "schema_version"):
        text = f"{count} events have schema version {version}, this hrclog knows {SCHEMA_VERSION}"
        found.append(Diagnostic("newer_schema", text, path, run_id, seq))
    for name in [name for name, kind in EVENTS.items() if kind == pl.Float64]:
        strange = events.filter(~pl.col(name).is_finite())
        for path, run_id, value, seq, count in _first_of(strange, name):
            text = f"{name} is {value} in {count} events and counts as unset"
            found.append(Diagnostic("non_finite_value", text, path, run_id, seq))
    return found


def _first_of(events: pl.DataFrame, name: str) -> list[tuple[str, str, object, int, int]]:
    groups = events.group_by("path", "run_id", name, maintain_order=True).agg(pl.col("seq").first(), pl.len())
    return list(groups.iter_rows())
