"""Walk the records of an MCAP file, whole or damaged.

The format: https://mcap.dev/spec. Small records are parsed by the `mcap` package; the walk itself is ours because it
must survive torn and flipped bytes and say where they are.
"""

from __future__ import annotations

import io
import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode

from hrclog.log.limits import CHECKED, CHUNK, UNPACKED, Budget, LimitError
from hrclog.log.mcap.attachments import attachment_at
from hrclog.wording import counted

MAGIC: Final = b"\x89MCAP0\r\n"
PREFIX: Final = struct.Struct("<BQ")
"""Opcode and content length, which begin every record."""

FIRST_OF_APPLICATIONS: Final = 0x80
"""The first opcode that MCAP leaves to applications."""

_CHUNK: Final = struct.Struct("<QQQI")  # start time, end time, uncompressed size, CRC
_OPCODES: Final = frozenset(map(int, Opcode))
_HOLDING_ANYTHING: Final = (Opcode.MESSAGE, Opcode.SCHEMA)
_IN_CHUNKS: Final = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
_STRIDE: Final = 64  # of the records of a chain, every so manyth is remembered
_LIKELY_CHUNK: Final = re.compile(rb"\x06[\x00-\xff]{4}\x00{4}", re.DOTALL)  # opcode, length below 4 GiB

Record = tuple[int, int, int, int]
"""(opcode, offset of the record, first byte of its content, one past its last byte)."""

Span = tuple[bytes, int, int]
"""(buffer, first byte, one past the last byte)."""


@dataclass(frozen=True, slots=True)
class Problem:
    """What could not be read, or is missing.

    Attributes:
        code: of the diagnostic.
        offset: where, bytes from the start of the file.
        message: what.
        n_bytes: how many bytes were not read, 0 if it is not known.
        n_messages: how many messages are missing, 0 if it is not known.
    """

    code: str
    offset: int
    message: str
    n_bytes: int = 0
    n_messages: int = 0


