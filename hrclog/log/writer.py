"""Write event logs: a crash-safe journal while a run goes on, a finished indexed file at its end.

A journal `NAME.mcap.partial` holds one uncompressed chunk with its checksum per message, each handed to the operating
system in a single write, so what was acknowledged survives the process. The finished file is chunked, zstd, indexed.
"""

from __future__ import annotations

import os
import struct
import time
import zlib
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Final

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, Header, Metadata, Schema
from mcap.writer import Writer as McapWriter

from hrclog._version import __version__
from hrclog.errors import LogExistsError, LogWriteError
from hrclog.events import Event, RunStarted, TaskEnded, TaskStarted, check_row, to_row
from hrclog.log import channels
from hrclog.log.channels import ChannelSpec
from hrclog.log.message import encode_row
from hrclog.log.records import MAGIC

try:
    import fcntl
except ImportError:  # not on Windows, where two recorders of one file exclude each other by its creation alone
    fcntl = None  # type: ignore[assignment]

LIBRARY: Final = f"hrclog {__version__}"
RUN_METADATA: Final = "hrclog.run"
PARTIAL_SUFFIX: Final = ".partial"

_CHUNK_SIZE: Final = 1 << 20
_MESSAGE_HEAD: Final = struct.Struct("<BQHIQQ")
_CHUNK_HEAD: Final = struct.Struct("<BQQQQIIQ")


@dataclass(frozen=True, slots=True)
class FloatSignal:
    """One sample of a scalar signal."""

    run_id: str
    name: str
    time_ns: int
    value: float


@dataclass(frozen=True, slots=True)
class JointSignal:
    """One sample of an agent's joints, rad or m."""

    run_id: str
    agent: str
    time_ns: int
    names: tuple[str, ...]
    positions: tuple[float, ...]


Signal = FloatSignal | JointSignal


@dataclass(frozen=True, slots=True)
class Message:
    """One encoded message of a channel."""

    channel: ChannelSpec
    log_time: int
    publish_time: int
    data: bytes
    sequence: int = 0


class Lanes:
    """Which task each agent is at, as messages for the lanes that log viewers draw."""

    def __init__(self) -> None:
        self._active: dict[str, dict[str, str]] = {}

    def after(self, event: Event, log_time: int) -> list[Message]:
        """Return the lane messages that an event causes."""
        if not isinstance(event, TaskStarted | TaskEnded):
            return []
        active = self._active.setdefault(event.agent, {})
        if isinstance(event, TaskStarted):
            active[event.execution_id] = event.task
        elif active.pop(event.execution_id, None) is None:
            return []
        label = next(reversed(active.values()), "")
        lane = channels.lane(event.agent)
        return [Message(lane, log_time, event.time_ns, channels.encode_string(label))]


def event_message(event: Event, log_time: int) -> Message:
    """Return an event as a message.

    Raises:
        InvalidEventError: a field is not of the form the vocabulary asks for.
    """
    row = to_row(event)
    check_row(row)
    return Message(channels.EVENTS, max(log_time, 0), max(event.time_ns, 0), encode_row(row), event.seq & 0xFFFFFFFF)


def signal_message(signal: Signal, log_time: int) -> Message:
    """Return a signal's sample as a message."""
    if isinstance(signal, FloatSignal):
        channel, data = channels.float_signal(signal.name, signal.run_id), channels.encode_float(signal.value)
    else:
        channel = channels.joint_states(signal.agent, signal.run_id)
        data = channels.encode_joints(signal.time_ns, signal.names, signal.positions)
    return Message(channel, log_time, signal.time_ns, data)


def run_metadata(event: RunStarted) -> dict[str, str]:
    """Return the run facts that go into the log's metadata."""
    return {"run_id": event.run_id, "name": event.name, "segment": str(event.segment), "agents": "\n".join(event.agents)}


class Journal:
    """An append-only file whose every message survives the process once `append` has returned.

    Args:
        path: the journal, `NAME.mcap.partial`.
        fsync: also survive a crash of the operating system, at 1-4 ms per message.

    Raises:
        LogExistsError: the journal exists.
        LogWriteError: it cannot be created.
    """

    def __init__(self, path: Path, *, fsync: bool = False) -> None:
        self.path = path
        self._fsync = fsync
        self._schemas: dict[str, int] = {}
        self._channels: dict[ChannelSpec, int] = {}
        try:
            self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | getattr(os, "O_BINARY", 0), 0o666)
        except FileExistsError as error:
            raise LogExistsError(path, "close it with `hrclog recover` or choose another name") from error
        except OSError as error:
            raise LogWriteError(path, f"cannot be created ({error.strerror})", "choose a folder that can be written") from error
        if fcntl is not None:
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        builder = RecordBuilder()
        Header(channels.PROFILE, LIBRARY).write(builder)
        self._write(MAGIC + builder.end())
        if fsync:
            _sync_folder(path.parent)

    def append(self, *messages: Message) -> None:
        """Append messages in one write.

        Raises:
            LogWriteError: the disk did not take them.
        """
        parts: list[bytes] = []
        for message in messages:
            channel = self._channels.get(message.channel)
            if channel is None:
                channel, declaration = self._declare(message.channel)
                parts.append(_chunk(declaration, 0))
            head = _MESSAGE_HEAD.pack(
                Opcode.MESSAGE, 22 + len(message.data), channel, message.sequence, message.log_time, message.publish_time
            )
            parts.append(_chunk(head + message.data, message.log_time))
        self._write(b"".join(parts))

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Append a metadata record."""
        builder = RecordBuilder()
        Metadata(name=name, metadata=dict(values)).write(builder)
        self._write(builder.end())

    def close(self) -> None:
        """Close the file; it stays a journal until it is finished."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    def _declare(self, spec: ChannelSpec) -> tuple[int, bytes]:
        builder = RecordBuilder()
        if spec.type_name not in self._schemas:
            self._schemas[spec.type_name] = len(self._schemas) + 1
            schema = Schema(self._schemas[spec.type_name], spec.definition, channels.SCHEMA_ENCODING, spec.type_name)
            schema.write(builder)
        channel = self._channels[spec] = len(self._channels) + 1
        Channel(channel, spec.topic, channels.CDR, dict(spec.metadata), self._schemas[spec.type_name]).write(builder)
        return channel, builder.end()

    def _write(self, data: bytes) -> None:
        try:
            view = memoryview(data)
            while view:
                view = view[os.write(self._fd, view) :]
            if self._fsync:
                os.fsync(self._fd)
        except OSError as error:
            remedy = "free space or record elsewhere; what was acknowledged before is in the file"
            raise LogWriteError(self.path, f"an event could not be written ({error.strerror})", remedy) from error


