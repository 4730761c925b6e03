"""The bytes of a finished MCAP file: to the byte those of `mcap.writer.Writer`, in a quarter of its time."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable
from typing import IO, Final

import zstandard
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from hrclog.log.mcap.chain import record_bytes
from hrclog.log.mcap.records import MAGIC

_ZSTD: Final = "zstd"
_MESSAGE: Final = struct.Struct("<BQHIQQ")
_MESSAGE_FIELDS: Final = 22  # bytes of a message's own fields, before its data
_INDEX: Final = struct.Struct("<BQHI")
_FOOTER: Final = struct.Struct("<BQQQ")


class McapFile:
    """Collects the records of a finished file: chunks with zstd and checksums, all indexes, a summary.

    Args:
        stream: where the bytes go.
        chunk_size: bytes from which on a chunk is closed.
    """

    def __init__(self, stream: IO[bytes], chunk_size: int) -> None:
        self._stream = stream
        self._position = 0
        self._checksum = 0
        self._chunk_size = chunk_size
        self._compressor = zstandard.ZstdCompressor()
        self._parts: list[bytes] = []  # of the chunk to come
        self._size = 0
        self._index: dict[int, list[int]] = {}  # by channel, time and offset of each message of the chunk to come
        self._schemas: list[bytes] = []  # their records, which the summary repeats
        self._channels: list[bytes] = []
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}

    def start(self, profile: str, library: str) -> None:
        """Write the head of the file."""
        self._write(MAGIC)
        self._write(record_bytes(Header(profile, library)))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Add a schema, and return its id."""
        number = len(self._schemas) + 1
        self._schemas.append(record_bytes(Schema(id=number, data=data, encoding=encoding, name=name)))
        self._add(self._schemas[-1])
        return number

    def register_channel(self, topic: str, encoding: str, schema: int, metadata: dict[str, str]) -> int:
        """Add a channel, and return its id."""
        number = len(self._channels) + 1
        channel = Channel(id=number, topic=topic, message_encoding=encoding, schema_id=schema, metadata=metadata)
        self._channels.append(record_bytes(channel))
        self._add(self._channels[-1])
        return number

    def add_message(self, channel: int, log_time: int, data: bytes, publish_time: int, sequence: int) -> None:
        """Add a message of a channel."""
        head = _MESSAGE.pack(Opcode.MESSAGE, _MESSAGE_FIELDS + len(data), channel, sequence, log_time, publish_time)
        index = self._index.get(channel)
        if index is None:
            index = self._index[channel] = []
        index += (log_time, self._size)
        self._parts += (head, data)
        self._size += len(head) + len(data)
        if self._size > self._chunk_size:
            self._close_chunk()

    def add_attachment(self, create_time: int, log_time: int, name: str, media_type: str, content: bytes) -> None:
        """Add an attachment."""
        record = record_bytes(Attachment(create_time, log_time, name, media_type, content))
        self._attachments.append(
            AttachmentIndex(
                offset=self._position,
                length=len(record),
                create_time=create_time,
                log_time=log_time,
                data_size=len(content),
                name=name,
                media_type=media_type,
            )
        )
        self._write(record)

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        """Add a metadata record."""
        data = record_bytes(Metadata(name=name, metadata=values))
        self._metadata.append(MetadataIndex(offset=self._position, length=len(data), name=name))
        self._write(data)

    def finish(self) -> None:
        """Write what is left, the summary and its indexes."""
        self._close_chunk()
        self._write(record_bytes(DataEnd(self._checksum)))
        summary_start = self._position
        groups: list[tuple[Opcode, Iterable[bytes]]] = [
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [record_bytes(self._statistics())]),
            (Opcode.CHUNK_INDEX, map(record_bytes, self._chunks)),
            (Opcode.ATTACHMENT_INDEX, map(record_bytes, self._attachments)),
            (Opcode.METADATA_INDEX, map(record_bytes, self._metadata)),
        ]
        summary = bytearray()
        offsets: list[SummaryOffset] = []
        for opcode, records in groups:
            data = b"".join(records)
            offsets.append(SummaryOffset(opcode, group_start=summary_start + len(summary), group_length=len(data)))
            summary += data
        offsets_start = summary_start + len(summary)
        summary += b"".join(map(record_bytes, offsets))
        own_fields = _FOOTER.pack(Opcode.FOOTER, 8 + 8 + 4, summary_start, offsets_start)
        footer = Footer(summary_start, offsets_start, zlib.crc32(own_fields, zlib.crc32(summary)))
        self._write(bytes(summary) + record_bytes(footer) + MAGIC)

    def _add(self, record: bytes) -> None:
        self._parts.append(record)
        self._size += len(record)
        if self._size > self._chunk_size:
            self._close_chunk()

    def _close_chunk(self) -> None:
        if not self._index:
            return
        data = b"".join(self._parts)
        compressed = self._compressor.compress(data)
        first = min(min(entries[::2]) for entries in self._index.values())
        last = max(max(entries[::2]) for entries in self._index.values())
        chunk = record_bytes(Chunk(_ZSTD, compressed, last, first, zlib.crc32(data), len(data)))
        start = self._position
        self._write(chunk)
        offsets: dict[int, int] = {}
        indexes = bytearray()
        for channel, entries in self._index.items():
            offsets[channel] = self._position + len(indexes)
            size = 8 * len(entries)
            indexes += _INDEX.pack(Opcode.MESSAGE_INDEX, 6 + size, channel, size)
            indexes += struct.pack(f"<{len(entries)}Q", *entries)
            self._counts[channel] = self._counts.get(channel, 0) + len(entries) // 2
        self._write(bytes(indexes))
        self._chunks.append(
            ChunkIndex(
                chunk_length=len(chunk),
                chunk_start_offset=start,
                compression=_ZSTD,
                compressed_size=len(compressed),
                message_end_time=last,
                message_index_length=len(indexes),
                message_index_offsets=offsets,
                message_start_time=first,
                uncompressed_size=len(data),
            )
        )
        self._parts, self._size, self._index = [], 0, {}

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            metadata_count=len(self._metadata),
            message_start_time=min((chunk.message_start_time for chunk in self._chunks), default=0),
            message_end_time=max((chunk.message_end_time for chunk in self._chunks), default=0),
            schema_count=len(self._schemas),
        )

    def _write(self, data: bytes) -> None:
        self._checksum = zlib.crc32(data, self._checksum)
        self._position += len(data)
        self._stream.write(data)