class Walk:
    """The records of a file's data and summary sections in order; chunks are not expanded.

    Where bytes are no record, or the reader of a record distrusts it, the walk goes on at the next chunk whose checksum
    is right.

    Args:
        data: the file.
        problems: takes what could not be read.
        begin: where to start; 0 means behind the magic bytes.
        budget: of the file; without one it is that of a file of these bytes.
    """

    def __init__(self, data: bytes, problems: list[Problem], begin: int = 0, budget: Budget | None = None) -> None:
        self._data = data
        self._problems = problems
        self._end = len(data)
        self._budget = budget or Budget(len(data))
        self._chunked = False
        self._led_to = 0  # from here to there records follow each other
        self._leads: dict[int, bool] = {}  # whether the records from here on do, to a chunk or the end
        self._position = begin or (len(MAGIC) if data.startswith(MAGIC) else 0)

    def __iter__(self) -> Iterator[Record]:
        while self._position < self._end:
            if self._data.startswith(MAGIC, self._position) and self._position + len(MAGIC) == self._end:
                return
            record = record_at(self._data, self._position, self._end)
            try:
                hidden = self._behind_gap() if record is None else self._hidden_chunk(record)
            except LimitError as error:
                self.stop(self._position, error)
                return
            if record is None:
                self._skip_gap(hidden)
                continue
            if hidden is not None:
                self._problems.append(_gap(self._position, hidden))
                self._go_on(hidden)
                continue
            self._position = record[3]
            yield record

    def distrust(self, record: Record, reason: str) -> None:
        """Report a record that was just yielded as damaged; its length may be wrong, so look for chunks inside it."""
        try:
            inside = self._next_chunk(record[1] + 1, record[3])
        except LimitError as error:
            self.stop(record[1], error)
            return
        self._go_on(record[3] if inside is None else inside)
        self._problems.append(Problem("corrupt_data", record[1], reason, self._position - record[1]))

    def refuse(self, record: Record, error: LimitError) -> None:
        """Report that a record that was just yielded asks for too much, and go on behind it, or nowhere."""
        if error.limit.ends_reading:
            self.stop(record[1], error)
        else:
            self._problems.append(Problem("limit_reached", record[1], str(error), record[3] - record[1]))

    def stop(self, offset: int, error: LimitError) -> None:
        """Report that a limit is reached, and end the walk."""
        n_left = self._end - offset
        text = f"{error}; {counted(n_left, 'byte')} from here on were not read"
        self._problems.append(Problem("limit_reached", offset, text, n_left))
        self._position = self._end

    def _next_chunk(self, begin: int, before: int) -> int | None:
        return next_chunk(self._data, begin, before, self._end, self._budget)

    def _behind_gap(self) -> int | None:
        return self._next_chunk(self._position + 1, self._end)

    def _skip_gap(self, following: int | None) -> None:
        if following is None:
            n_left = self._end - self._position
            text = f"the file ends inside a record; its last {counted(n_left, 'byte was', 'bytes were')} ignored"
            self._problems.append(Problem("truncated", self._position, text, n_left))
        else:
            self._problems.append(_gap(self._position, following))
        self._go_on(self._end if following is None else following)

    def _go_on(self, position: int) -> None:
        """Go on elsewhere than behind a record."""
        self._position, self._led_to = position, 0

    def _hidden_chunk(self, record: Record) -> int | None:
        """Return where to go on behind a record that hides a chunk, as its opcode or length is damaged; None if not."""
        opcode, offset, start, end = record
        if opcode == Opcode.CHUNK:
            self._chunked = True
            body_end = _body_end(self._data, record)
            return None if body_end >= end else self._next_chunk(body_end, end)
        if opcode == Opcode.MESSAGE and not self._chunked:  # messages may hold anything
            return None
        if opcode == Opcode.ATTACHMENT and (own_end := self._attachment_end(start, end)):
            return self._next_chunk(own_end, end)
        if _has_valid_checksum(self._data, record, self._budget):  # a chunk under another opcode
            return _body_end(self._data, record)
        inside = self._next_chunk(offset + 1, end)
        may_hold_anything = opcode not in _OPCODES or opcode in _HOLDING_ANYTHING
        if inside is not None and may_hold_anything and self._leads_on(end):
            return None
        return inside

    def _attachment_end(self, start: int, end: int) -> int | None:
        """Return where an attachment ends, so that chunks before that are its own; None if its sizes are wrong."""
        try:
            attachment = attachment_at(self._data, start, end)
        except ValueError:
            return None
        return attachment.end + 4 if attachment.is_intact or self._leads_on(end) else None

    def _leads_on(self, position: int) -> bool:
        """Return whether records follow each other from a position to a valid chunk, or to the end of the file."""
        if position <= self._led_to:
            return True
        chain: list[int] = []
        while (leads := self._leads.get(position)) is None:
            chain.append(position)
            record = record_at(self._data, position, self._end)
            if record is None:
                tail = self._data[position : min(position + len(MAGIC) + 1, self._end)]
                leads = position >= self._end or tail == MAGIC
                break
            if record[0] == Opcode.CHUNK and _has_valid_checksum(self._data, record, self._budget):
                leads = True
                break
            position = record[3]
        # chains that have met go on together: the next one meets a remembered record soon
        for remembered in (*chain[::_STRIDE], *chain[-1:]):
            self._leads[remembered] = leads
        if leads:
            self._led_to = position
        return leads


def record_at(data: bytes, position: int, end: int) -> Record | None:
    """Return the record that begins at a position, None if it is none or does not fit."""
    start = position + PREFIX.size
    if start > end:
        return None
    opcode, length = PREFIX.unpack_from(data, position)
    if opcode == 0 or start + length > end:
        return None
    return opcode, position, start, start + length


def next_chunk(data: bytes, begin: int, before: int, end: int, budget: Budget | None = None) -> int | None:
    """Return where the next chunk with a valid, non-zero checksum begins: in [begin, before), and it ends by `end`.

    Args:
        data: the file.
        begin: first byte at which it may begin.
        before: one past the last such byte.
        end: one past the last byte at which it may end.
        budget: of the file.

    Raises:
        LimitError: too many bytes look like chunks and are none.
    """
    budget = budget or Budget(len(data))
    while match := _LIKELY_CHUNK.search(data, begin, min(before + PREFIX.size, end)):
        if match.start() >= before:
            return None
        record = record_at(data, match.start(), end)
        if record is not None and _has_valid_checksum(data, record, budget):
            return match.start()
        begin = match.start() + 1
    return None


