"""Follow a journal while its recorder writes it: each look gives what was appended since the one before.

A journal holds each message in a chunk of its own (see `hrclog.log.writing.journal`), so all that is whole can be
used. What is written by half, and what fails its checksum with nothing good behind it, waits for the next look.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl
from mcap.opcode import Opcode

from hrclog.diagnostic import Diagnostic
from hrclog.errors import LogReadError
from hrclog.log.mcap.contents import Batch, Contents
from hrclog.log.mcap.records import MAGIC, Problem, Record, Walk, expand, record_at
from hrclog.log.messages.decode import EVENT_COLUMNS, decode_contents, is_event_channel
from hrclog.log.messages.message import EVENTS
from hrclog.log.messages.recorded_scene import RecordedScene, recorded_scene
from hrclog.log.messages.signals import SIGNAL_COLUMNS

BLOCK: Final = 1 << 24
"""Bytes that a look reads at most, unless a single record is longer."""

_SEEN: Final = 64  # bytes before the next one to read, by which another file under the same name is told
_HEAD: Final = np.dtype([("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")])


@dataclass(frozen=True, slots=True, eq=False)
class News:
    """What a look found.

    Attributes:
        events: rows of schema `hrclog.log.messages.message.EVENTS`, in the order of writing.
        signals: rows of `SIGNAL_COLUMNS`.
        scene: what was said of the cell.
        diagnostics: what could not be read.
        restarted: the journal is another one, or was cut: what former looks found no longer counts.
        more: there is more to read at once.
        changed_ns: when the file was last written, ns since the epoch.
    """

    events: pl.DataFrame
    signals: pl.DataFrame
    scene: RecordedScene = field(default_factory=RecordedScene)
    diagnostics: tuple[Diagnostic, ...] = ()
    restarted: bool = False
    more: bool = False
    changed_ns: int = 0


class JournalFollower:
    """Reads a journal that grows, piece by piece.

    Args:
        path: the journal, `NAME.mcap.partial`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file: tuple[int, int] | None = None
        self._position = 0
        self._seen = b""
        self._block = BLOCK
        self._contents = Contents()
        self._n_events = 0

    @property
    def position(self) -> int:
        """Return how many bytes have been understood; those behind them are half a message, or have yet to be read."""
        return self._position

    def look(self) -> News | None:
        """Return what is new, None where the journal is gone.

        Raises:
            LogReadError: it cannot be opened.
        """
        try:
            with self.path.open("rb") as stream:
                status = os.fstat(stream.fileno())
                restarted = self._restart_if_other(stream.fileno(), status)
                stream.seek(self._position)
                data = stream.read(self._block)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise LogReadError(self.path, f"a file that cannot be opened ({error.strerror})", "a journal") from error
        n_bytes, problems = self._take(data)
        self._position += n_bytes
        self._seen = (self._seen + data[:n_bytes])[-_SEEN:]
        more = status.st_size > self._position + (len(data) - n_bytes)
        self._block = BLOCK if n_bytes or not more else 2 * self._block
        return self._news(problems, restarted=restarted, more=more, changed_ns=status.st_mtime_ns)

    def _restart_if_other(self, fd: int, status: os.stat_result) -> bool:
        """Start again if the file is not the one that was read before."""
        file = status.st_dev, status.st_ino
        former, self._file = self._file, file
        if former is None:
            return False
        same = file == former and status.st_size >= self._position
        if same and self._seen:
            os.lseek(fd, self._position - len(self._seen), os.SEEK_SET)
            same = os.read(fd, len(self._seen)) == self._seen
        if not same:
            self._position, self._seen, self._block, self._contents = 0, b"", BLOCK, Contents()
            self._n_events = 0
        return not same

    def _take(self, data: bytes) -> tuple[int, list[Problem]]:
        """Take in the records that are whole; return how many bytes they fill, and the damage among them."""
        if self._position == 0 and len(data) < len(MAGIC):
            return 0, []
        events: list[bytes] = []
        others: list[bytes] = []
        problems: list[Problem] = []
        walk = Walk(data, problems)
        n_bytes, n_settled = len(MAGIC) if self._position == 0 and data.startswith(MAGIC) else 0, 0
        # keep events apart: their texts are views that would keep all other messages between them in memory
        for record in walk:
            try:
                self._take_record(data, record, events, others)
            except ValueError as error:
                walk.distrust(record, str(error))
                continue
            n_bytes, n_settled = record[3], len(problems)
        self._contents.batches = [_batch(messages) for messages in (events, others) if messages]
        at = self._position
        return n_bytes, [
            Problem(problem.code, at + problem.offset, problem.message) for problem in problems[:n_settled]
        ]

    def _take_record(self, data: bytes, record: Record, events: list[bytes], others: list[bytes]) -> None:
        if record[0] == Opcode.MESSAGE:
            raise ValueError("a message stands outside of a chunk")
        if record[0] != Opcode.CHUNK:
            self._contents.keep(data, record)
            return
        messages: list[bytes] = []
        buffer, position, end = expand(data, record)
        while position < end:
            content = record_at(buffer, position, end)
            if content is None:
                raise ValueError("a chunk holds bytes that are no record")
            if content[0] != Opcode.MESSAGE:
                self._contents.keep(buffer, content)
            elif content[3] - content[2] < _HEAD.itemsize:
                raise ValueError("a message is shorter than its header")
            else:
                messages.append(buffer[content[2] : content[3]])
            position = content[3]
        for message in messages:
            (events if self._is_event(message) else others).append(message)

    def _is_event(self, message: bytes) -> bool:
        channel = self._contents.channels.get(int.from_bytes(message[:2], "little"))
        return channel is not None and is_event_channel(channel, self._contents.schemas.get(channel.schema_id))

    def _news(self, problems: list[Problem], *, restarted: bool, more: bool, changed_ns: int) -> News:
        diagnostics = [
            Diagnostic(problem.code, problem.message, str(self.path), offset=problem.offset) for problem in problems
        ]

        def complain(code: str, text: str, offset: int | None = None) -> None:
            diagnostics.append(Diagnostic(code, text, str(self.path), offset=offset))

        decoded = decode_contents(self._contents, complain, signals=True)
        self._contents.batches = []
        scene = recorded_scene(decoded.scene, None, lambda text: complain("invalid_scene", text))
        events = pl.concat([EVENT_COLUMNS.to_frame(), *decoded.events])
        written = pl.int_range(self._n_events, self._n_events + pl.len(), dtype=pl.Int64)
        self._n_events += events.height
        events = events.with_columns(pl.col("seq").fill_null(written), pl.lit(str(self.path)).alias("path"))
        events = events.select(EVENTS.names())
        signals = pl.concat([SIGNAL_COLUMNS.to_frame(), *decoded.signals])
        return News(events, signals, scene, tuple(diagnostics), restarted, more, changed_ns)


def _batch(messages: list[bytes]) -> Batch:
    """Return whole messages, head and body, as a batch."""
    data = b"".join(messages)
    ends = np.cumsum([len(message) for message in messages])
    starts = ends - [len(message) for message in messages]
    windows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(data, np.uint8), _HEAD.itemsize)
    heads = np.ascontiguousarray(windows[starts]).view(_HEAD)[:, 0]
    channel, sequence, log, publish = (heads[name].astype(np.int64) for name in _HEAD.names or ())
    return Batch(data, channel, sequence, log, publish, starts + _HEAD.itemsize, ends)


def is_being_written(path: Path) -> bool | None:
    """Return whether a recorder holds a journal, None where the system does not tell.

    The list of locks is only read: to try the lock would be in a recorder's way.
    """
    try:
        status = path.stat()
        with Path("/proc/locks").open(encoding="ascii", errors="replace") as stream:
            locks = stream.read()
    except OSError:
        return None
    file = f" {os.major(status.st_dev):02x}:{os.minor(status.st_dev):02x}:{status.st_ino} "
    return any("FLOCK" in line and file in line for line in locks.splitlines())
