"""What an MCAP file is: its declarations, counts, times, chunks, indexes, checksums."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from hrclog.log.mcap.records import Problem


@dataclass(frozen=True, slots=True)
class SchemaFacts:
    """A schema; `definition` is None where it is no UTF-8 text."""

    id: int
    name: str
    encoding: str
    n_bytes: int
    definition: str | None


@dataclass(frozen=True, slots=True)
class ChannelFacts:
    """A channel and how many messages it has; `schema` is None where it has none."""

    id: int
    topic: str
    schema_id: int
    schema: str | None
    schema_encoding: str | None
    message_encoding: str
    metadata: dict[str, str]
    n_messages: int


@dataclass(frozen=True, slots=True)
class AttachmentFacts:
    """An attachment, without its data."""

    name: str
    media_type: str
    n_bytes: int
    log_time_ns: int
    create_time_ns: int
    offset: int
    length: int


@dataclass(frozen=True, slots=True)
class MetadataFacts:
    """A metadata record."""

    name: str
    values: dict[str, str]
    offset: int
    length: int


@dataclass(slots=True)
class ChunkFacts:
    """All chunks together; `compression` counts them by method, "" is none."""

    n: int = 0
    n_with_checksum: int = 0
    compression: dict[str, int] = field(default_factory=dict)
    compressed_bytes: int = 0
    uncompressed_bytes: int = 0


@dataclass(slots=True)
class SummaryFacts:
    """What stands behind the data: where (0 is nowhere), its checksum (0 is none), and what it repeats."""

    start: int = 0
    offset_start: int = 0
    crc: int = 0
    n_schemas: int = 0
    n_channels: int = 0


@dataclass(frozen=True, slots=True)
class Description:
    """What a file is.

    Counts and times are those of its messages. `statistics` is what the file says of itself, None if it does not.
    """

    profile: str
    library: str
    closed: bool
    n_messages: int
    n_unchunked_messages: int
    start_ns: int | None
    end_ns: int | None
    channels: list[ChannelFacts]
    schemas: list[SchemaFacts]
    chunks: ChunkFacts
    indexes: dict[str, int]
    summary: SummaryFacts
    data_crc: int
    statistics: dict[str, Any] | None
    attachments: list[AttachmentFacts]
    metadata: list[MetadataFacts]
    undeclared_channels: dict[int, int]
    """Messages on channels that are nowhere declared, by the channel's id."""
    other_records: dict[int, int]
    """Records that the format leaves to others, by opcode."""
    problems: list[Problem]

    def as_dict(self) -> dict[str, Any]:
        """Return the description as JSON holds it; `problems` are told as diagnostics."""
        document = asdict(self)
        del document["problems"]
        return document
