"""Runs for events that name none: those of one recording are one run, however many files it was split into."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import polars as pl

from hrclog.diagnostic import Diagnostic
from hrclog.ids import derived_id
from hrclog.log.splits import Part, chains, part_of
from hrclog.wording import counted

if TYPE_CHECKING:
    from hrclog.log.reader import Logs

CODE: Final = "no_run_id"

_NAMELESS: Final = pl.col("run_id") == ""


def name_runs(pieces: Sequence[tuple[Path, pl.DataFrame]], log: Path) -> tuple[list[pl.DataFrame], list[str]]:
    """Name the runs of one log's events.

    Args:
        pieces: the files of the log and their events.
        log: the log, which gives its first run's id; it is the only file, or the folder of a bag.

    Returns:
        The events with their runs, as they came, and what there is to say of each run.
    """
    nameless = {path: part for path, events in pieces if (part := events.filter(_NAMELESS)).height}
    if not nameless:
        return [events for _, events in pieces], []
    recordings = chains([part_of(path, events) for path, events in nameless.items()], one_bag=True)
    ids = {
        part.path: _file_run_id(log if number == 0 else recording[0].path)
        for number, recording in enumerate(recordings)
        for part in recording
    }
    texts = [_text(sum(nameless[part.path].height for part in recording), recording) for recording in recordings]
    return [_named(events, {"": ids.get(path, "")}) for path, events in pieces], texts


def joined_splits(parts: Sequence[Logs]) -> list[Logs]:
    """Make one run of files beside each other whose events name none and go on from file to file."""
    folders: dict[Path, list[Logs]] = defaultdict(list)
    for part in parts:
        if any(finding.code == CODE for finding in part.diagnostics) and not part.paths[0].is_dir():
            folders[part.paths[0].absolute().parent].append(part)
    changed: dict[Path, Logs] = {}
    for beside in folders.values():
        if len(beside) > 1:
            changed |= _joined(beside)
    return [changed.get(part.paths[0], part) for part in parts]


def _joined(beside: Sequence[Logs]) -> dict[Path, Logs]:
    """Return the logs of one folder that are parts of a recording, by their path."""
    logs = {part.paths[0]: part for part in beside}
    events = {path: part.events.filter(pl.col("run_id") == _file_run_id(path)) for path, part in logs.items()}
    changed: dict[Path, Logs] = {}
    for recording in chains([part_of(path, frame) for path, frame in events.items()], one_bag=False):
        if len(recording) < 2:
            continue
        first = recording[0].path
        text = _text(sum(events[part.path].height for part in recording), recording)
        for part in recording:
            log = logs[part.path]
            findings = [finding for finding in log.diagnostics if finding.code != CODE]
            findings += [Diagnostic(CODE, text, str(first))] if part.path == first else []
            changed[part.path] = _renamed(log, {_file_run_id(part.path): _file_run_id(first)}, findings)
    return changed


def _renamed(log: Logs, names: Mapping[str, str], findings: list[Diagnostic]) -> Logs:
    scene = replace(
        log.scene,
        scenes={names.get(run, run): part for run, part in log.scene.scenes.items()},
        descriptions={(names.get(run, run), agent): text for (run, agent), text in log.scene.descriptions.items()},
        poses=_named(log.scene.poses, names),
    )
    events, signals = _named(log.events, names), _named(log.signals, names)
    return replace(log, events=events, signals=signals, scene=scene, diagnostics=findings)


def _named(frame: pl.DataFrame, names: Mapping[str, str]) -> pl.DataFrame:
    return frame.with_columns(pl.col("run_id").replace(names))


def _file_run_id(path: Path) -> str:
    return derived_id("file", str(path.resolve()))


def _text(n_events: int, recording: Sequence[Part]) -> str:
    nameless_text = counted(n_events, "event names no run; it is", "events name no run; they are")
    if len(recording) == 1:
        return f"{nameless_text} taken as one run of this file"
    names = ", ".join(part.path.name for part in recording)
    return f"{nameless_text} taken as one run of {len(recording)} files that go on from one to the next: {names}"
