"""Read event logs of any state - finished, unfinished, damaged, out of order - into one events frame.

Payload times come first; ties are broken by `seq`. Nothing is repaired silently: what was lost or doubtful is a
diagnostic, and one bad file never hides the others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import polars as pl

from hrclog.diagnostic import Diagnostic
from hrclog.errors import LogReadError
from hrclog.ids import derived_id
from hrclog.log.bags import is_bag, read_bag
from hrclog.log.checks import check_events, usable, without_copies
from hrclog.log.contents import Contents
from hrclog.log.decode import (
    EVENT_COLUMNS,
    Complain,
    Decoded,
    decode_contents,
    decode_topics,
    is_event_channel,
    is_wanted,
)
from hrclog.log.discover import find_logs, unread_logs
from hrclog.log.files import exists
from hrclog.log.indexed import read_contents
from hrclog.log.journal import PARTIAL_SUFFIX, journal_path
from hrclog.log.losses import NO_FOOTER, annotated_losses, recorded_losses
from hrclog.log.message import EVENTS
from hrclog.log.recorded_scene import RecordedScene, merged, recorded_scene
from hrclog.log.records import MAGIC
from hrclog.log.signals import SIGNAL_COLUMNS, merged_samples
from hrclog.wording import counted

ORDER: Final = ("run_id", "time_ns", "seq", "kind", "execution_id")
"""The total order of events."""

_MOST_RUNS: Final = 5  # named in a message
_SQLITE: Final = b"SQLite format 3\x00"


@dataclass(frozen=True, slots=True)
class Logs:
    """What a set of files holds.

    `events` has the columns of `hrclog.log.message.EVENTS` in the order `ORDER`; `signals` has `SIGNAL_COLUMNS`.
    Signals and scene are empty unless they were asked for.
    """

    events: pl.DataFrame
    signals: pl.DataFrame
    diagnostics: list[Diagnostic] = field(default_factory=list)
    paths: list[Path] = field(default_factory=list)
    scene: RecordedScene = field(default_factory=RecordedScene)


def read_logs(
    arguments: Iterable[str | Path], *, signals: bool = False, on_file: Callable[[Path], None] = lambda _: None
) -> Logs:
    """Read logs, folders and globs.

    Args:
        arguments: what to read.
        signals: also read scalar and joint signals, and what was recorded of the scene.
        on_file: called after each file, for progress.

    Raises:
        LogReadError: nothing matched, or no file could be read at all.
    """
    arguments = [arguments] if isinstance(arguments, str | Path) else list(arguments)
    paths = _find_paths(arguments)
    parts, failures = _read_all(paths, on_file, signals=signals)
    if len(failures) == 1 and not parts:
        raise failures[0]
    if not parts:
        failure_text = f"{len(failures)} files that cannot be read, the first: {failures[0]}"
        raise LogReadError(paths[0].parent, failure_text, "at least one log")
    logs = _combine(parts, failures)
    notes = [Diagnostic("unread_logs", text, str(path)) for path, text in unread_logs(arguments, paths)]
    return replace(logs, diagnostics=[*logs.diagnostics, *notes])


def read_events(paths: str | Path | Iterable[str | Path]) -> pl.DataFrame:
    """Read the events of logs, folders and globs, ordered by (run_id, time_ns, seq).

    Returns:
        One row per event with the columns of `hrclog.log.message.EVENTS`; instants in ns on the recorder's clock,
        texts "" and numbers null where unset.

    Raises:
        LogReadError: nothing matched, or a file cannot be read; `read_logs` reads past such files.
    """
    parts, failures = _read_all(_find_paths([paths] if isinstance(paths, str | Path) else list(paths)))
    if failures:
        raise failures[0]
    return _combine(parts, []).events


def _find_paths(arguments: list[str | Path]) -> list[Path]:
    paths = find_logs(arguments)
    if not paths:
        names = ", ".join(map(str, arguments)) or "no argument"
        raise LogReadError(names, "no log", "paths, folders or globs of .mcap files")
    return paths


def _read_all(
    paths: list[Path], on_file: Callable[[Path], None] = lambda _: None, *, signals: bool = False
) -> tuple[list[Logs], list[LogReadError]]:
    parts: list[Logs] = []
    failures: list[LogReadError] = []
    for path in paths:
        try:
            parts.append(read_log(path, signals=signals))
        except LogReadError as error:
            failures.append(error)
        on_file(path)
    return parts, failures


def read_log(path: Path, *, signals: bool = False) -> Logs:
    """Read one file or bag.

    Raises:
        LogReadError: it is missing, cannot be opened, or is no event log at all.
    """
    diagnostics: list[Diagnostic] = []

    def complain(code: str, text: str, offset: int | None = None) -> None:
        diagnostics.append(Diagnostic(code, text, str(path), offset=offset))

    if not exists(path):
        journal = journal_path(path)
        remedy = f"its recorder was killed: hrclog recover {journal}" if exists(journal) else "check the path"
        raise LogReadError(path, "nothing", "an event log", remedy)
    if is_bag(path):
        decoded = decode_topics(read_bag(path), complain, signals=signals)
    else:
        decoded = _decode_mcap(path, complain, signals=signals)
    events = pl.concat(decoded.events) if decoded.events else pl.DataFrame(schema=EVENT_COLUMNS)
    events = events.with_columns(pl.lit(str(path)).alias("path"))
    events = _name_runs(events, path, complain)
    if events.is_empty() and not any(diagnostic.severity == "error" for diagnostic in diagnostics):
        complain("no_events", "the log carries no task events on /hrc/events")
    run_ids = events["run_id"].unique().to_list()
    only_run = str(run_ids[0]) if len(run_ids) == 1 else None
    is_nameless = any(diagnostic.code == "no_run_id" for diagnostic in diagnostics)
    if run_ids and not is_nameless:
        _report_foreign_samples(decoded.signals, run_ids, complain)
    samples = _samples(decoded.signals, only_run, is_nameless=is_nameless)
    scene = recorded_scene(decoded.scene, only_run, lambda text: complain("invalid_scene", text))
    return Logs(events, samples, diagnostics, [path], scene)


def _samples(frames: list[pl.DataFrame], only_run: str | None, *, is_nameless: bool) -> pl.DataFrame:
    """Return the samples of a file; those that name no run belong to its only one."""
    samples = pl.concat(frames) if frames else pl.DataFrame(schema=SIGNAL_COLUMNS)
    if only_run is None or _runs_of(frames) <= {only_run}:
        return samples
    named = pl.lit(value=not is_nameless) & (pl.col("run_id") != "")
    return samples.with_columns(pl.when(named).then("run_id").otherwise(pl.lit(only_run)).alias("run_id"))


def _runs_of(frames: list[pl.DataFrame]) -> set[str]:
    """Return the runs that frames name; all samples of a frame are of one channel, which names one."""
    return {str(frame["run_id"][0]) for frame in frames if frame.height}


def _report_foreign_samples(frames: list[pl.DataFrame], run_ids: list[str], complain: Complain) -> None:
    """Report samples that name a run of which the file has no event; they stay that run's."""
    for run_id in sorted(_runs_of(frames) - {"", *run_ids}):
        samples = pl.concat(frame for frame in frames if frame.height and frame["run_id"][0] == run_id)
        whose = f"of run {run_id!r}, the first of {samples['name'][0]!r}"
        expected = f"expected run {run_ids[0]!r}" if len(run_ids) == 1 else f"expected one of {len(run_ids)} runs"
        text = counted(samples.height, "sample is", "samples are")
        complain("foreign_records", f"{text} {whose}, of which the file has no event; {expected}", None)


