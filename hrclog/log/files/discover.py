"""Find the logs that paths, folders and globs name."""

from __future__ import annotations

import glob
import os
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from hrclog.log.files.annotation_files import annotation_files
from hrclog.log.files.names import BAG_METADATA, is_annotations_name
from hrclog.log.files.search import Identity, identity_of, search
from hrclog.log.files.system import exists
from hrclog.wording import agree, counted


@dataclass(frozen=True, slots=True)
class Discovery:
    """The logs that arguments name.

    Attributes:
        logs: each once, in the order of the arguments and then of the parts of their paths; a path that does not exist
            too, so that reading it says so.
        named: those of them that an argument names itself, and not through a folder.
        unreadable: folders that cannot be opened, and why.
        unread: what a user may have meant too: (folder, which logs there are not among these).
        lone_annotations: files of annotations in folders, of which none of these logs is beside.
    """

    logs: list[Path]
    named: frozenset[Path] = frozenset()
    unreadable: list[tuple[Path, str]] = field(default_factory=list)
    unread: list[tuple[Path, str]] = field(default_factory=list)
    lone_annotations: list[Path] = field(default_factory=list)


def discover(arguments: Iterable[str | Path]) -> Discovery:
    """Find logs. A folder is searched to any depth, or is itself a log where it is a ROS 2 bag."""
    logs: dict[Identity, Path] = {}
    named: set[Path] = set()
    unreadable: dict[Path, str] = {}
    results: dict[Path, None] = {}
    annotations: list[Path] = []
    for path in (match for argument in arguments for match in _expand(argument)):
        if not exists(path) or not path.is_dir():
            named.add(logs.setdefault(identity_of(path), path))
            continue
        folder = search(path)
        held = folder.logs
        if not held and not folder.unreadable and (path / BAG_METADATA).exists():  # a bag that has lost all its parts
            held = {identity_of(path): path}
        named.update(log for log in held.values() if log == path)
        for identity, log in held.items():
            logs.setdefault(identity, log)
        unreadable.update(folder.unreadable)
        results.update(dict.fromkeys(folder.results))
        annotations += folder.annotations
    plain = {identity: path for identity, path in logs.items() if not is_annotations_name(path.name)}
    logs = plain or logs
    unread = [*_journals_beside(logs.values()), *_in_results(results, logs)]
    lone = _lone(annotations, logs.values())
    return Discovery(list(logs.values()), frozenset(named), list(unreadable.items()), unread, lone)


def find_logs(arguments: Iterable[str | Path]) -> list[Path]:
    """Return the logs that paths, folders and globs name, as `discover` finds them."""
    return discover(arguments).logs


def _lone(annotations: Iterable[Path], logs: Iterable[Path]) -> list[Path]:
    """Return the files of annotations that are read with no log."""
    lone = {os.path.realpath(path): path for path in annotations}
    for log in logs if lone else ():
        for path in annotation_files(log):
            lone.pop(os.path.realpath(path), None)
    return list(lone.values())


def _journals_beside(logs: Iterable[Path]) -> list[tuple[Path, str]]:
    """Return journals beside several logs of one folder: a glob for *.mcap passes over runs that were killed."""
    chosen = {path.absolute() for path in logs}
    notes: list[tuple[Path, str]] = []
    for folder, count in sorted(Counter(path.parent for path in chosen).items()):
        journals = {path.absolute() for path in folder.glob("*.mcap.partial")} - chosen if count > 1 else set()
        if journals:
            journals_text = f"{counted(len(journals), 'unfinished log')} (*.mcap.partial) beside these"
            notes.append((folder, f"{journals_text} {agree(len(journals), 'was', 'were')} not read"))
    return notes


def _in_results(folders: Iterable[Path], logs: Iterable[Identity]) -> list[tuple[Path, str]]:
    chosen = set(logs)
    notes: list[tuple[Path, str]] = []
    for folder in folders:
        n_unread = len(set(search(folder).logs) - chosen)
        if n_unread:
            were = agree(n_unread, "was", "were")
            text = f"{counted(n_unread, 'log')} in this folder of results {were} not read; name the folder too"
            notes.append((folder, text))
    return notes


def _expand(argument: str | Path) -> list[Path]:
    path = Path(argument)
    if exists(path) or not glob.has_magic(str(argument)):
        return [path]
    return [Path(match) for match in sorted(glob.glob(str(argument), recursive=True))]  # noqa: PTH207 - absolute globs
