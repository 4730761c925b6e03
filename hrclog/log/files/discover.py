"""Find the logs that paths, folders and globs name."""

from __future__ import annotations

import glob
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from hrclog.log.files.system import exists
from hrclog.wording import agree, counted

COMPRESSIONS: Final = (".zstd", ".zst", ".gz")
_JOURNAL_ENDING: Final = ".partial"
_LOG_ENDINGS: Final = (".mcap", ".mcap.partial", ".db3", ".bag", ".bag.active")
BAG_METADATA: Final = "metadata.yaml"
ANNOTATIONS_SUFFIX: Final = ".annotations.mcap"
"""Ends the name of a file of annotations, which is read with the log beside it, and is none itself."""


def find_logs(arguments: Iterable[str | Path]) -> list[Path]:
    """Return the logs that paths, folders and globs name, each once, in the order of the arguments and then by name.

    A folder means the logs right in it, or is itself a log where it is a ROS 2 bag. A path that does not exist is
    returned too, so that reading it says so.
    """
    paths: dict[Path, None] = {}
    for argument in arguments:
        for candidate in _expand(argument):
            paths.update(dict.fromkeys(_logs_at(candidate)))
    logs = [path for path in paths if not is_annotations_name(path.name)]
    return logs or list(paths)


def plain_name(name: str) -> str:
    """Return the name of a file before it was compressed."""
    return next((name.removesuffix(ending) for ending in COMPRESSIONS if name.endswith(ending)), name)


def is_journal_name(name: str) -> bool:
    """Return whether a file of that name is a journal, perhaps compressed."""
    return plain_name(name).endswith(_JOURNAL_ENDING)


def is_annotations_name(name: str) -> bool:
    """Return whether a file of that name holds annotations of the log beside it."""
    return plain_name(name).endswith(ANNOTATIONS_SUFFIX)


def is_log_name(name: str) -> bool:
    """Return whether a folder's file of that name is taken for a log, or a part of a bag."""
    if name.startswith("._") or is_annotations_name(name):  # the former is what macOS leaves beside copies
        return False
    return plain_name(name).endswith(_LOG_ENDINGS)


def unread_logs(arguments: Iterable[str | Path], found: Iterable[Path]) -> list[tuple[Path, str]]:
    """Return what a user may have meant too: (folder, which logs there were not read).

    Journals beside several logs of one folder (a glob for *.mcap passes over runs that were killed, of all runs), and
    logs in the subfolders of a folder.
    """
    chosen = {path.absolute() for path in found}
    folders = Counter(path.parent for path in chosen)
    notes: list[tuple[Path, str]] = []
    for folder, count in sorted(folders.items()):
        journals = {path.absolute() for path in folder.glob("*.mcap.partial")} - chosen if count > 1 else set()
        if journals:
            journals_text = f"{counted(len(journals), 'unfinished log')} (*.mcap.partial) beside these"
            notes.append((folder, f"{journals_text} {agree(len(journals), 'was', 'were')} not read"))
    for argument in map(Path, arguments):
        below = _logs_below(argument) - chosen
        if below:
            remedy = agree(len(below), "was not read; name it too", "were not read; name those too")
            notes.append((argument, f"{counted(len(below), 'log')} in its subfolders {remedy}"))
    return notes


def _logs_below(folder: Path) -> set[Path]:
    if not exists(folder) or not folder.is_dir() or (folder / BAG_METADATA).exists():
        return set()
    paths = (path for path in folder.glob("*/*") if is_log_name(path.name))
    return {path.absolute() for path in paths if not (path.parent / BAG_METADATA).exists()}


def _expand(argument: str | Path) -> list[Path]:
    path = Path(argument)
    if exists(path) or not glob.has_magic(str(argument)):
        return [path]
    return [Path(match) for match in sorted(glob.glob(str(argument), recursive=True))]  # noqa: PTH207 - absolute globs


def _logs_at(path: Path) -> list[Path]:
    if not exists(path) or not path.is_dir() or (path / BAG_METADATA).exists():
        return [path]
    files = {match for match in path.glob("*") if is_log_name(match.name) and match.is_file()}
    bags = {folder.parent for folder in path.glob(f"*/{BAG_METADATA}")}
    return sorted(files | bags)
