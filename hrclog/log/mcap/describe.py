"""Describe any MCAP file, whatever it carries: declarations, counts, times, chunks, indexes, checksums."""

from __future__ import annotations

import struct
from collections import Counter
from dataclasses import asdict
from typing import Final

from mcap.opcode import Opcode
from mcap.records import DataEnd, Footer, Statistics

from hrclog.log.limits import RECORDS, Budget, LimitError
from hrclog.log.mcap.attachments import attachment_at, damage_text
from hrclog.log.mcap.contents import Contents
from hrclog.log.mcap.description import (
    AttachmentFacts,
    ChannelFacts,
    ChunkFacts,
    Description,
    MetadataFacts,
    SchemaFacts,
    SummaryFacts,
)
from hrclog.log.mcap.records import MAGIC, Problem, Record, Span, Walk, expand, next_chunk, parse, record_at

_MESSAGE: Final = struct.Struct("<HIQ")  # channel, sequence, log time
_MESSAGE_HEAD: Final = 22  # bytes
_CHUNK: Final = struct.Struct("<QQQII")  # start and end time, uncompressed size, CRC, length of the name
_INDEX: Final = struct.Struct("<HI")  # channel, bytes of entries
_INDEX_ENTRY: Final = 16  # bytes
_LONG_SIZE: Final = struct.Struct("<Q")
_INDEXES: Final = {
    Opcode.CHUNK_INDEX: "chunk",
    Opcode.MESSAGE_INDEX: "message",
    Opcode.ATTACHMENT_INDEX: "attachment",
    Opcode.METADATA_INDEX: "metadata",
    Opcode.SUMMARY_OFFSET: "summary_offset",
}
_KNOWN: Final = {int(opcode) for opcode in Opcode}


def describe(data: bytes, budget: Budget | None = None) -> Description | None:
    """Return what a file is, None if it is no MCAP file.

    Args:
        data: the file.
        budget: of the file; without one it is that of a file of these bytes.
    """
    budget = budget or Budget(len(data))
    try:
        begin = len(MAGIC) if data.startswith(MAGIC) else next_chunk(data, 0, len(data), len(data), budget)
    except LimitError:
        begin = None
    return None if begin is None else _Describer(data, budget).describe(begin)


class _Tally:
    """Messages by channel, and their span of time."""

    def __init__(self) -> None:
        self.counts: Counter[int] = Counter()
        self.start: int | None = None
        self.end: int | None = None

    def add(self, channel: int, log_time: int) -> None:
        self.counts[channel] += 1
        self.span(log_time, log_time)

    def span(self, start: int, end: int) -> None:
        self.start = start if self.start is None else min(self.start, start)
        self.end = end if self.end is None else max(self.end, end)


