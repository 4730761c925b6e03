"""What an MCAP file holds: its declarations, and its messages as arrays instead of one object each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Final

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Header, Metadata, Schema

from hrclog.arrays import IntArray
from hrclog.log.limits import CHANNELS, DECLARATIONS, Budget
from hrclog.log.mcap.attachments import Attachment, attachment_at, damage_text
from hrclog.log.mcap.records import Problem, Record, parse

_JOINED_BYTES: Final = 1 << 22
_DECLARED: Final = (Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA)

Wanted = Callable[[Channel, Schema | None], bool]
"""Says of a channel and its schema whether its messages are needed."""


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


def joined(batches: Iterable[Batch]) -> Iterator[Batch]:
    """Yield the batches, small ones joined: decoding costs a fixed time per batch and little per message."""
    pending: list[Batch] = []
    size = 0
    for batch in batches:
        if pending and size + len(batch.data) > _JOINED_BYTES:
            yield _join(pending)
            pending, size = [], 0
        pending.append(batch)
        size += len(batch.data)
    if pending:
        yield _join(pending)


def _join(batches: list[Batch]) -> Batch:
    if len(batches) == 1:
        return batches[0]
    offsets = np.cumsum([0, *(len(batch.data) for batch in batches[:-1])])
    columns = [
        [batch.channel, batch.sequence, batch.log_time, batch.publish_time, batch.start + offset, batch.end + offset]
        for batch, offset in zip(batches, offsets, strict=True)
    ]
    data = b"".join(batch.data for batch in batches)
    return Batch(data, *(np.concatenate(arrays) for arrays in zip(*columns, strict=True)))


def batch_of(channel_ids: Sequence[int], times_ns: Sequence[int], messages: Sequence[bytes]) -> Batch:
    """Return messages that were read one by one as a batch; they were published when logged, and carry no numbers."""
    channel, times = (np.array(numbers, np.int64) for numbers in (channel_ids, times_ns))
    sizes = np.array([len(data) for data in messages], np.int64)
    ends = np.cumsum(sizes)
    return Batch(b"".join(messages), channel, np.zeros_like(channel), times, times, ends - sizes, ends)


class ForeignRecordError(ValueError):
    """A record of another file: it declares an id that this file declares otherwise."""


@dataclass(slots=True)
class Contents:
    """What a file holds.

    Attributes:
        problems: what is damaged, missing, doubled or of another file.
        finished: whether the file has a footer.
        counts: messages of each channel, also of those that were not read, where the file says or tells them.
        unprotected: whether there are messages, and no checksum covers any of them.
        budget: what the reader of the file may still spend.
    """

    header: Header | None = None
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    metadata: list[Metadata] = field(default_factory=list)
    attachments: list[Attachment] = field(default_factory=list)
    batches: list[Batch] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)
    finished: bool = False
    counts: Mapping[int, int] = field(default_factory=dict)
    unprotected: bool = False
    budget: Budget = field(default_factory=lambda: Budget(None))
    _known: set[bytes] = field(default_factory=set)

    def topics(self) -> Counter[tuple[str, str]]:
        """Return how many messages there are of each (topic, type)."""
        counts = self.counts or Counter(chain.from_iterable(batch.channel.tolist() for batch in self.batches))
        topics: Counter[tuple[str, str]] = Counter()
        for channel in self.channels.values():
            schema = self.schemas.get(channel.schema_id)
            topics[channel.topic, schema.name if schema is not None else ""] += counts.get(channel.id, 0)
        return topics

    @property
    def is_ours(self) -> bool:
        """Return whether hrclog wrote the file."""
        return self.header is not None and self.header.library.startswith("hrclog")

    def keep(self, data: bytes, record: Record) -> None:
        """Take in a header, schema, channel or metadata record; the first one that declares an id counts.

        The first declaration lies in a chunk and is covered by its checksum, repetitions need not be.

        Raises:
            ForeignRecordError: it differs from the declaration that counts.
            LimitError: the file declares too much.
            ValueError: the record is damaged.
        """
        raw = bytes(data[record[1] : record[3]]) if record[0] in _DECLARED else b""
        if raw in self._known:
            return
        if raw:
            self.budget.spend(DECLARATIONS)
        self._declare(data, record)
        if raw and record[0] != Opcode.METADATA:
            self._known.add(raw)  # many files repeat their declarations in each chunk

    def _declare(self, data: bytes, record: Record) -> None:
        match record[0]:
            case Opcode.HEADER:
                header = parse(Header, data, record)
                self.header = self.header or header
            case Opcode.SCHEMA:
                schema = parse(Schema, data, record)
                known = self.schemas.setdefault(schema.id, schema)
                if known != schema:
                    text = f"schema {schema.id} is declared as {schema.name!r}, and before as {known.name!r}"
                    raise ForeignRecordError(f"{text}: records of another file")
            case Opcode.CHANNEL:
                channel = parse(Channel, data, record)
                if channel.id not in self.channels:
                    self.budget.spend(CHANNELS)
                declared = self.channels.setdefault(channel.id, channel)
                if declared != channel:
                    text = f"channel {channel.id} is declared as {channel.topic!r}, and before as {declared.topic!r}"
                    raise ForeignRecordError(f"{text}, or with other metadata: records of another file")
            case Opcode.METADATA:
                self.metadata.append(parse(Metadata, data, record))
            case _:
                pass

    def attach(self, data: bytes, record: Record) -> None:
        """Take in an attachment; one that fails its checksum is a problem.

        Raises:
            ValueError: the record is damaged.
        """
        self.budget.spend(DECLARATIONS)
        attachment = attachment_at(data, record[2], record[3])
        if attachment.is_intact:
            self.attachments.append(attachment)
        else:
            n_bytes = record[3] - record[1]
            self.problems.append(Problem("corrupt_data", record[1], damage_text(attachment), n_bytes))


def channel_counts(contents: Contents) -> dict[int, int]:
    """Return how many messages were read, by channel."""
    counts = np.bincount(np.concatenate([np.empty(0, np.int64), *(batch.channel for batch in contents.batches)]))
    return {int(channel): int(counts[channel]) for channel in np.flatnonzero(counts)}
