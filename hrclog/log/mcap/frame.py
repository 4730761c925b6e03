"""The frame of an MCAP file: its records outside of chunks, and what they say that the file holds."""

from __future__ import annotations

import struct
from array import array
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, ChunkIndex, DataEnd, Footer, MetadataIndex, Statistics, SummaryOffset

from hrclog.arrays import IntArray
from hrclog.log.limits import FRAME, LimitError
from hrclog.log.mcap.records import MAGIC, PREFIX, Record, parse, record_at

HEAD: Final = np.dtype(
    [("opcode", "u1"), ("length", "<u8"), ("start", "<u8"), ("end", "<u8"), ("size", "<u8"), ("crc", "<u4")]
)
"""The first bytes of a chunk."""

_CRC_AT: Final = PREFIX.size + 24  # bytes of a chunk before its checksum, the last 8 being its size
_NO_CRC: Final = bytes(4)
_INDEX_HEAD: Final = struct.Struct("<QQQQI")  # times, place, length, size of the offsets

ChunkKey = tuple[int, int, int, int, bytes, int]
"""What tells chunks apart: times of first and last message, lengths unpacked and packed, compression, record."""

_SAID: Final[dict[int, tuple[str, Any]]] = {
    Opcode.CHUNK_INDEX: ("chunk_indexes", ChunkIndex),
    Opcode.METADATA_INDEX: ("metadata_indexes", MetadataIndex),
    Opcode.ATTACHMENT_INDEX: ("attachment_indexes", AttachmentIndex),
    Opcode.SUMMARY_OFFSET: ("summary_offsets", SummaryOffset),
    Opcode.STATISTICS: ("statistics", Statistics),
    Opcode.DATA_END: ("data_ends", DataEnd),
    Opcode.FOOTER: ("footers", Footer),
}
_ONCE: Final = (Opcode.STATISTICS, Opcode.DATA_END, Opcode.FOOTER)
_MOST_OF_ONE: Final = 8  # each is compared with the whole file
_FIXED: Final = {
    SummaryOffset: struct.Struct("<BQQ"),
    DataEnd: struct.Struct("<I"),
    Footer: struct.Struct("<QQI"),
}


@dataclass(slots=True)
class Frame:
    """Where the records outside of chunks lie, but for messages.

    Attributes:
        chunks: first byte of each chunk that can be read.
        damaged: first byte of each chunk that cannot.
        others: all records that are neither chunks nor messages, by their first byte.
    """

    chunks: array[int] = field(default_factory=lambda: array("q"))
    damaged: list[int] = field(default_factory=list)
    others: dict[int, Record] = field(default_factory=dict)

    def of(self, opcode: Opcode) -> list[Record]:
        """Return the records of a kind in the order of the file."""
        return [record for record in self.others.values() if record[0] == opcode]


@dataclass(slots=True)
class Listing:
    """What a file says of itself: the records of its end, parsed, each with where it begins."""

    chunk_indexes: list[tuple[int, ChunkIndex]] = field(default_factory=list)
    metadata_indexes: list[tuple[int, MetadataIndex]] = field(default_factory=list)
    attachment_indexes: list[tuple[int, AttachmentIndex]] = field(default_factory=list)
    summary_offsets: list[tuple[int, SummaryOffset]] = field(default_factory=list)
    statistics: list[tuple[int, Statistics]] = field(default_factory=list)
    data_ends: list[tuple[int, DataEnd]] = field(default_factory=list)
    footers: list[tuple[int, Footer]] = field(default_factory=list)


def survey(data: bytes, most: int) -> Frame:
    """Return the frame of a file whose records follow each other from its first byte to its last.

    Args:
        data: the file.
        most: how many records outside of chunks it may have.

    Raises:
        ValueError: they do not, there are messages outside of chunks, or too many other records.
    """
    frame = Frame()
    chunks, others = frame.chunks, frame.others
    position, end = len(MAGIC), len(data) - len(MAGIC)
    while position < end:
        record = record_at(data, position, end)
        if record is None:
            raise ValueError(f"the bytes from {position} on are no record")
        if record[0] == Opcode.CHUNK:
            chunks.append(position)
        elif record[0] == Opcode.MESSAGE:
            raise ValueError("there are messages outside of chunks")
        else:
            others[position] = record
        position = record[3]
        if len(others) > most:
            raise LimitError(FRAME, len(others), most)
    return frame


