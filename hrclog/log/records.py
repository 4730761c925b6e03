"""Walk the records of an MCAP file, whole or damaged, and collect its messages as arrays.

The format: https://mcap.dev/spec. Small records are parsed by the `mcap` package; the walk itself is ours because it
must survive torn and flipped bytes, say where they are, and hand messages on without one object each.
"""

from __future__ import annotations

import io
import re
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Header, Metadata, Schema, Statistics

from hrclog.log.message import IntArray

MAGIC: Final = b"\x89MCAP0\r\n"

_PREFIX: Final = struct.Struct("<BQ")  # opcode, content length
_CHUNK: Final = struct.Struct("<QQQI")  # start time, end time, uncompressed size, CRC
_MESSAGE: Final = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_MESSAGE_DTYPE: Final = np.dtype(
    [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")]
)
_FOOTER_SIZE: Final = _PREFIX.size + 20 + len(MAGIC)
_MAX_CHUNK: Final = 1 << 31
_LIKELY_CHUNK: Final = re.compile(rb"(?=\x06[\x00-\xff]{4}\x00{4})", re.DOTALL)

Record = tuple[int, int, int, int]
"""(opcode, offset of the record, first byte of its content, one past its last byte)."""

Wanted = Callable[[Channel, Schema | None], bool]

Span = tuple[bytes, int, int]
"""(buffer, first byte, one past the last byte)."""


@dataclass(frozen=True, slots=True)
class Problem:
    """Bytes that could not be used."""

    code: str
    offset: int
    message: str


@dataclass(frozen=True, slots=True)
class Batch:
    """Messages that lie in one buffer, in the order in which they were written; arrays have shape (n,)."""

    data: bytes
    channel: IntArray
    sequence: IntArray
    log_time: IntArray
    publish_time: IntArray
    start: IntArray
    end: IntArray


@dataclass(slots=True)
class Contents:
    """What a file holds."""

    header: Header | None = None
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    metadata: list[Metadata] = field(default_factory=list)
    batches: list[Batch] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)
    finished: bool = False


def walk(data: bytes, problems: list[Problem], begin: int = 0, end: int | None = None) -> Iterator[Record]:
    """Yield the records of a file's data and summary sections in order; chunks are not expanded.

    Args:
        data: the file.
        problems: takes what could not be read; the walk goes on behind it where a chunk with a valid checksum follows.
        begin: where to start; 0 expects the magic bytes first.
        end: where to stop.
    """
    end = len(data) if end is None else end
    position = begin or len(MAGIC)
    while position < end:
        if end - position == len(MAGIC) and data.startswith(MAGIC, position):
            return
        record = _record_at(data, position, end)
        if record is None:
            following = _next_chunk(data, position + 1, end)
            problems.append(_gap(position, following, end))
            if following is None:
                return
            position = following
            continue
        yield record
        position = record[3]


def expand(data: bytes, record: Record) -> Span:
    """Return where the records inside a chunk lie: in the file itself, or in a new buffer if they were compressed.

    Raises:
        ValueError: the chunk is damaged or its checksum is wrong; says how.
    """
    _, _, start, end = record
    if end - start < _CHUNK.size + 12:
        raise ValueError("a chunk is too short for its header")
    _, _, size, crc = _CHUNK.unpack_from(data, start)
    name_end = start + 32 + int.from_bytes(data[start + 28 : start + 32], "little")
    body = name_end + 8
    body_end = body + int.from_bytes(data[name_end:body], "little")
    if body_end > end or size > _MAX_CHUNK:
        raise ValueError("a chunk's sizes do not fit into it")
    name = bytes(data[start + 32 : name_end])
    span = (data, body, body_end) if not name else _decompress(name, data[body:body_end], size)
    if crc and zlib.crc32(memoryview(span[0])[span[1] : span[2]]) != crc:
        raise ValueError("a chunk fails its checksum")
    return span


def parse(opcode_class: Any, data: bytes, record: Record) -> Any:  # noqa: ANN401 - mcap's record classes share no type
    """Parse a small record with its class of `mcap.records`.

    Raises:
        ValueError: the record is damaged.
    """
    try:
        return opcode_class.read(ReadDataStream(io.BytesIO(data[record[2] : record[3]])))
    except Exception as error:
        raise ValueError(f"a {opcode_class.__name__} record is damaged") from error


def read_contents(data: bytes, wanted: Wanted | None = None) -> Contents:
    """Read a file, by its index where that is complete and else from front to end.

    Args:
        data: the file.
        wanted: says of a channel and its schema whether its messages are needed; None means all are.
    """
    indexed = _read_indexed(data, wanted)
    return indexed if indexed is not None else read_streamed(data)