def expand(data: bytes, record: Record, budget: Budget | None = None) -> Span:
    """Return where the records inside a chunk lie: in the file itself, or in a new buffer if they were compressed.

    Args:
        data: the file.
        record: the chunk.
        budget: of the file; what the chunk unpacks to is taken off.

    Raises:
        LimitError: the chunk unpacks to more than is left of the budget.
        ValueError: the chunk is damaged or its checksum is wrong; says how.
    """
    _, _, start, end = record
    if end - start < _CHUNK.size + 12:
        raise ValueError("a chunk is too short for its header")
    _, _, size, crc = _CHUNK.unpack_from(data, start)
    name_end = start + 32 + int.from_bytes(data[start + 28 : start + 32], "little")
    body_end = _body_end(data, record)
    if body_end > end:
        raise ValueError("a chunk's sizes do not fit into it")
    name = bytes(data[start + 32 : name_end])
    if name:
        budget = budget or Budget(len(data))
        budget.check(CHUNK, size)
        budget.spend(UNPACKED, size)
    span = _decompress(data, name, name_end + 8, body_end, size)
    if span[2] - span[1] != size:
        raise ValueError("a chunk is not as long as it says")
    if not crc and body_end < end:
        raise ValueError("a chunk's sizes do not fill its record, and it has no checksum")
    if crc and zlib.crc32(memoryview(span[0])[span[1] : span[2]]) != crc:
        raise ValueError("a chunk fails its checksum")
    return span


def _body_end(data: bytes, chunk: Record) -> int:
    """Return where a chunk's records end; bytes behind that are of no known use."""
    start, end = chunk[2:]
    if end - start < _CHUNK.size + 12:
        return end
    name_end = start + 32 + int.from_bytes(data[start + 28 : start + 32], "little")
    return name_end + 8 + int.from_bytes(data[name_end : name_end + 8], "little")


def parse(record_class: Any, data: bytes, record: Record) -> Any:  # noqa: ANN401 - mcap's record classes share no type
    """Parse a small record with its class of `mcap.records`.

    Raises:
        ValueError: the record is damaged.
    """
    try:
        return record_class.read(_ExactStream(io.BytesIO(data[record[2] : record[3]])))
    except Exception as error:
        raise ValueError(f"a {record_class.__name__} record is damaged") from error


class _ExactStream(ReadDataStream):
    """A stream that raises if it has fewer bytes than requested."""

    def read(self, length: int) -> bytes:
        data = super().read(length)
        if len(data) != length:
            raise ValueError("the record is too short")
        return data


def _has_valid_checksum(data: bytes, record: Record, budget: Budget) -> bool:
    """Return whether a record is a chunk with a valid checksum; bytes that are none are taken off the budget."""
    _, _, start, end = record
    if end - start < _CHUNK.size + 12 or not any(data[start + 24 : start + 28]):
        return False
    size = _CHUNK.unpack_from(data, start)[2]
    name_size = int.from_bytes(data[start + 28 : start + 32], "little")
    begin = start + 40 + name_size
    if _body_end(data, record) > end or (name_size and size > min(budget.left(UNPACKED), budget.most(CHUNK))):
        return False
    if not name_size and not _may_hold(data, begin, _body_end(data, record), size):
        return False
    try:
        expand(data, record, Budget(None))
    except ValueError:
        budget.spend(CHECKED, max(end - start, size if name_size else 0))
        return False
    return True


def _may_hold(data: bytes, begin: int, end: int, size: int) -> bool:
    """Return whether the bytes of a chunk without compression begin with a record of those that chunks hold."""
    first = record_at(data, begin, end)
    if end - begin != size or (first is None and size):
        return False
    return first is None or first[0] in _IN_CHUNKS or first[0] not in _OPCODES


def _decompress(data: bytes, name: bytes, start: int, end: int, size: int) -> Span:
    if not name:
        return data, start, end
    try:
        if name == b"zstd":
            # the frame's own size would overrule the limit
            if zstandard.frame_content_size(data[start:end]) > size:
                raise ValueError("a chunk is not as long as it says")
            records = zstandard.ZstdDecompressor().decompress(data[start:end], max_output_size=size)
            return records, 0, len(records)
        if name == b"lz4":
            records = lz4.frame.LZ4FrameDecompressor().decompress(data[start:end], max_length=size + 1)
            return records, 0, len(records)
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise ValueError(f"a chunk cannot be decompressed ({error})") from error
    raise ValueError(f"a chunk is compressed with {name.decode(errors='replace')!r}, expected zstd, lz4 or nothing")


def _gap(position: int, following: int) -> Problem:
    text = counted(
        following - position,
        "byte is not a valid record and was skipped",
        "bytes are not valid records and were skipped",
    )
    return Problem("corrupt_data", position, text, following - position)