def listing(data: bytes, frame: Frame) -> Listing:
    """Parse what a file says of itself; of what can be there only once, a few are enough.

    Raises:
        ValueError: a record is damaged.
    """
    said = Listing()
    for offset, record in frame.others.items():
        if record[0] in _SAID:
            name, record_class = _SAID[record[0]]
            records = getattr(said, name)
            if record[0] not in _ONCE or len(records) < _MOST_OF_ONE:
                records.append((offset, _parse(record_class, data, record)))
    return said


def _parse(record_class: Any, data: bytes, record: Record) -> Any:  # noqa: ANN401 - mcap's record classes share no type
    if record_class is ChunkIndex:
        return chunk_index(data, record)
    fixed = _FIXED.get(record_class)
    if fixed is None:
        return parse(record_class, data, record)
    if record[3] - record[2] < fixed.size:
        raise ValueError(f"a {record_class.__name__} record is damaged")
    return record_class(*fixed.unpack_from(data, record[2]))


def chunk_index(data: bytes, record: Record) -> ChunkIndex:
    """Parse the index of a chunk: a file may have very many.

    Raises:
        ValueError: it is damaged.
    """
    try:
        first, last, at, length, size = _INDEX_HEAD.unpack_from(data, record[2])
        begin = record[2] + _INDEX_HEAD.size
        offsets = dict(struct.iter_unpack("<HQ", data[begin : begin + size]))
        index_length, name_size = struct.unpack_from("<QI", data, begin + size)
        name_end = begin + size + 12 + name_size
        packed, unpacked = struct.unpack_from("<QQ", data, name_end)
        name = data[name_end - name_size : name_end].decode()
    except (struct.error, UnicodeDecodeError) as error:
        raise ValueError("a ChunkIndex record is damaged") from error
    if name_end + 16 > record[3]:
        raise ValueError("a ChunkIndex record is damaged")
    return ChunkIndex(length, at, name, packed, last, index_length, offsets, first, unpacked)


def check_said(data: bytes, record: Record) -> None:
    """Parse a record of those that say what the file holds.

    Raises:
        ValueError: it is damaged.
    """
    if record[0] in _SAID:
        _parse(_SAID[record[0]][1], data, record)


def message_index(data: bytes, record: Record) -> list[tuple[int, int]]:
    """Return log time and offset of each message that a message index lists.

    Raises:
        ValueError: it is damaged.
    """
    begin = record[2] + 6
    size = int.from_bytes(data[record[2] + 2 : begin], "little")
    if begin + size > record[3] or size % 16:
        raise ValueError("a message index is too short")
    return list(struct.iter_unpack("<QQ", data[begin : begin + size]))


def heads(data: bytes, offsets: array[int] | IntArray) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    """Return the heads of chunks, shape (n,) of dtype `HEAD`."""
    if len(data) < HEAD.itemsize:
        return np.zeros(0, HEAD)
    windows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(data, np.uint8), HEAD.itemsize)
    return np.ascontiguousarray(windows[np.asarray(offsets, np.int64)]).view(HEAD).reshape(-1)


def has_checksum(data: bytes, frame: Frame) -> bool:
    """Return whether any checksum covers messages: that of a chunk, or of the data section."""
    return has_checked_chunk(data, frame) or any(
        any(data[record[2] : record[2] + 4]) for record in frame.of(Opcode.DATA_END)
    )


def has_checked_chunk(data: bytes, frame: Frame) -> bool:
    """Return whether any readable chunk has a checksum."""
    return any(data[offset + _CRC_AT : offset + _CRC_AT + 4] != _NO_CRC for offset in frame.chunks)


def unchecked_chunks(data: bytes, frame: Frame) -> list[int]:
    """Return first bytes of the readable chunks that hold something and have no checksum."""
    return [
        offset
        for offset in frame.chunks
        if data[offset + _CRC_AT : offset + _CRC_AT + 4] == _NO_CRC
        and any(data[offset + _CRC_AT - 8 : offset + _CRC_AT])
    ]


def chunk_key(data: bytes, offset: int) -> ChunkKey:
    """Return what tells a chunk from others, by its head."""
    start = offset + PREFIX.size
    length = int.from_bytes(data[offset + 1 : start], "little")
    first, last, size = (int.from_bytes(data[at : at + 8], "little") for at in (start, start + 8, start + 16))
    name_end = start + 32 + int.from_bytes(data[start + 28 : start + 32], "little")
    packed = int.from_bytes(data[name_end : name_end + 8], "little")
    return first, last, size, packed, data[start + 32 : name_end], PREFIX.size + length


def index_key(index: ChunkIndex) -> ChunkKey:
    """Return what tells a chunk from others, by its index."""
    times = index.message_start_time, index.message_end_time
    return *times, index.uncompressed_size, index.compressed_size, index.compression.encode(), index.chunk_length
