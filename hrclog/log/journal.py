"""The crash-safe journal that a run is recorded into: whatever `append` took survives the process.

A journal `NAME.mcap.partial` is an MCAP file without an end. Each message is a chunk of its own with its checksum,
handed to the operating system in a single write; `hrclog.log.recover` turns it into a finished log.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, Header, McapRecord, Metadata, Schema

from hrclog._version import __version__
from hrclog.errors import InvalidEventError, LogExistsError, LogWriteError
from hrclog.log import channels
from hrclog.log.channels import ChannelSpec
from hrclog.log.encode import Message
from hrclog.log.files import lock, sync_folder
from hrclog.log.records import MAGIC

LIBRARY: Final = f"hrclog {__version__}"
PARTIAL_SUFFIX: Final = ".partial"

_MESSAGE_HEAD: Final = struct.Struct("<BQHIQQ")
_CHUNK_HEAD: Final = struct.Struct("<BQQQQIIQ")
_FLAGS: Final = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | getattr(os, "O_BINARY", 0)
_MAX_CHANNELS: Final = 0xFFFF
_FIRST_REPEAT: Final = 1 << 14  # bytes


def journal_path(path: Path) -> Path:
    """Return the journal of a log to be."""
    return path.with_name(path.name + PARTIAL_SUFFIX)


class Journal:
    """An append-only file whose every message survives the process once `append` has returned.

    `size` counts the bytes that it holds.

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
        self._channels: dict[ChannelSpec, tuple[int, bytes]] = {}
        self._repeat_at = _FIRST_REPEAT
        self._fd = _create(path)
        self.size = 0
        self._write(MAGIC + _record(Header(channels.PROFILE, LIBRARY)))
        if fsync:
            sync_folder(path.parent)

    def append(self, *messages: Message) -> None:
        """Append messages in one write: all of them, or none.

        Raises:
            LogWriteError: the disk did not take them.
            InvalidEventError: a message cannot be put into the format.
        """
        n_declared = len(self._channels)
        repeated = self._repeated_declarations()
        try:
            self._write(repeated + b"".join(self._chunks(message) for message in messages))
        except BaseException:
            for spec in list(self._channels)[n_declared:]:  # their declarations were not written
                del self._channels[spec]
            raise

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Append a metadata record."""
        self._write(_record(Metadata(name=name, metadata=dict(values))))

    def close(self) -> None:
        """Close the file; it stays a journal until it is finished."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    def _chunks(self, message: Message) -> bytes:
        declaration = b"" if message.channel in self._channels else self._declare(message.channel)
        channel = self._channels[message.channel][0]
        times = message.log_time, message.publish_time
        try:
            head = _MESSAGE_HEAD.pack(Opcode.MESSAGE, 22 + len(message.data), channel, message.sequence, *times)
        except struct.error as error:
            text = f"{self.path}: found times {times}, expected ns since the epoch in 64 bits"
            raise InvalidEventError(text) from error
        return declaration + _chunk(head + message.data, message.log_time)

    def _declare(self, spec: ChannelSpec) -> bytes:
        """Return the declaration of a channel, twice: without it all the channel's messages would be lost."""
        if len(self._channels) >= _MAX_CHANNELS:
            raise LogWriteError(self.path, f"has {_MAX_CHANNELS} channels already", "use fewer names of signals")
        schema_id = self._schemas.setdefault(spec.type_name, len(self._schemas) + 1)
        channel_id = len(self._channels) + 1
        schema = Schema(schema_id, spec.definition, channels.SCHEMA_ENCODING, spec.type_name)
        channel = Channel(channel_id, spec.topic, channels.CDR, dict(spec.metadata), schema_id)
        declaration = _chunk(_record(schema) + _record(channel), 0)
        self._channels[spec] = channel_id, declaration
        return declaration * 2

    def _repeated_declarations(self) -> bytes:
        """Return all declarations again whenever the file has doubled in size, so that they outlive a larger hole."""
        if self.size < self._repeat_at:
            return b""
        self._repeat_at = 2 * self.size
        return b"".join(declaration for _, declaration in self._channels.values())

    def _write(self, data: bytes) -> None:
        try:
            self._write_all(data)
        except BaseException as error:
            with suppress(OSError):  # remove a partly written message
                os.ftruncate(self._fd, self.size)
            if not isinstance(error, OSError):
                raise
            remedy = "free space or record elsewhere; what was acknowledged before is in the file"
            raise LogWriteError(self.path, f"an event could not be written ({error.strerror})", remedy) from error
        self.size += len(data)

    def _write_all(self, data: bytes) -> None:
        view = memoryview(data)
        while view:
            view = view[os.write(self._fd, view) :]
        if self._fsync:
            os.fsync(self._fd)


def _create(path: Path) -> int:
    try:
        fd = os.open(path, _FLAGS, 0o666)
    except FileExistsError as error:
        raise LogExistsError(path, "close it with `hrclog recover` or choose another name") from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise LogWriteError(path, f"cannot be created ({reason})", "choose a folder that can be written") from error
    lock(fd, wait=True)
    return fd


def _record(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]  # mcap leaves it untyped


def _chunk(records: bytes, log_time: int) -> bytes:
    length = _CHUNK_HEAD.size - 9 + len(records)
    crc = zlib.crc32(records)
    return _CHUNK_HEAD.pack(Opcode.CHUNK, length, log_time, log_time, len(records), crc, 0, len(records)) + records