def read_streamed(data: bytes) -> Contents:
    """Read a file from front to end, past whatever is damaged."""
    contents = Contents()
    if data[: len(MAGIC)] != MAGIC:
        contents.problems.append(Problem("no_header", 0, "the file ends before its MCAP header: 0 events"))
        return contents
    loose: list[tuple[int, ...]] = []
    for record in walk(data, contents.problems):
        opcode, offset = record[0], record[1]
        try:
            if opcode == Opcode.CHUNK:
                _read_chunk(contents, data, record, loose)
            elif opcode == Opcode.MESSAGE:
                loose.append(_message(data, record))
            elif opcode == Opcode.FOOTER:
                contents.finished = True
            else:
                _keep(contents, data, record)
        except ValueError as error:
            contents.problems.append(Problem("corrupt_data", offset, str(error)))
    _flush(contents, data, loose)
    if contents.header is None and not contents.problems:
        contents.problems.append(Problem("no_header", len(data), "the file ends before its header: 0 events"))
    return contents


def summary(data: bytes) -> list[Record] | None:
    """Return the records of a valid summary section, None where there is none or its checksum is wrong."""
    footer_at = len(data) - _FOOTER_SIZE
    if footer_at < len(MAGIC) or data[-len(MAGIC) :] != MAGIC or data[: len(MAGIC)] != MAGIC:
        return None
    record = _record_at(data, footer_at, len(data))
    if record is None or record[0] != Opcode.FOOTER:
        return None
    footer: Footer = parse(Footer, data, record)
    if not len(MAGIC) <= footer.summary_start <= footer_at:
        return None
    if footer.summary_crc and zlib.crc32(data[footer.summary_start : len(data) - len(MAGIC) - 4]) != footer.summary_crc:
        return None
    problems: list[Problem] = []
    records = list(walk(data, problems, footer.summary_start, footer_at))
    return None if problems else records


def _read_indexed(data: bytes, wanted: Wanted | None) -> Contents | None:
    """Return the contents by the index, None unless the index accounts for every message that is wanted."""
    records = summary(data)
    if records is None:
        return None
    contents = Contents(finished=True)
    first = _record_at(data, len(MAGIC), len(data))
    indexes: list[ChunkIndex] = []
    statistics: Statistics | None = None
    try:
        for record in ([first] if first else []) + records:
            if record[0] == Opcode.CHUNK_INDEX:
                indexes.append(parse(ChunkIndex, data, record))
            elif record[0] == Opcode.STATISTICS:
                statistics = parse(Statistics, data, record)
            elif record[0] == Opcode.METADATA_INDEX:
                at = int.from_bytes(data[record[2] : record[2] + 8], "little")
                metadata = _record_at(data, at, len(data))
                if metadata is None or metadata[0] != Opcode.METADATA:
                    return None
                _keep(contents, data, metadata)
            else:
                _keep(contents, data, record)
        if statistics is None or len(contents.channels) < statistics.channel_count:
            return None
        ids = {
            i for i, channel in contents.channels.items() if wanted is None or wanted(channel, contents.schemas.get(channel.schema_id))
        }
        for index in sorted(indexes, key=lambda index: index.chunk_start_offset):
            if ids.isdisjoint(index.message_index_offsets):
                continue
            chunk = _record_at(data, index.chunk_start_offset, len(data))
            if chunk is None or chunk[0] != Opcode.CHUNK:
                return None
            batch = _indexed_batch(data, chunk, index)
            if batch is None:
                return None
            contents.batches.append(batch)
    except ValueError:
        return None
    return contents if _accounts_for(contents, statistics, ids) else None


