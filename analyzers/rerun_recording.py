"""The file of a recording: opened, closed, and nothing of it left in memory."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from hrclog.analyzers.figures.text import UNNAMED
from hrclog.errors import OutputError

try:
    from rerun_bindings import flush_and_cleanup_orphaned_recordings as _free
except ImportError:  # it is not public

    def _free() -> None:
        """Leave four threads and the memory of each recording until the process ends."""


@contextmanager
def freed_recordings() -> Iterator[None]:
    """Give back the threads and the memory of recordings that nothing refers to any more.

    Use it as a decorator of the function that holds the recording: Rerun 0.41 frees none by itself.
    """
    try:
        yield
    finally:
        _free()


@contextmanager
def recording(
    application: str, recording_id: str, name: str, path: Path | str, blueprint: rrb.Blueprint
) -> Iterator[rr.RecordingStream]:
    """Give a stream whose data go to a file.

    Args:
        application: whose layout it has.
        recording_id: tells recordings of an application apart.
        name: to show.
        path: of the file, which is replaced.
        blueprint: the layout.

    Raises:
        OutputError: the file cannot be written.
    """
    with _output_errors(path):
        Path(path).write_bytes(b"\0")  # a stream that finds no place for its data complains on standard error
    # automatic properties hold the time of rendering: two renderings of one log would differ
    rec = rr.RecordingStream(application, recording_id=recording_id, send_properties=False)
    try:
        with _output_errors(path):
            rec.save(path, default_blueprint=blueprint)
        rec.send_recording_name(name)
        yield rec
        with _output_errors(path):
            rec.flush()  # else a full disk goes unnoticed
    finally:
        rec.disconnect()


@contextmanager
def _output_errors(path: Path | str) -> Iterator[None]:
    try:
        yield
    except (OSError, RuntimeError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or error
        raise OutputError(path, f"the recording cannot be written ({reason})") from error


def entity(*parts: str) -> str:
    """Return the path of an entity, whose parts may hold any character."""
    # Rerun 0.41 reads an escaped backslash before the next "/" as an escaped slash, and would join two parts
    whole = [part + "_" if part.endswith("\\") else part or UNNAMED for part in parts]
    return rr.new_entity_path(whole)