class FinishedWriter:
    """Collect messages of a finished log; they appear at `path` in one step, when all is written.

    Args:
        stream: where the bytes go.
    """

    def __init__(self, stream: IO[bytes]) -> None:
        self._writer = McapWriter(stream, chunk_size=_CHUNK_SIZE)
        self._writer.start(profile=channels.PROFILE, library=LIBRARY)
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._channels: dict[object, int] = {}

    def add(self, message: Message) -> None:
        """Add a message."""
        channel = self._channels.get(message.channel)
        if channel is None:
            spec = message.channel
            schema = self.schema(spec.type_name, channels.SCHEMA_ENCODING, spec.definition)
            channel = self.channel(message.channel, spec.topic, channels.CDR, schema, spec.metadata)
        self.add_raw(channel, message.log_time, message.publish_time, message.sequence, message.data)

    def schema(self, name: str, encoding: str, data: bytes) -> int:
        """Return the id of a schema, registering it at its first use."""
        key = (name, encoding, data)
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(name, encoding, data)
        return self._schemas[key]

    def channel(self, key: object, topic: str, encoding: str, schema: int, metadata: Mapping[str, str]) -> int:
        """Return the id of a channel, registering it at its first use."""
        if key not in self._channels:
            self._channels[key] = self._writer.register_channel(topic, encoding, schema, dict(metadata))
        return self._channels[key]

    def add_raw(self, channel: int, log_time: int, publish_time: int, sequence: int, data: bytes) -> None:
        """Add an encoded message of a registered channel."""
        self._writer.add_message(channel, log_time, data, publish_time, sequence)

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Add a metadata record."""
        self._writer.add_metadata(name, dict(values))

    def finish(self) -> None:
        """Write indexes and summary."""
        self._writer.finish()


def write_log(path: Path, events: Iterable[Event], signals: Iterable[Signal] = ()) -> None:
    """Write a finished log in one step: it is there whole, or not at all.

    Args:
        path: the log, `NAME.mcap`.
        events: in order; their `seq` is set to 0, 1, … and their `log_time` to when they happened.
        signals: samples in order of time.

    Raises:
        LogExistsError: the log exists.
        LogWriteError: it cannot be written.
        InvalidEventError: an event is not of the form the vocabulary asks for.
    """
    if path.exists():
        raise LogExistsError(path, "choose another name")
    lanes, facts = Lanes(), []

    def fill(writer: FinishedWriter) -> None:
        lane_messages: list[Message] = []
        for seq, event in enumerate(events):
            numbered = event if event.seq == seq else replace(event, seq=seq)
            writer.add(event_message(numbered, numbered.time_ns))
            lane_messages += lanes.after(numbered, numbered.time_ns)
            if isinstance(numbered, RunStarted):
                facts.append(numbered)
        # lanes and signals follow the events, so that a reader of events can skip their chunks
        for message in lane_messages:
            writer.add(message)
        for signal in signals:
            writer.add(signal_message(signal, signal.time_ns))
        for fact in facts:
            writer.metadata(RUN_METADATA, run_metadata(fact))

    write_atomically(path, fill)


def write_atomically(path: Path, fill: Callable[[FinishedWriter], None]) -> None:
    """Let `fill` write a finished log to a hidden file, sync it, and rename it to `path`.

    Raises:
        LogWriteError: the file cannot be written.
    """
    temporary = path.with_name(f".{path.name.removesuffix('.mcap')}.{os.getpid()}.{time.monotonic_ns()}.tmp")
    try:
        with temporary.open("xb") as stream:
            writer = FinishedWriter(stream)
            fill(writer)
            writer.finish()
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(path)
        _sync_folder(path.parent)
    except OSError as error:
        raise LogWriteError(path, f"cannot be written ({error.strerror})", "choose a folder that can be written") from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def _chunk(records: bytes, log_time: int) -> bytes:
    length = _CHUNK_HEAD.size - 9 + len(records)
    head = _CHUNK_HEAD.pack(
        Opcode.CHUNK, length, log_time, log_time, len(records), zlib.crc32(records), 0, len(records)
    )
    return head + records


def _sync_folder(folder: Path) -> None:
    if os.name != "posix":
        return
    fd = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