def _decode_mcap(path: Path, complain: Complain, *, signals: bool) -> Decoded:
    contents = _read_mcap(path, signals=signals)
    for problem in contents.problems:
        complain(problem.code, problem.message, problem.offset)
    if contents.unprotected:
        complain("unprotected", "no checksum covers the messages of this file: damage to them cannot be seen", None)
    for text in recorded_losses(contents.metadata):
        complain("recovered_with_losses", text, None)
    codes = {problem.code for problem in contents.problems}
    if contents.finished or "no_header" in codes:
        pass
    elif path.name.endswith(PARTIAL_SUFFIX):
        complain("unfinished_log", "the log was not closed; `hrclog recover` closes it", None)
    elif "truncated" not in codes:
        complain("truncated", NO_FOOTER, None)
    decoded = decode_contents(contents, complain, signals=signals)
    if path.name.endswith(PARTIAL_SUFFIX) and contents.is_ours:
        _report_several_runs(decoded.events, complain)
    return decoded


def _report_several_runs(events: list[pl.DataFrame], complain: Complain) -> None:
    """Report that a journal holds more than the one run that a recorder writes into it."""
    run_ids = pl.concat([EVENT_COLUMNS.to_frame().select("run_id"), *(frame.select("run_id") for frame in events)])
    if run_ids["run_id"].n_unique() > 1:
        runs = run_ids.group_by("run_id", maintain_order=True).len().rows()
        parts = ", ".join(f"{n_events:,} of {run_id!r}" for run_id, n_events in runs[:_MOST_RUNS])
        text = f"the journal holds events of {len(runs)} runs ({parts}), expected one: parts of another file are in it"
        complain("foreign_records", text, None)


