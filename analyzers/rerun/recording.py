"""Open and close the file of a recording, and free its memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from hrclog.analyzers.figures.text import UNNAMED
from hrclog.files import write_output

try:
    from rerun_bindings import flush_and_cleanup_orphaned_recordings as _free
except ImportError:  # it is not public

    def _free() -> None:
        """Leave the threads and the memory of each recording until the process ends."""


TIMELINE: Final = "run_time"
"""The timeline of a run: time since its first event."""
RUNS: Final = "runs"
"""The timeline of a campaign: the number of runs counted so far."""


class Layout(rrb.Blueprint):
    """A blueprint that closes the stream it goes through, which Rerun 0.41 leaves open."""

    _stream: rr.RecordingStream | None = None

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        self._stream = stream
        super()._log_to_stream(stream)

    def close(self) -> None:
        """Close the stream, once the blueprint is sent."""
        if self._stream is not None:
            self._stream.disconnect()
            self._stream = None


@contextmanager
def freed_recordings() -> Iterator[None]:
    """Free the threads and the memory of recordings that nothing refers to any more.

    Use it to decorate the function that holds the recording, because Rerun 0.41 does not free recordings itself.
    """
    try:
        yield
    finally:
        _free()


@contextmanager
def recording(
    application: str, recording_id: str, name: str, path: Path | str, layout: Layout
) -> Iterator[rr.RecordingStream]:
    """Yield a stream, and write its contents to a file at the end.

    Args:
        application: whose layout it has.
        recording_id: identifies the recording within its application.
        name: to show.
        path: of the file, which is replaced.
        layout: how the recording opens.

    Raises:
        OutputError: the file cannot be written.
    """
    # automatic properties hold the time of rendering: two renderings of one log would differ
    rec = rr.RecordingStream(application, recording_id=recording_id, send_properties=False)
    # Rerun's own writer does not report a full disk, and sometimes waits for it for ever
    memory = rec.memory_recording()
    try:
        # a default layout is not applied to what a web viewer is served
        rec.send_blueprint(layout, make_active=True)
        layout.close()
        rec.send_recording_name(name)
        yield rec
    finally:
        data = memory.drain_as_bytes()
        rec.disconnect()
    write_output(Path(path), data)


def entity(*parts: str) -> str:
    """Return the path of an entity, whose parts may hold any character."""
    # Rerun 0.41 reads an escaped backslash before the next "/" as an escaped slash, and would join two parts
    safe_parts = [part + "_" if part.endswith("\\") else part or UNNAMED for part in parts]
    return rr.new_entity_path(safe_parts)


def times(ns: Iterable[int]) -> rr.TimeColumn:
    """Return instants of a run's timeline, ns since its first event."""
    return rr.TimeColumn(TIMELINE, duration=np.asarray(ns, np.int64).astype("timedelta64[ns]"))