def _indexed_batch(data: bytes, chunk: Record, index: ChunkIndex) -> Batch | None:
    """Return a chunk's messages at the offsets that its message indexes give, None where those do not fit."""
    offsets: list[IntArray] = []
    for at in index.message_index_offsets.values():
        record = _record_at(data, at, len(data))
        if record is None or record[0] != Opcode.MESSAGE_INDEX:
            return None
        pairs = np.frombuffer(data, "<u8", (record[3] - record[2] - 6) // 8, record[2] + 6).reshape(-1, 2)
        offsets.append(pairs[:, 1].astype(np.int64))
    at_all = np.sort(np.concatenate(offsets)) if offsets else np.empty(0, np.int64)
    buffer, begin, end = expand(data, chunk)
    records = buffer[begin:end]
    raw = np.frombuffer(records, np.uint8)
    if len(at_all) and (at_all[-1] + _MESSAGE_DTYPE.itemsize > len(raw) or at_all[0] < 0):
        return None
    windows = np.lib.stride_tricks.sliding_window_view(raw, _MESSAGE_DTYPE.itemsize) if len(at_all) else raw[:0]
    heads = np.ascontiguousarray(windows[at_all]).view(_MESSAGE_DTYPE).reshape(-1)
    ends = at_all + _PREFIX.size + heads["length"].astype(np.int64)
    if (heads["opcode"] != Opcode.MESSAGE).any() or (ends > len(raw)).any():
        return None
    return Batch(
        records,
        *(heads[name].astype(np.int64) for name in ("channel", "sequence", "log", "publish")),
        at_all + _MESSAGE_DTYPE.itemsize,
        ends,
    )


def _accounts_for(contents: Contents, statistics: Statistics, wanted: set[int]) -> bool:
    found = np.bincount(
        np.concatenate([batch.channel for batch in contents.batches] or [np.empty(0, np.int64)]), minlength=1 << 16
    )
    return all(found[i] == statistics.channel_message_counts.get(i, 0) for i in wanted)


def _record_at(data: bytes, position: int, end: int) -> Record | None:
    """Return the record that begins here, None if it is none or does not fit."""
    start = position + _PREFIX.size
    if start > end:
        return None
    opcode, length = _PREFIX.unpack_from(data, position)
    if opcode == 0 or start + length > end:
        return None
    return opcode, position, start, start + length


def _next_chunk(data: bytes, position: int, end: int) -> int | None:
    """Return where the next chunk with a valid, non-zero checksum begins."""
    for match in _LIKELY_CHUNK.finditer(data, position, end):
        record = _record_at(data, match.start(), end)
        if record is None or not data[record[2] + 24 : record[2] + 28].strip(b"\0"):
            continue
        try:
            expand(data, record)
        except ValueError:
            continue
        return match.start()
    return None


def _gap(position: int, following: int | None, end: int) -> Problem:
    if following is None:
        return Problem("truncated", position, f"the file ends inside a record; its last {end - position} bytes were ignored")
    return Problem("corrupt_data", position, f"{following - position} bytes are not valid records and were skipped")


def _decompress(name: bytes, body: bytes, size: int) -> Span:
    try:
        if name == b"zstd":
            records = zstandard.ZstdDecompressor().decompress(body, max_output_size=size)
            return records, 0, len(records)
        if name == b"lz4":
            records = lz4.frame.decompress(body)
            return records, 0, len(records)
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise ValueError(f"a chunk cannot be decompressed ({error})") from error
    raise ValueError(f"a chunk is compressed with {name.decode(errors='replace')!r}, expected zstd, lz4 or nothing")


def _read_chunk(contents: Contents, data: bytes, chunk: Record, loose: list[tuple[int, ...]]) -> None:
    """Add what a chunk holds; messages that lie in the file itself join the loose ones, for one large batch."""
    buffer, position, end = expand(data, chunk)
    rows = loose
    if buffer is not data:
        _flush(contents, data, loose)
        rows = []
    while position < end:
        record = _record_at(buffer, position, end)
        if record is None:
            contents.problems.append(Problem("corrupt_data", chunk[1], "a chunk holds bytes that are no record"))
            break
        if record[0] == Opcode.MESSAGE:
            rows.append(_message(buffer, record))
        else:
            _keep(contents, buffer, record)
        position = record[3]
    if buffer is not data:
        _flush(contents, buffer, rows)


def _message(data: bytes, record: Record) -> tuple[int, ...]:
    if record[3] - record[2] < _MESSAGE.size:
        raise ValueError("a message is shorter than its header")
    return (*_MESSAGE.unpack_from(data, record[2]), record[2] + _MESSAGE.size, record[3])


def _flush(contents: Contents, data: bytes, rows: list[tuple[int, ...]]) -> None:
    """Move rows into a batch."""
    if rows:
        contents.batches.append(Batch(data, *np.array(rows, np.uint64).astype(np.int64).T))
        rows.clear()


def _keep(contents: Contents, data: bytes, record: Record) -> None:
    match record[0]:
        case Opcode.HEADER:
            contents.header = parse(Header, data, record)
        case Opcode.SCHEMA:
            schema = parse(Schema, data, record)
            contents.schemas[schema.id] = schema
        case Opcode.CHANNEL:
            channel = parse(Channel, data, record)
            contents.channels[channel.id] = channel
        case Opcode.METADATA:
            contents.metadata.append(parse(Metadata, data, record))
        case _:
            pass