class _Describer:
    def __init__(self, data: bytes, budget: Budget) -> None:
        self._data = data
        self._budget = budget
        self._contents = Contents(budget=budget)
        self._problems: list[Problem] = []
        self._loose = _Tally()  # messages outside of chunks
        self._listed = _Tally()  # messages in chunks, as message indexes and the heads of chunks list them
        self._chunk_records: list[Record] = []
        self._chunks = ChunkFacts()
        self._summary = SummaryFacts()
        self._statistics: Statistics | None = None
        self._data_crc = 0
        self._behind_data = False
        self._indexes: Counter[str] = Counter()
        self._attachments: list[AttachmentFacts] = []
        self._metadata: list[MetadataFacts] = []
        self._others: Counter[int] = Counter()

    def describe(self, begin: int) -> Description:
        walk = Walk(self._data, self._problems, begin, self._budget)
        for record in walk:
            try:
                self._take(record)
            except LimitError as error:
                walk.refuse(record, error)
            except ValueError as error:
                walk.distrust(record, str(error))
        tally = self._listed_messages() or self._counted_messages()
        header = self._contents.header
        return Description(
            profile=header.profile if header else "",
            library=header.library if header else "",
            closed=self._contents.finished,
            n_messages=tally.counts.total(),
            n_unchunked_messages=self._loose.counts.total(),
            start_ns=tally.start,
            end_ns=tally.end,
            channels=self._channel_facts(tally.counts),
            schemas=self._schema_facts(),
            chunks=self._chunks,
            indexes={name: self._indexes[name] for name in _INDEXES.values()},
            summary=self._summary,
            data_crc=self._data_crc,
            statistics=asdict(self._statistics) if self._statistics else None,
            attachments=self._attachments,
            metadata=self._metadata,
            undeclared_channels={
                channel: n for channel, n in sorted(tally.counts.items()) if channel not in self._contents.channels
            },
            other_records=dict(sorted(self._others.items())),
            problems=self._problems,
        )

    def _take(self, record: Record) -> None:
        opcode = record[0]
        if opcode in _INDEXES:
            self._take_index(record)
        elif opcode not in _KNOWN:
            self._others[opcode] += 1
        else:
            self._take_content(record)

    def _take_content(self, record: Record) -> None:
        match record[0]:
            case Opcode.CHUNK:
                self._take_chunk_head(record)
            case Opcode.MESSAGE:
                self._loose.add(*_channel_and_time(self._data, record))
            case Opcode.ATTACHMENT:
                self._take_attachment(record)
            case Opcode.METADATA:
                self._contents.keep(self._data, record)
                kept = self._contents.metadata[-1]
                at = record[1], record[3] - record[1]
                self._metadata.append(MetadataFacts(kept.name, dict(kept.metadata), *at))
            case Opcode.STATISTICS:
                self._statistics = parse(Statistics, self._data, record)
            case Opcode.DATA_END:
                self._behind_data = True
                self._data_crc = parse(DataEnd, self._data, record).data_section_crc
            case Opcode.FOOTER:
                self._take_footer(parse(Footer, self._data, record))
            case _:
                self._contents.keep(self._data, record)
                self._summary.n_schemas += self._behind_data and record[0] == Opcode.SCHEMA
                self._summary.n_channels += self._behind_data and record[0] == Opcode.CHANNEL

    def _take_attachment(self, record: Record) -> None:
        attachment = attachment_at(self._data, record[2], record[3])
        n_bytes, length = attachment.end - attachment.start, record[3] - record[1]
        times = attachment.log_time, attachment.create_time
        self._attachments.append(
            AttachmentFacts(attachment.name, attachment.media_type, n_bytes, *times, record[1], length)
        )
        if not attachment.is_intact:
            self._problems.append(Problem("corrupt_data", record[1], damage_text(attachment), length))

    def _take_footer(self, footer: Footer) -> None:
        self._contents.finished = True
        self._summary.start, self._summary.offset_start = footer.summary_start, footer.summary_offset_start
        self._summary.crc = footer.summary_crc

    def _take_index(self, record: Record) -> None:
        self._indexes[_INDEXES[Opcode(record[0])]] += 1
        if record[0] == Opcode.MESSAGE_INDEX and self._chunk_records:
            channel, n_messages = _indexed(self._data, record)
            if n_messages:
                self._listed.counts[channel] += n_messages
                self._listed.span(*_CHUNK.unpack_from(self._data, self._chunk_records[-1][2])[:2])

    def _take_chunk_head(self, chunk: Record) -> None:
        start, end = chunk[2:]
        if end - start < _CHUNK.size + _LONG_SIZE.size:
            raise ValueError("a chunk is too short for its header")
        _, _, size, crc, name_size = _CHUNK.unpack_from(self._data, start)
        name_end = start + _CHUNK.size + name_size
        if name_end + _LONG_SIZE.size > end:
            raise ValueError("a chunk's sizes do not fit into it")
        name = self._data[start + _CHUNK.size : name_end].decode(errors="replace")
        self._chunk_records.append(chunk)
        self._chunks.n += 1
        self._chunks.n_with_checksum += crc != 0
        self._chunks.compression[name] = self._chunks.compression.get(name, 0) + 1
        self._chunks.compressed_bytes += _LONG_SIZE.unpack_from(self._data, name_end)[0]
        self._chunks.uncompressed_bytes += size

    def _listed_messages(self) -> _Tally | None:
        """Return the messages as indexes and statistics count them, None where these do not agree in everything."""
        statistics, contents = self._statistics, self._contents
        if statistics is None or self._problems or not contents.finished:
            return None
        tally = _merged(self._loose, self._listed)
        stated = Counter({channel: n for channel, n in statistics.channel_message_counts.items() if n})
        span = (statistics.message_start_time, statistics.message_end_time)
        agree = (
            tally.counts == stated
            and tally.counts.total() == statistics.message_count
            and (tally.start or 0, tally.end or 0) == span
            and len(contents.channels) == statistics.channel_count
            and len(contents.schemas) == statistics.schema_count
            and self._chunks.n == statistics.chunk_count
        )
        return tally if agree else None

    def _counted_messages(self) -> _Tally:
        """Return the messages as they lie in the chunks."""
        inside = _Tally()
        for chunk in self._chunk_records:
            try:
                self._count(expand(self._data, chunk, self._budget), inside)
            except LimitError as error:
                self._problems.append(Problem("limit_reached", chunk[1], str(error)))
                if error.limit.ends_reading:
                    break
            except ValueError as error:
                self._problems.append(Problem("corrupt_data", chunk[1], str(error)))
        return _merged(self._loose, inside)

    def _count(self, span: Span, tally: _Tally) -> None:
        buffer, position, end = span
        while position < end:
            record = record_at(buffer, position, end)
            if record is None:
                raise ValueError("a chunk holds bytes that are no record")
            self._budget.spend(RECORDS)
            if record[0] == Opcode.MESSAGE:
                tally.add(*_channel_and_time(buffer, record))
            elif record[0] in _KNOWN:
                self._contents.keep(buffer, record)
            else:
                self._others[record[0]] += 1
            position = record[3]

    def _channel_facts(self, counts: Counter[int]) -> list[ChannelFacts]:
        facts: list[ChannelFacts] = []
        for number, channel in sorted(self._contents.channels.items()):
            schema = self._contents.schemas.get(channel.schema_id)
            facts.append(
                ChannelFacts(
                    id=number,
                    topic=channel.topic,
                    schema_id=channel.schema_id,
                    schema=schema.name if schema else None,
                    schema_encoding=schema.encoding if schema else None,
                    message_encoding=channel.message_encoding,
                    metadata=dict(channel.metadata),
                    n_messages=counts[number],
                )
            )
        return facts

    def _schema_facts(self) -> list[SchemaFacts]:
        return [
            SchemaFacts(number, schema.name, schema.encoding, len(schema.data), _text(schema.data))
            for number, schema in sorted(self._contents.schemas.items())
        ]


def _merged(first: _Tally, second: _Tally) -> _Tally:
    merged = _Tally()
    merged.counts = first.counts + second.counts
    for tally in (first, second):
        if tally.start is not None and tally.end is not None:
            merged.span(tally.start, tally.end)
    return merged


def _channel_and_time(data: bytes, record: Record) -> tuple[int, int]:
    if record[3] - record[2] < _MESSAGE_HEAD:
        raise ValueError("a message is shorter than its header")
    channel, _, log_time = _MESSAGE.unpack_from(data, record[2])
    return channel, log_time


def _indexed(data: bytes, record: Record) -> tuple[int, int]:
    """Return channel and count of a message index."""
    if record[3] - record[2] < _INDEX.size:
        raise ValueError("a message index is too short")
    channel, size = _INDEX.unpack_from(data, record[2])
    if record[2] + _INDEX.size + size > record[3]:
        raise ValueError("a message index is too short")
    return channel, size // _INDEX_ENTRY


def _text(data: bytes) -> str | None:
    try:
        return data.decode()
    except UnicodeDecodeError:
        return None
