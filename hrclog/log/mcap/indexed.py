"""Read an MCAP file by its index: only the chunks that hold what is wanted."""

from __future__ import annotations

from typing import Final

import numpy as np
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Footer, Statistics

from hrclog.arrays import IntArray, UintArray
from hrclog.log.limits import FRAME, RECORDS, Budget
from hrclog.log.mcap.completeness import count_problems, data_problems, frame_problems, match_chunks
from hrclog.log.mcap.contents import Batch, Contents, Wanted, channel_counts
from hrclog.log.mcap.frame import has_checksum, listing, survey
from hrclog.log.mcap.records import MAGIC, PREFIX, Problem, Record, expand, parse, record_at
from hrclog.log.mcap.streamed import read_streamed

_MESSAGE_DTYPE: Final = np.dtype(
    [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")]
)
_MESSAGE_HEAD: Final = np.uint64(_MESSAGE_DTYPE.itemsize - PREFIX.size)
_ZERO: Final = np.zeros(1, np.int64)
_MAX_OFFSET: Final = 1 << 40
_LARGE: Final = 1 << 19  # bytes of a chunk
_SPARSE: Final = 4
_FOOTER_SIZE: Final = PREFIX.size + 20 + len(MAGIC)


def read_contents(data: bytes, wanted: Wanted | None = None, budget: Budget | None = None) -> Contents:
    """Read a file, by its index where that is complete and else from front to end.

    Args:
        data: the file.
        wanted: says of a channel and its schema whether its messages are needed; None means all are.
        budget: of the file; without one it is that of a file of these bytes.
    """
    budget = budget or Budget(len(data))
    try:
        return read_indexed(data, wanted, budget.fresh())
    except ValueError:
        pass
    return read_streamed(data, budget)  # here, where the error no longer keeps what was read by the index


def read_indexed(data: bytes, wanted: Wanted | None = None, budget: Budget | None = None) -> Contents:
    """Read a file by its index, if all that the file says of itself fits.

    Of chunks that hold nothing wanted, only the heads are looked at.

    Args:
        data: the file.
        wanted: as of `read_contents`.
        budget: of the file; without one it is that of a file of these bytes.

    Raises:
        ValueError: there is no index, something does not fit, or a limit is reached.
    """
    budget = budget or Budget(len(data))
    _summary_at(data)
    frame = survey(data, budget.most(FRAME))
    said = listing(data, frame)
    contents = Contents(finished=True, budget=budget)
    for record in frame.others.values():
        if record[0] == Opcode.ATTACHMENT:
            contents.attach(data, record)
        else:
            contents.keep(data, record)
    _trust(contents.problems)
    if contents.header is None or len(said.statistics) != 1:
        raise ValueError("the file has no header or no statistics")
    statistics = said.statistics[0][1]
    if not _declares_all(contents, statistics):
        raise ValueError("the summary does not repeat all declarations")
    contents.counts = statistics.channel_message_counts
    match = match_chunks(data, frame, said)
    _trust(frame_problems(data, frame, said, match))
    ids = {
        channel.id
        for channel in contents.channels.values()
        if wanted is None or wanted(channel, contents.schemas.get(channel.schema_id))
    }
    for index in sorted((index for _, index in said.chunk_indexes), key=lambda index: index.chunk_start_offset):
        if not ids.isdisjoint(index.message_index_offsets):
            contents.batches.append(_compact(_batch(data, index, contents), ids, data))
    if len(contents.batches) == len(frame.chunks):
        _trust(data_problems(data, said))
    counts = channel_counts(contents)
    _trust(count_problems(frame, said, match, {channel: counts.get(channel, 0) for channel in ids}, {}))
    contents.unprotected = statistics.message_count > 0 and not has_checksum(data, frame)
    return contents


def _compact(batch: Batch, ids: set[int], data: bytes) -> Batch:
    """Return a batch without what is not wanted, where that is most of a large chunk: images beside few messages."""
    if batch.data is data or len(batch.data) < _LARGE:
        return batch
    rows = np.flatnonzero(np.isin(batch.channel, list(ids)))
    sizes = (batch.end - batch.start)[rows]
    if sizes.sum() * _SPARSE > len(batch.data):
        return batch
    messages = [batch.data[batch.start[row] : batch.end[row]] for row in rows.tolist()]
    ends = np.cumsum(sizes)
    heads = (batch.channel, batch.sequence, batch.log_time, batch.publish_time)
    arrays = [*(array[rows] for array in heads), ends - sizes, ends]
    return Batch(b"".join(messages), *arrays)


def _trust(problems: list[Problem]) -> None:
    if problems:
        raise ValueError(problems[0].message)


def _summary_at(data: bytes) -> Footer:
    """Return the footer.

    Raises:
        ValueError: it leads to no summary.
    """
    footer_at = len(data) - _FOOTER_SIZE
    if footer_at < len(MAGIC) or not (data.startswith(MAGIC) and data.endswith(MAGIC)):
        raise ValueError("the file has no footer")
    footer: Footer = parse(Footer, data, _expect(data, footer_at, Opcode.FOOTER))
    if not len(MAGIC) <= footer.summary_start <= footer_at:
        raise ValueError("the file has no summary")
    return footer


def _expect(data: bytes, position: int, opcode: Opcode) -> Record:
    record = record_at(data, position, len(data))
    if record is None or record[0] != opcode:
        raise ValueError(f"there is no {opcode.name} record at byte {position}")
    return record


def _batch(data: bytes, index: ChunkIndex, contents: Contents) -> Batch:
    """Return a chunk's messages at the offsets that its message indexes give.

    Raises:
        ValueError: the chunk is damaged, or the offsets do not lead to all its messages, one behind the other.
    """
    channels, starts, times = _entries(data, index)
    contents.budget.spend(RECORDS, len(starts))
    buffer, begin, end = expand(data, _expect(data, index.chunk_start_offset, Opcode.CHUNK), contents.budget)
    raw = np.frombuffer(buffer, np.uint8, end - begin, begin)
    if not len(starts):
        heads = np.empty(0, _MESSAGE_DTYPE)
    elif starts[0] < 0 or starts[-1] > len(raw) - _MESSAGE_DTYPE.itemsize:
        raise ValueError("a message index leads out of its chunk")
    else:
        windows = np.lib.stride_tricks.sliding_window_view(raw, _MESSAGE_DTYPE.itemsize)
        heads = np.ascontiguousarray(windows[starts]).view(_MESSAGE_DTYPE).reshape(-1)
    lengths = heads["length"] - _MESSAGE_HEAD  # of 64 bits without sign: what is too short becomes very long
    is_message = (heads["opcode"] == Opcode.MESSAGE) & (heads["channel"] == channels) & (heads["log"] == times)
    if not is_message.all() or (len(lengths) and lengths.max() > len(raw)):
        raise ValueError("a message index does not lead to the messages of its channel")
    bodies = starts + _MESSAGE_DTYPE.itemsize
    ends = bodies + lengths.astype(np.int64)
    before = np.concatenate([_ZERO, ends])
    gaps = np.concatenate([starts, [len(raw)]]) - before
    if gaps.min() < 0:
        raise ValueError("a message index leads into a message, or to one that does not end in its chunk")
    for row in np.flatnonzero(gaps).tolist():
        at = begin + int(before[row])
        _check_declarations(buffer, at, at + int(gaps[row]), contents)
    sequence, log_time, publish_time = (heads[name].astype(np.int64) for name in ("sequence", "log", "publish"))
    return Batch(buffer, channels, sequence, log_time, publish_time, bodies + begin, ends + begin)


def _check_declarations(buffer: bytes, position: int, end: int, contents: Contents) -> None:
    """Look at what lies between the messages of a chunk.

    Raises:
        ValueError: there is a message, or a declaration that differs from that of the summary.
    """
    while position < end:
        record = record_at(buffer, position, end)
        if record is None or record[0] == Opcode.MESSAGE:
            raise ValueError("a chunk holds a message that no message index leads to, or no record")
        contents.budget.spend(RECORDS)
        contents.keep(buffer, record)
        position = record[3]


def _entries(data: bytes, index: ChunkIndex) -> tuple[IntArray, IntArray, UintArray]:
    """Return channel, offset and log time of a chunk's messages, by offset, shape (n,)."""
    channels: list[IntArray] = [np.empty(0, np.int64)]
    pairs: list[UintArray] = [np.empty((0, 2), np.uint64)]
    for channel, at in index.message_index_offsets.items():
        record = _expect(data, at, Opcode.MESSAGE_INDEX)
        size = int.from_bytes(data[record[2] + 2 : record[2] + 6], "little")
        if record[2] + 6 + size > record[3] or size % 16:
            raise ValueError("a message index is too short")
        pairs.append(np.frombuffer(data, "<u8", size // 8, record[2] + 6).reshape(-1, 2))
        channels.append(np.full(len(pairs[-1]), channel))
    times, starts = np.concatenate(pairs).T
    if len(starts) and starts.max() > _MAX_OFFSET:
        raise ValueError("a message index leads out of its chunk")
    if len(channels) == 2 and (starts[1:] > starts[:-1]).all():  # of one channel, in order
        return channels[1], starts.astype(np.int64), times
    order = np.argsort(starts, kind="stable")
    return np.concatenate(channels)[order], starts[order].astype(np.int64), times[order]


def _declares_all(contents: Contents, statistics: Statistics) -> bool:
    schemas = {channel.schema_id for channel in contents.channels.values()} - {0}
    return (
        len(contents.channels) >= statistics.channel_count
        and len(contents.metadata) >= statistics.metadata_count
        and schemas <= contents.schemas.keys()
    )
