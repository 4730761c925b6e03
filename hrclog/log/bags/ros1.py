"""Read a ROS 1 bag from front to end, closed or not, as what an MCAP file holds.

The format: http://wiki.ros.org/Bags/Format/2.0. The index is not needed, so that bags whose recorder was killed
(`.bag.active`) and bags that break off are read as far as they go. There are no checksums but those of
compressed chunks.
"""

from __future__ import annotations

import bz2
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import lz4.frame
from mcap.records import Channel, Schema

from hrclog.errors import LogReadError
from hrclog.log.limits import CHANNELS, CHUNK, RECORDS, UNPACKED, Budget, LimitError
from hrclog.log.mcap.contents import Contents, Wanted, batch_of
from hrclog.log.mcap.records import Problem
from hrclog.log.messages.definitions import ROS1, type_name
from hrclog.wording import counted

VERSION: Final = b"#ROSBAG V2.0\n"

_MESSAGE, _BAG_HEADER, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 5, 6, 7
_LZ4_FLAGS_AT: Final = 4  # behind the magic number
_SIZE: Final = struct.Struct("<I")
_TIME: Final = struct.Struct("<II")
_PAIR: Final = struct.Struct("<II")  # connection and count of messages, in the info of a chunk
_REINDEX: Final = "`rosbag reindex` closes it"

_Fields = dict[bytes, bytes]
_Listed = dict[int, int]
"""Messages of a chunk by connection, as the index counts them."""
_Row = tuple[int, int, bytes]
"""(channel, time in ns, message)."""


def read_ros1(path: Path, data: bytes, wanted: Wanted, budget: Budget, *, by_index: bool = False) -> Contents:
    """Read a ROS 1 bag; `problems` says what is damaged or missing.

    Args:
        path: the file.
        data: what it holds.
        wanted: says of a channel and its schema whether its messages are needed.
        budget: of the file.
        by_index: whether to pass over chunks that hold nothing wanted, as the index at the end says.

    Raises:
        LogReadError: it is of another version, or encrypted.
    """
    if not data.startswith(VERSION):
        first_line = data[:20].partition(b"\n")[0]
        raise LogReadError(path, f"a ROS 1 bag of another version ({first_line!r})", f"{VERSION.strip()!r}")
    reader = _Reader(data, wanted, budget)
    try:
        if by_index:
            reader.read_index()
        reader.read()
    except LimitError as error:
        reader.stop(error)
    if reader.encryptor:
        raise LogReadError(path, f"a ROS 1 bag encrypted by {reader.encryptor!r}", "one that is not", "decrypt it")
    return reader.contents


