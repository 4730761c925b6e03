"""Read an MCAP file by its index: only the chunks that hold what is wanted."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Footer, MetadataIndex, Statistics

from hrclog.arrays import IntArray
from hrclog.log.contents import Batch, Contents, Wanted
from hrclog.log.records import MAGIC, PREFIX, Problem, Record, Walk, expand, parse, record_at
from hrclog.log.streamed import read_streamed

_MESSAGE_DTYPE: Final = np.dtype(
    [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")]
)
_FOOTER_SIZE: Final = PREFIX.size + 20 + len(MAGIC)


@dataclass(slots=True)
class Summary:
    """What the summary section says."""

    contents: Contents
    chunks: list[ChunkIndex] = field(default_factory=list)
    statistics: Statistics | None = None


def read_contents(data: bytes, wanted: Wanted | None = None) -> Contents:
    """Read a file, by its index where that is complete and else from front to end.

    Args:
        data: the file.
        wanted: says of a channel and its schema whether its messages are needed; None means all are.
    """
    try:
        return read_indexed(data, wanted)
    except ValueError:
        return read_streamed(data)


def read_indexed(data: bytes, wanted: Wanted | None = None) -> Contents:
    """Read a file by its index.

    Raises:
        ValueError: there is no index, or it does not account for every message that is wanted.
    """
    summary = read_summary(data)
    contents, statistics = summary.contents, summary.statistics
    if statistics is None or not _declares_all(contents, statistics):
        raise ValueError("the summary has no statistics, or does not repeat all declarations")
    contents.counts = statistics.channel_message_counts
    ids = {
        channel.id
        for channel in contents.channels.values()
        if wanted is None or wanted(channel, contents.schemas.get(channel.schema_id))
    }
    for index in sorted(summary.chunks, key=lambda index: index.chunk_start_offset):
        if not ids.isdisjoint(index.message_index_offsets):
            contents.batches.append(_batch(data, index))
    if not _accounts_for(contents, statistics, ids):
        raise ValueError("the index does not lead to as many messages as the statistics count")
    return contents


def read_summary(data: bytes) -> Summary:
    """Read the summary section, and the header and metadata that it leads to.

    Raises:
        ValueError: there is none, it is damaged, or its checksum is wrong.
    """
    contents = Contents(finished=True)
    contents.keep(data, _expect(data, len(MAGIC), Opcode.HEADER))
    summary = Summary(contents)
    for record in _summary_records(data):
        match record[0]:
            case Opcode.CHUNK_INDEX:
                summary.chunks.append(parse(ChunkIndex, data, record))
            case Opcode.STATISTICS:
                summary.statistics = parse(Statistics, data, record)
            case Opcode.METADATA_INDEX:
                at: MetadataIndex = parse(MetadataIndex, data, record)
                contents.keep(data, _expect(data, at.offset, Opcode.METADATA))
            case _:
                contents.keep(data, record)
    return summary


def _summary_records(data: bytes) -> list[Record]:
    footer_at = len(data) - _FOOTER_SIZE
    if footer_at < len(MAGIC) or not (data.startswith(MAGIC) and data.endswith(MAGIC)):
        raise ValueError("the file has no footer")
    footer: Footer = parse(Footer, data, _expect(data, footer_at, Opcode.FOOTER))
    if not len(MAGIC) <= footer.summary_start <= footer_at:
        raise ValueError("the file has no summary")
    if footer.summary_crc and zlib.crc32(data[footer.summary_start : len(data) - len(MAGIC) - 4]) != footer.summary_crc:
        raise ValueError("the summary fails its checksum")
    problems: list[Problem] = []
    records = list(Walk(data, problems, footer.summary_start, footer_at))
    if problems:
        raise ValueError("the summary is damaged")
    return records


def _expect(data: bytes, position: int, opcode: Opcode) -> Record:
    record = record_at(data, position, len(data))
    if record is None or record[0] != opcode:
        raise ValueError(f"there is no {opcode.name} record at byte {position}")
    return record


def _batch(data: bytes, index: ChunkIndex) -> Batch:
    """Return a chunk's messages at the offsets that its message indexes give.

    Raises:
        ValueError: the chunk is damaged, or the offsets do not lead to messages one behind the other.
    """
    channels, starts = _offsets(data, index)
    buffer, begin, end = expand(data, _expect(data, index.chunk_start_offset, Opcode.CHUNK))
    raw = np.frombuffer(buffer, np.uint8, end - begin, begin)
    if not len(starts):
        heads = np.empty(0, _MESSAGE_DTYPE)
    elif starts[0] < 0 or starts[-1] + _MESSAGE_DTYPE.itemsize > len(raw):
        raise ValueError("a message index leads out of its chunk")
    else:
        windows = np.lib.stride_tricks.sliding_window_view(raw, _MESSAGE_DTYPE.itemsize)
        heads = np.ascontiguousarray(windows[starts]).view(_MESSAGE_DTYPE).reshape(-1)
    bodies = starts + _MESSAGE_DTYPE.itemsize
    ends = starts + PREFIX.size + heads["length"].astype(np.int64)
    follows = np.append(starts[1:], len(raw))
    if not (
        (heads["opcode"] == Opcode.MESSAGE) & (heads["channel"] == channels) & (bodies <= ends) & (ends <= follows)
    ).all():
        raise ValueError("a message index does not lead to the messages of its channel")
    sequence, log_time, publish_time = (heads[name].astype(np.int64) for name in ("sequence", "log", "publish"))
    return Batch(buffer, channels, sequence, log_time, publish_time, bodies + begin, ends + begin)


def _offsets(data: bytes, index: ChunkIndex) -> tuple[IntArray, IntArray]:
    """Return channel and offset of a chunk's messages, by offset, shape (n,)."""
    channels: list[IntArray] = [np.empty(0, np.int64)]
    starts: list[IntArray] = [np.empty(0, np.int64)]
    for channel, at in index.message_index_offsets.items():
        record = _expect(data, at, Opcode.MESSAGE_INDEX)
        size = int.from_bytes(data[record[2] + 2 : record[2] + 6], "little")
        if record[2] + 6 + size > record[3]:
            raise ValueError("a message index is too short")
        pairs = np.frombuffer(data, "<u8", size // 8, record[2] + 6).reshape(-1, 2)
        starts.append(pairs[:, 1].astype(np.int64))
        channels.append(np.full(len(pairs), channel))
    order = np.argsort(np.concatenate(starts), kind="stable")
    return np.concatenate(channels)[order], np.concatenate(starts)[order]


def _declares_all(contents: Contents, statistics: Statistics) -> bool:
    schemas = {channel.schema_id for channel in contents.channels.values()} - {0}
    return (
        len(contents.channels) >= statistics.channel_count
        and len(contents.metadata) >= statistics.metadata_count
        and schemas <= contents.schemas.keys()
    )


def _accounts_for(contents: Contents, statistics: Statistics, channel_ids: set[int]) -> bool:
    batches = [batch.channel for batch in contents.batches]
    counts = np.bincount(np.concatenate([np.empty(0, np.int64), *batches]), minlength=1 << 16)
    return all(counts[channel] == statistics.channel_message_counts.get(channel, 0) for channel in channel_ids)
