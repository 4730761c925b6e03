"""Read event logs of any state - finished, unfinished, damaged, out of order - into one events frame.

Payload times come first; ties are broken by `seq`. Nothing is repaired silently: what was lost or doubtful is a
diagnostic, and one bad file never hides the others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Final

import polars as pl

from hrclog.diagnostic import Diagnostic
from hrclog.errors import LogReadError, NoLogError
from hrclog.log.annotations.exclusions import Judged, exclusion_diagnostics, judged
from hrclog.log.bags.folder import is_bag
from hrclog.log.checks import check_events, check_given_numbers, usable, without_copies
from hrclog.log.clocks.correction import NO_CLOCKS, Clocks, on_one_clock
from hrclog.log.files.discover import Discovery, discover
from hrclog.log.logs import ORDER, Logs
from hrclog.log.losses import annotated_losses
from hrclog.log.messages.channels import EVENTS_TOPIC
from hrclog.log.messages.message import EVENTS
from hrclog.log.messages.recorded_scene import RecordedScene, merged
from hrclog.log.messages.signals import merged_samples
from hrclog.log.never_set import with_left_out_zero, with_numbers, without_unset
from hrclog.log.one_log import read_annotated
from hrclog.log.runs.names import Joined, joined_splits, named
from hrclog.log.runs.where import ALL_RUNS, Condition, Where, conditions
from hrclog.log.selected import selected, without_excluded_runs

_NO_TOPICS: Final = "it has no topics"
_LONE: Final = "annotations without the log that they are of, which was beside them: they were not read"


def read_logs(
    arguments: Iterable[str | Path],
    *,
    signals: bool = False,
    on_file: Callable[[Path], None] = lambda _: None,
    clocks: Clocks = NO_CLOCKS,
    where: Where = ALL_RUNS,
    with_excluded: bool = False,
) -> Logs:
    """Read logs, folders and globs.

    Args:
        arguments: what to read.
        signals: also read scalar and joint signals, and what was recorded of the scene.
        on_file: called after each file, for progress.
        clocks: by agent, how far its clock is ahead, in ns or as a text (+3600s); that is taken off its times.
        where: which runs, by their tags: texts such as participant=P01 or condition!=pilot, or values by key.
        with_excluded: also what annotations exclude, among all else.

    Raises:
        LogReadError: nothing matched, or no file could be read at all.
        HrclogError: no event names an agent of `clocks`, or an offset is none; or no run is as `where` says.
    """
    discovery = _discover(_listed(arguments))
    parts, failures = _read_all(discovery, on_file, signals=signals)
    if len(failures) == 1 and not parts:
        raise failures[0]
    if not parts:
        failure_text = f"{len(failures)} files that cannot be read, the first: {failures[0]}"
        raise LogReadError(failures[0].path.parent, failure_text, "at least one log") from failures[0]
    counting = _without_foreign(parts, discovery.named)
    logs = _combine(counting, failures, clocks, conditions(where), with_excluded=with_excluded)
    notes = [Diagnostic("unread_logs", text, str(path)) for path, text in discovery.unread]
    notes += [Diagnostic("annotation_unmatched", _LONE, str(path)) for path in discovery.lone_annotations]
    return replace(logs, diagnostics=[*logs.diagnostics, *notes])


def read_events(
    paths: str | Path | Iterable[str | Path], *, clocks: Clocks = NO_CLOCKS, where: Where = ALL_RUNS
) -> pl.DataFrame:
    """Read the events of logs, folders and globs, ordered by (run_id, time_ns, seq).

    Args:
        paths: what to read.
        clocks: by agent, how far its clock is ahead, in ns or as a text (+3600s); that is taken off its times.
        where: which runs, by their tags: texts such as participant=P01 or condition!=pilot, or values by key.

    Returns:
        One row per event with the columns of `hrclog.log.messages.message.EVENTS`; instants in ns on the recorder's
        clock, texts "" and numbers null where unset.

    Raises:
        LogReadError: nothing matched, or a file cannot be read; `read_logs` reads past such files.
        HrclogError: no event names an agent of `clocks`, or an offset is none; or no run is as `where` says.
    """
    parts, failures = _read_all(_discover(_listed(paths)))
    if failures:
        raise failures[0]
    return _combine(parts, [], clocks, conditions(where)).events


def _listed(arguments: object) -> list[str | Path]:
    """Return paths as a list; a user may give anything.

    Raises:
        LogReadError: it is no path and no list of them.
    """
    entries = [arguments] if isinstance(arguments, str | Path) or not isinstance(arguments, Iterable) else arguments
    paths: list[str | Path] = []
    for entry in entries:
        if not isinstance(entry, str | Path):
            shown = f"{entry!r} " if entry is None or isinstance(entry, int | float) else "something "
            raise LogReadError(
                "logs", f"{shown}of type {type(entry).__name__}", "paths, folders or globs of .mcap files"
            )
        paths.append(entry)
    return paths


def _discover(arguments: list[str | Path]) -> Discovery:
    """Find the logs.

    Raises:
        LogReadError: there is none.
    """
    discovery = discover(arguments)
    if not discovery.logs and not discovery.unreadable:
        names = ", ".join(map(str, arguments)) or "no argument"
        remedy = "; ".join(f"{path}: {text}" for path, text in discovery.unread)
        raise NoLogError(names, "no log", "paths, folders or globs of .mcap files", remedy)
    return discovery


def _read_all(
    discovery: Discovery, on_file: Callable[[Path], None] = lambda _: None, *, signals: bool = False
) -> tuple[list[Logs], list[LogReadError]]:
    parts: list[Logs] = []
    failures = [
        LogReadError(folder, f"a folder that cannot be opened ({reason})", "one to be searched for logs")
        for folder, reason in discovery.unreadable
    ]
    for path in discovery.logs:
        try:
            parts.append(read_annotated(path, signals=signals))
        except LogReadError as error:
            failures.append(error)
        on_file(path)
    return parts, failures


def _without_foreign(parts: list[Logs], named: frozenset[Path]) -> list[Logs]:
    """Make mere notes of recordings of another system that lie in a folder beside logs with events: none is lost."""
    if not any(part.events.height for part in parts):
        return parts
    return [
        replace(part, diagnostics=[_as_note(finding) for finding in part.diagnostics])
        if part.is_foreign and named.isdisjoint(part.paths)
        else part
        for part in parts
    ]


def tells_of_another_system(finding: Diagnostic) -> bool:
    """Return whether a finding tells of a recording with topics, of which none is of events."""
    is_about_topics = finding.code in ("no_events", "not_imported") and _NO_TOPICS not in finding.message
    return is_about_topics and f"{EVENTS_TOPIC} (" not in finding.message


def _as_note(finding: Diagnostic) -> Diagnostic:
    return replace(finding, code="not_imported") if finding.code == "no_events" else finding


def _join_splits(parts: list[Logs]) -> list[Logs]:
    """Make one run of files that a recording without run ids was split into."""
    nameless = {
        part.paths[0]: part.events
        for part in parts
        if any(diagnostic.code == "no_run_id" for diagnostic in part.diagnostics) and not is_bag(part.paths[0])
    }
    joined = joined_splits(nameless)
    return [_renamed(part, joined[part.paths[0]]) if part.paths[0] in joined else part for part in parts]


def _renamed(log: Logs, joined: Joined) -> Logs:
    names = joined.names
    scene = RecordedScene(
        {names.get(run, run): part for run, part in log.scene.scenes.items()},
        {(names.get(run, run), agent): text for (run, agent), text in log.scene.descriptions.items()},
        named(log.scene.poses, names),
    )
    diagnostics = [diagnostic for diagnostic in log.diagnostics if diagnostic.code != "no_run_id"]
    if joined.text:
        diagnostics.append(Diagnostic("no_run_id", joined.text, str(log.paths[0])))
    return Logs(named(log.events, names), named(log.signals, names), diagnostics, log.paths, scene)


def _combine(
    parts: list[Logs],
    failures: list[LogReadError],
    clocks: Clocks,
    wanted: tuple[Condition, ...],
    *,
    with_excluded: bool = False,
) -> Logs:
    # the result does not depend on the order of the arguments
    parts = _join_splits(sorted(parts, key=lambda part: part.paths))
    counting, exclusions = without_excluded_runs(parts)
    parts = parts if with_excluded else counting
    if wanted:
        parts = selected(parts, wanted)
    diagnostics = [diagnostic for part in parts for diagnostic in part.diagnostics]
    diagnostics += [
        Diagnostic("unreadable_file", failure.reason, str(failure.path))
        for failure in sorted(failures, key=lambda failure: failure.path)
    ]
    events, copies = without_copies(pl.concat([part.events for part in parts]))
    events, unset = without_unset(events.select(EVENTS.names()))
    events = with_left_out_zero(events)
    misnumbered = check_given_numbers(events)
    events, unnumbered = with_numbers(events)
    events, corrections = on_one_clock(events, clocks)
    events = events.sort(ORDER, maintain_order=True)
    losses = annotated_losses(events, diagnostics)
    diagnostics += [*losses, *copies, *unset, *misnumbered, *unnumbered, *corrections, *check_events(events)]
    events = usable(events)
    verdict = Judged(events, events.clear(), []) if with_excluded else judged(events)
    exclusions = [] if with_excluded else [*exclusions, *verdict.exclusions]
    diagnostics += exclusion_diagnostics(exclusions)
    samples = merged_samples([part.signals for part in parts])
    paths = [path for part in parts for path in part.paths]
    scene = merged(part.scene for part in parts)
    return Logs(verdict.events, samples, diagnostics, paths, scene, verdict.excluded, exclusions)
