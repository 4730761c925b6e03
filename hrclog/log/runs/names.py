"""Runs for events that name none: those of one recording are one run, however many files it was split into."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import polars as pl

from hrclog.ids import derived_id
from hrclog.log.runs.splits import Part, chains, part_of
from hrclog.wording import counted

_NAMELESS: Final = pl.col("run_id") == ""


@dataclass(frozen=True, slots=True)
class Joined:
    """What becomes of a file of a recording: new names of runs by the old, and what there is to say, "" for nothing."""

    names: Mapping[str, str]
    text: str


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
    return [named(events, {"": ids.get(path, "")}) for path, events in pieces], texts


def joined_splits(files: Mapping[Path, pl.DataFrame]) -> dict[Path, Joined]:
    """Find the files beside each other whose events name no run and go on from file to file.

    Args:
        files: files with such events, and their events with the runs that `name_runs` gave.
    """
    folders: dict[Path, list[Part]] = defaultdict(list)
    counts: dict[Path, int] = {}
    for path, events in files.items():
        nameless = events.filter(pl.col("run_id") == _file_run_id(path))
        if nameless.height:
            folders[path.absolute().parent].append(part_of(path, nameless))
            counts[path] = nameless.height
    joined: dict[Path, Joined] = {}
    for recording in (recording for parts in folders.values() for recording in chains(parts, one_bag=False)):
        if len(recording) > 1:
            first = recording[0].path
            text = _text(sum(counts[part.path] for part in recording), recording)
            for part in recording:
                names = {_file_run_id(part.path): _file_run_id(first)}
                joined[part.path] = Joined(names, text if part.path == first else "")
    return joined


def named(frame: pl.DataFrame, names: Mapping[str, str]) -> pl.DataFrame:
    """Return a frame with other names of runs."""
    return frame.with_columns(pl.col("run_id").replace(names))


def _file_run_id(path: Path) -> str:
    return derived_id("file", str(path.resolve()))


def _text(n_events: int, recording: Sequence[Part]) -> str:
    nameless_text = counted(n_events, "event names no run; it is", "events name no run; they are")
    if len(recording) == 1:
        return f"{nameless_text} taken as one run of this file"
    names = ", ".join(part.path.name for part in recording)
    return f"{nameless_text} taken as one run of {len(recording)} files that go on from one to the next: {names}"
