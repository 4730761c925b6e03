"""The crash-safe journal that a run is recorded into: whatever `append` took survives the process.

A journal `NAME.mcap.partial` is an MCAP file without an end. Each message is a chunk of its own with its checksum and
its link to the one before (`hrclog.log.mcap.chain`), handed to the operating system in a single write;
`hrclog.log.recover` turns it into a finished log.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Channel, Header, Metadata, Schema

from hrclog._version import __version__
from hrclog.errors import InvalidEventError, LogExistsError, LogWriteError
from hrclog.files import is_at, lock, sync_folder
from hrclog.log.files.system import exists
from hrclog.log.mcap.chain import link, record_bytes
from hrclog.log.mcap.records import MAGIC
from hrclog.log.messages import channels
from hrclog.log.messages.channels import ChannelSpec
from hrclog.log.messages.encode import Message

LIBRARY: Final = f"hrclog {__version__}"
PARTIAL_SUFFIX: Final = ".partial"

_MESSAGE, _CHUNK = int(Opcode.MESSAGE), int(Opcode.CHUNK)  # plain numbers are packed faster
_MESSAGE_HEAD: Final = struct.Struct("<BQHIQQ")
_CHUNK_HEAD: Final = struct.Struct("<BQQQQIIQ")
_FLAGS: Final = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | getattr(os, "O_BINARY", 0)
_MAX_CHANNELS: Final = 0xFFFF
_FIRST_REPEAT: Final = 1 << 14  # bytes


@dataclass(frozen=True, slots=True)
class _Declaration:
    """A channel that the journal declares: its number, the chunk that says so, and that chunk's checksum."""

    channel: int
    chunk: bytes
    checksum: int


class _End(NamedTuple):
    """Where a journal ends: its bytes and messages so far, and the checksum of the last message's chunk."""

    size: int = 0
    n_messages: int = 0
    checksum: int = 0


def journal_path(path: Path) -> Path:
    """Return the journal of a log to be."""
    return path.with_name(path.name + PARTIAL_SUFFIX)


