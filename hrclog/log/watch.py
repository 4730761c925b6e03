"""What lies in a folder of logs now: journals that may grow, and logs."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from hrclog.errors import LogReadError
from hrclog.log.files.names import BAG_METADATA, is_annotations_name
from hrclog.log.writing.journal import PARTIAL_SUFFIX

Stamp = tuple[int, int, int]
"""Number of the file, its bytes, and when it was last changed in ns; equal stamps mean that nothing was."""


@dataclass(frozen=True, slots=True)
class Listing:
    """The journals of a folder that no finished log stands beside, and its other logs."""

    journals: Mapping[Path, Stamp]
    logs: Mapping[Path, Stamp]


def list_folder(folder: Path) -> Listing:
    """Return what lies right in a folder, by name.

    Raises:
        LogReadError: it is not there, is no folder, or cannot be opened.
    """
    try:
        with os.scandir(folder) as entries:
            stamps = sorted((Path(entry.path), stamp) for entry in entries if (stamp := _stamp(entry)) is not None)
    except OSError as error:
        description = {FileNotFoundError: "nothing", NotADirectoryError: "a file"}.get(
            type(error), f"a folder that cannot be opened ({error.strerror})"
        )
        raise LogReadError(
            folder, description, "a folder into which runs are recorded", "make it, or name another"
        ) from error
    logs = {path: stamp for path, stamp in stamps if not path.name.endswith(PARTIAL_SUFFIX)}
    journals = {path: stamp for path, stamp in stamps if path not in logs and finished_log(path) not in logs}
    return Listing(journals, logs)


def finished_log(journal: Path) -> Path:
    """Return the log that a journal becomes."""
    return journal.with_name(journal.name.removesuffix(PARTIAL_SUFFIX))


def _stamp(entry: os.DirEntry[str]) -> Stamp | None:
    """Return the stamp of a log, None of anything else, and of what has just gone."""
    try:
        if is_annotations_name(entry.name):
            return None
        if entry.name.endswith((".mcap", ".bag", f".mcap{PARTIAL_SUFFIX}")) and entry.is_file():
            status = entry.stat()
        elif entry.is_dir():
            status = (Path(entry.path) / BAG_METADATA).stat()
        else:
            return None
    except OSError:
        return None
    return status.st_ino, status.st_size, status.st_mtime_ns
