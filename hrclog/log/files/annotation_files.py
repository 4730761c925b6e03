"""Where annotations of a log are: `run.annotations.mcap` beside `run.mcap`, and beside what a link leads to."""

from __future__ import annotations

import os
from pathlib import Path

from hrclog.errors import LogWriteError
from hrclog.files import write_whole
from hrclog.log.files.names import ANNOTATIONS_SUFFIX, COMPRESSIONS, plain_name
from hrclog.log.files.system import exists

_UNFINISHED = ".partial"
_FINISHED = ".mcap"


def annotations_path(log: Path) -> Path:
    """Return where annotations of a log are written, whether it is finished, a journal, or compressed.

    Those of a link go to the file that it leads to, so that they hold under each of its names, unless the folder of
    that file cannot be written.
    """
    places = _places(log)
    return next((place for place in reversed(places) if os.access(place.parent, os.W_OK)), places[-1])


def annotation_files(log: Path) -> list[Path]:
    """Return the files that hold annotations of a log, each once, whatever link led to it, also compressed ones."""
    names = [place.with_name(place.name + ending) for place in _places(log) for ending in ("", *COMPRESSIONS)]
    return list({os.path.realpath(name): name for name in names if exists(name)}.values())


def copy_annotations(log: Path, copy: Path) -> None:
    """Lay the annotations of a log beside a copy of it that has another name, if none are there.

    Raises:
        LogWriteError: they cannot be written.
    """
    files = annotation_files(log)
    if not files or annotation_files(copy):
        return
    for file in files:
        ending = file.name.rpartition(ANNOTATIONS_SUFFIX)[-1]
        place = annotations_path(copy)
        place = place.with_name(place.name + ending)
        try:
            write_whole(place, file.read_bytes(), durable=True)
        except OSError as error:
            reason = f"cannot be written ({error.strerror})"
            raise LogWriteError(place, reason, f"copy {file} there") from error


def _places(log: Path) -> list[Path]:
    """Return the annotations of a log by the name given, then by that of the file that it leads to."""
    logs = [log] if log.name not in ("", "..") else []  # `.` has no name of its own
    if not logs or os.path.islink(log):  # noqa: PTH114 - that of a path fails on names that are too long
        logs.append(Path(os.path.realpath(log)))
    return [_beside(each) for each in logs]


def _beside(log: Path) -> Path:
    name = plain_name(log.name).removesuffix(_UNFINISHED).removesuffix(_FINISHED)
    return log.with_name(f"{name}{ANNOTATIONS_SUFFIX}")