class _Reader:
    def __init__(self, data: bytes, wanted: Wanted, budget: Budget) -> None:
        self.contents = Contents(budget=budget)
        self.encryptor = b""
        self._data = data
        self._wanted = wanted
        self._wanted_ids: set[int] = set()
        self._counts: dict[int, int] = {}
        self._has_checksum = False
        self._skipped: dict[int, _Listed] = {}
        self._position = len(VERSION)
        self._loose: list[_Row] = []

    def read_index(self) -> None:
        """Take the connections of a closed bag from its end, and note which chunks hold nothing wanted."""
        head = next(_records(self._data, len(VERSION)), None)
        index_position = int.from_bytes(head[0].get(b"index_pos", b""), "little") if head else 0
        if not len(VERSION) < index_position < len(self._data):
            return
        chunks: dict[int, _Listed] = {}
        for fields, start, end in _records(self._data, index_position):
            if _code(fields) == _CONNECTION:
                self._declare(int.from_bytes(fields.get(b"conn", b"")[:4], "little"), fields, self._data[start:end])
            elif _code(fields) == _CHUNK_INFO:
                position = int.from_bytes(fields.get(b"chunk_pos", b""), "little")
                chunks[position] = dict(_PAIR.iter_unpack(self._data[start : end - (end - start) % _PAIR.size]))
        self._skipped = {
            position: counts for position, counts in chunks.items() if not self._wanted_ids.intersection(counts)
        }

    def read(self) -> None:
        contents = self.contents
        position, index_position = len(VERSION), 0
        for fields, start, end in _records(self._data, position):
            listed = self._skipped.get(position)
            self._position, position = position, end
            code = _code(fields)
            if code == _BAG_HEADER:
                index_position = int.from_bytes(fields.get(b"index_pos", b""), "little")
                self.encryptor = fields.get(b"encryptor", b"")
            elif code == _CHUNK and listed is not None:
                self._has_checksum |= _has_checksum(fields, self._data[start : start + _LZ4_FLAGS_AT + 1])
                for number, count in listed.items():
                    self._counts[number] = self._counts.get(number, 0) + count
            elif code == _CHUNK and end > start:  # the head of the chunk that was being written tells no length
                self._take_chunk(fields, start, end)
            else:
                self._take(self._data, fields, start, end, self._loose)
        self._add(self._loose)
        left = len(self._data) - position
        contents.finished = index_position > 0
        self._tell_counts()
        if not contents.finished:
            tail = f" and its last {counted(left, 'byte is', 'bytes are')} no whole record" if left else ""
            text = f"the ROS 1 bag was not closed: it has no index{tail}; {_REINDEX}"
            contents.problems.append(Problem("truncated", position, text))
        elif left:
            text = f"the ROS 1 bag breaks off: its last {counted(left, 'byte is', 'bytes are')} no whole record"
            contents.problems.append(Problem("truncated", position, f"{text}; {_REINDEX}"))

    def stop(self, error: LimitError) -> None:
        """Report that a limit is reached, and keep what was read."""
        self._add(self._loose)
        self.contents.finished = True  # what is behind the limit is not known
        self._tell_counts()
        n_left = len(self._data) - self._position
        text = f"{error}; {counted(n_left, 'byte')} from here on were not read"
        self.contents.problems.append(Problem("limit_reached", self._position, text, n_left))

    def _tell_counts(self) -> None:
        self.contents.counts = self._counts
        self.contents.unprotected = bool(self._counts) and not self._has_checksum

    def _take_chunk(self, chunk: _Fields, start: int, end: int) -> None:
        rows: list[_Row] = []
        try:
            content = _expand(chunk, self._data[start:end], self.contents.budget)
        except LimitError as error:
            self.contents.problems.append(Problem("limit_reached", start, f"{error}; a chunk was skipped", end - start))
            return
        except (ValueError, OSError, EOFError, RuntimeError, MemoryError) as error:
            text = f"a chunk of {counted(end - start, 'byte')} cannot be unpacked ({error}) and was skipped"
            self.contents.problems.append(Problem("corrupt_data", start, text))
            return
        self._has_checksum |= _has_checksum(chunk, self._data[start:end])
        position = 0
        for fields, first, last in _records(content, 0):
            position = last
            self.contents.budget.spend(RECORDS)
            self._take(content, fields, first, last, rows)
        if position < len(content):
            left = counted(len(content) - position, "byte of a chunk is", "bytes of a chunk are")
            self.contents.problems.append(Problem("corrupt_data", start, f"the last {left} no record"))
        self._add(rows)

    def _take(self, data: bytes, fields: _Fields, start: int, end: int, rows: list[_Row]) -> None:
        code, number = _code(fields), int.from_bytes(fields.get(b"conn", b"")[:4], "little")
        if code == _CONNECTION:
            self._declare(number, fields, data[start:end])
        elif code == _MESSAGE and len(fields.get(b"time", b"")) == _TIME.size:
            seconds, rest = _TIME.unpack(fields[b"time"])
            time_ns = seconds * 10**9 + rest
            self._counts[number] = self._counts.get(number, 0) + 1
            if number in self._wanted_ids:
                rows.append((number, time_ns, data[start:end]))

    def _declare(self, number: int, fields: _Fields, data: bytes) -> None:
        if number in self.contents.channels:
            return
        self.contents.budget.spend(CHANNELS)
        kind = _fields(data) or {}
        text = {name: kind.get(name, b"").decode(errors="replace") for name in (b"type", b"message_definition")}
        name, definition = type_name(text[b"type"]), text[b"message_definition"].encode()
        topic = fields.get(b"topic", b"").decode(errors="replace")
        schema = Schema(id=number, name=name, encoding="ros1msg", data=definition)
        channel = Channel(number, topic, ROS1, {}, number)
        self.contents.schemas[number], self.contents.channels[number] = schema, channel
        if self._wanted(channel, schema):
            self._wanted_ids.add(number)

    def _add(self, rows: list[_Row]) -> None:
        if rows:
            self.contents.batches.append(batch_of(*zip(*rows, strict=True)))


def _records(data: bytes, position: int) -> Iterator[tuple[_Fields, int, int]]:
    """Yield header fields, first byte and end of the content of each record, up to what is none."""
    while position + _SIZE.size <= len(data):
        (size,) = _SIZE.unpack_from(data, position)
        start = position + _SIZE.size + size + _SIZE.size
        if start > len(data):
            return
        fields = _fields(data[position + _SIZE.size : start - _SIZE.size])
        end = start + _SIZE.unpack_from(data, start - _SIZE.size)[0]
        if fields is None or b"op" not in fields or end > len(data):
            return
        yield fields, start, end
        position = end


def _fields(header: bytes) -> _Fields | None:
    """Return the fields of a record's header, None where it is none."""
    fields: _Fields = {}
    position = 0
    while position + _SIZE.size <= len(header):
        start = position + _SIZE.size
        position = start + _SIZE.unpack_from(header, position)[0]
        name, separator, value = header[start:position].partition(b"=")
        if not separator or position > len(header):
            return None
        fields[name] = value
    return fields if position == len(header) else None


def _code(fields: _Fields) -> int:
    return int.from_bytes(fields.get(b"op", b"")[:1], "little")


def _has_checksum(chunk: _Fields, content: bytes) -> bool:
    """Return whether the compression of a chunk has a checksum of what it holds: bz2 always has one."""
    name = chunk.get(b"compression", b"none")
    return name == b"bz2" or (
        name == b"lz4" and len(content) > _LZ4_FLAGS_AT and bool(content[_LZ4_FLAGS_AT] & 0b10100)
    )


def _expand(chunk: _Fields, content: bytes, budget: Budget) -> bytes:
    size = int.from_bytes(chunk.get(b"size", b""), "little")
    name = chunk.get(b"compression", b"none")
    if name == b"none":
        return content
    budget.check(CHUNK, size)
    budget.spend(UNPACKED, size)
    if name == b"bz2":
        unpacked = bz2.BZ2Decompressor().decompress(content, max_length=size + 1)
    elif name == b"lz4":
        unpacked = lz4.frame.LZ4FrameDecompressor().decompress(content, max_length=size + 1)
    else:
        raise ValueError(f"it is compressed with {name!r}, expected none, bz2 or lz4")
    if len(unpacked) != size:
        raise ValueError("it is not as long as it says")
    return bytes(unpacked)