class Journal:
    """An append-only file whose every message survives the process once `append` has returned.

    Args:
        path: the journal, `NAME.mcap.partial`.
        fsync: also survive a crash of the operating system, at 1-4 ms per message.

    Raises:
        LogExistsError: the journal exists.
        LogWriteError: it cannot be created; nothing is left behind.
    """

    def __init__(self, path: Path, *, fsync: bool = False) -> None:
        self.path = path
        self._fsync = fsync
        self._schemas: dict[str, int] = {}
        self._channels: dict[ChannelSpec, _Declaration] = {}
        self._repeat_at = _FIRST_REPEAT
        self._fd = _create(path)
        self._end = _End()
        try:
            self._write(MAGIC + record_bytes(Header(channels.PROFILE, LIBRARY)))
            if fsync:
                sync_folder(path.parent)
        except BaseException:
            self.close()
            with suppress(OSError):
                path.unlink()
            raise

    @property
    def size(self) -> int:
        """Return how many bytes the journal holds."""
        return self._end.size

    def append(self, *messages: Message) -> None:
        """Append messages in one write: all of them, or none.

        Raises:
            LogWriteError: the disk did not take them.
            InvalidEventError: a message cannot be put into the format.
        """
        n_declared = len(self._channels)
        chunks = [self._repeated_declarations()]
        number, checksum = self._end.n_messages, self._end.checksum
        try:
            for message in messages:
                declaration = self._channels.get(message.channel) or self._declare(message.channel, chunks)
                tail = link(number, checksum, declaration.checksum)
                records = b"".join((self._head(message, declaration.channel), message.data, tail))
                number, checksum = number + 1, zlib.crc32(records)
                chunks += _chunk_head(len(records), checksum, message.log_time), records
            self._write(b"".join(chunks), n_messages=number, checksum=checksum)
        except BaseException:
            for spec in list(self._channels)[n_declared:]:  # their declarations were not written
                del self._channels[spec]
            raise

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Append a metadata record."""
        self._write(record_bytes(Metadata(name=name, metadata=dict(values))))

    def close(self) -> None:
        """Close the file; it stays a journal until it is finished."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    def _head(self, message: Message, channel: int) -> bytes:
        times = message.log_time, message.publish_time
        try:
            return _MESSAGE_HEAD.pack(_MESSAGE, 22 + len(message.data), channel, message.sequence, *times)
        except struct.error as error:
            text = f"{self.path}: found times {times}, expected ns since the epoch in 64 bits"
            raise InvalidEventError(text) from error

    def _declare(self, spec: ChannelSpec, chunks: list[bytes]) -> _Declaration:
        """Declare a channel in the chunks to be written, twice: without it all the channel's messages would be lost."""
        if len(self._channels) >= _MAX_CHANNELS:
            text = f"{self.path}: has {_MAX_CHANNELS} channels already, as many as fit; use fewer names of signals"
            raise InvalidEventError(text)
        schema_id = self._schemas.setdefault(spec.type_name, len(self._schemas) + 1)
        channel_id = len(self._channels) + 1
        schema = Schema(schema_id, spec.definition, channels.SCHEMA_ENCODING, spec.type_name)
        channel = Channel(channel_id, spec.topic, channels.CDR, dict(spec.metadata), schema_id)
        records = record_bytes(schema) + record_bytes(channel)
        declaration = _Declaration(channel_id, _chunk(records, 0), zlib.crc32(records))
        self._channels[spec] = declaration
        chunks.append(declaration.chunk * 2)
        return declaration

    def _repeated_declarations(self) -> bytes:
        """Return all declarations again whenever the file has doubled in size, so that they outlive a larger hole."""
        if self._end.size < self._repeat_at:
            return b""
        self._repeat_at = 2 * self._end.size
        return b"".join(declaration.chunk for declaration in self._channels.values())

    def _write(self, data: bytes, n_messages: int | None = None, checksum: int = 0) -> None:
        """Write bytes, all or none; `n_messages` and `checksum` are the end of the chain behind them, if it grew."""
        before = self._end
        size = before.size + len(data)
        try:
            self._write_all(data)
            # the last step: an interrupt before it undoes the write
            self._end = before._replace(size=size) if n_messages is None else _End(size, n_messages, checksum)
        except BaseException as error:
            with suppress(OSError):  # remove a partly written message
                os.ftruncate(self._fd, before.size)
            if not isinstance(error, OSError):
                raise
            remedy = "free space or record elsewhere; what was acknowledged before is in the file"
            raise LogWriteError(self.path, f"an event could not be written ({error.strerror})", remedy) from error

    def _write_all(self, data: bytes) -> None:
        view = memoryview(data)
        while view:
            view = view[os.write(self._fd, view) :]
        if self._fsync:
            os.fsync(self._fd)


def _create(path: Path) -> int:
    fd = _create_locked(path)
    log = path.with_name(path.name.removesuffix(PARTIAL_SUFFIX))
    if log != path and exists(log):  # another recorder has finished it since this one looked for a free name
        path.unlink()
        os.close(fd)
        raise LogExistsError(log, "another recorder has written it; choose another name, or resume again")
    return fd


def _create_locked(path: Path) -> int:
    while True:
        try:
            fd = os.open(path, _FLAGS, 0o666)
        except FileExistsError as error:
            raise LogExistsError(path, "close it with `hrclog recover` or choose another name") from error
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise LogWriteError(path, f"cannot be created ({reason})", "choose a folder that can be written") from error
        lock(fd, wait=True)
        if is_at(fd, path):
            return fd
        os.close(fd)  # a process that resumes the run took the empty journal for an abandoned one, and removed it


def _chunk_head(size: int, checksum: int, log_time: int) -> bytes:
    return _CHUNK_HEAD.pack(_CHUNK, _CHUNK_HEAD.size - 9 + size, log_time, log_time, size, checksum, 0, size)


def _chunk(records: bytes, log_time: int) -> bytes:
    return _chunk_head(len(records), zlib.crc32(records), log_time) + records