def _read_mcap(path: Path, *, signals: bool) -> Contents:
    if not path.is_file():
        raise LogReadError(path, "something that is no regular file", "an event log")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise LogReadError(path, f"a file that cannot be opened ({error.strerror})", "an event log") from error
    if path.suffix == ".rrd":
        raise _foreign_error(path, data)
    contents = read_contents(data, is_wanted if signals else is_event_channel)
    # a kill before or within the magic bytes leaves a prefix of them
    if contents.header is None and not contents.batches and not (data.startswith(MAGIC) or MAGIC.startswith(data)):
        raise _foreign_error(path, data)
    return contents


def _foreign_error(path: Path, data: bytes) -> LogReadError:
    """Return the error for a file that is no log."""
    if data.startswith(_SQLITE):
        return LogReadError(path, "an SQLite file", "a log", "name the bag's folder, the one with metadata.yaml")
    if data.startswith(b"RRF") or path.suffix == ".rrd":
        return LogReadError(path, "a Rerun recording", "an event log", f"open it with `hrclog view {path}`")
    remedy = "turn it into logs with `hrclog import`" if data[:1] in (b"[", b"{") else ""
    return LogReadError(path, f"a file that begins with {data[:8]!r}", "an MCAP log or a ROS bag", remedy)


def _name_runs(events: pl.DataFrame, path: Path, complain: Complain) -> pl.DataFrame:
    nameless = events.filter(pl.col("run_id") == "").height
    if not nameless:
        return events
    nameless_text = counted(nameless, "event names no run; it is", "events name no run; they are")
    complain("no_run_id", f"{nameless_text} taken as one run of this file", None)
    run_id = derived_id("file", str(path.resolve()))
    run_ids = pl.when(pl.col("run_id") == "").then(pl.lit(run_id)).otherwise("run_id")
    return events.with_columns(run_ids.alias("run_id"))


def _combine(parts: list[Logs], failures: list[LogReadError]) -> Logs:
    # the result does not depend on the order of the arguments
    parts = sorted(parts, key=lambda part: part.paths)
    diagnostics = [diagnostic for part in parts for diagnostic in part.diagnostics]
    diagnostics += [
        Diagnostic("unreadable_file", failure.reason, str(failure.path))
        for failure in sorted(failures, key=lambda failure: failure.path)
    ]
    events, copies = without_copies(pl.concat([part.events for part in parts]))
    events = events.select(EVENTS.names()).sort(ORDER, maintain_order=True)
    diagnostics += [*annotated_losses(events, diagnostics), *copies, *check_events(events)]
    events = usable(events)
    samples = merged_samples([part.signals for part in parts])
    paths = [path for part in parts for path in part.paths]
    return Logs(events, samples, diagnostics, paths, merged(part.scene for part in parts))
