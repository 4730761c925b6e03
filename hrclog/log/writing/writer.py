"""Write finished logs: chunked, zstd, indexed, there whole or not at all."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import IO, Final

import polars as pl

from hrclog.errors import LogExistsError
from hrclog.event_rows import from_row
from hrclog.events import Event, RunStarted, TaskEnded, TaskStarted
from hrclog.log.files.system import exists, replace_atomically
from hrclog.log.mcap.attachments import Attachment
from hrclog.log.messages import channels
from hrclog.log.messages.channels import ChannelSpec
from hrclog.log.messages.encode import Message, Signal, event_message, run_metadata, signal_message
from hrclog.log.messages.encode_columns import encode_columns
from hrclog.log.writing.finished import McapFile
from hrclog.log.writing.journal import LIBRARY
from hrclog.log.writing.lanes import Lanes

RUN_METADATA: Final = "hrclog.run"

_CHUNK_SIZE: Final = 1 << 16  # damage costs a chunk
_TIMES: Final = 1 << 64  # how many the format has
_SHOWN_BY_LANES: Final = (TaskStarted.kind, TaskEnded.kind)


class FinishedWriter:
    """Collect the messages of a finished log.

    Args:
        stream: where the bytes go.
    """

    def __init__(self, stream: IO[bytes]) -> None:
        self._writer = McapFile(stream, _CHUNK_SIZE)
        self._writer.start(channels.PROFILE, LIBRARY)
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._channels: dict[object, int] = {}

    def add(self, message: Message) -> None:
        """Add a message."""
        channel = self.channel_of(message.channel)
        self._writer.add_message(channel, message.log_time, message.data, message.publish_time, message.sequence)

    def channel_of(self, spec: ChannelSpec) -> int:
        """Return the id of a channel, registering it and its schema at its first use."""
        channel = self._channels.get(spec)
        if channel is None:
            schema = self.schema(spec.type_name, channels.SCHEMA_ENCODING, spec.definition)
            channel = self.channel(spec, spec.topic, channels.CDR, schema, dict(spec.metadata))
        return channel

    def schema(self, name: str, encoding: str, data: bytes) -> int:
        """Return the id of a schema, registering it at its first use."""
        key = (name, encoding, data)
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(name, encoding, data)
        return self._schemas[key]

    def channel(self, key: object, topic: str, encoding: str, schema: int, metadata: Mapping[str, str]) -> int:
        """Return the id of a channel, registering it at its first use."""
        if key not in self._channels:
            self._channels[key] = self._writer.register_channel(topic, encoding, schema, dict(metadata))
        return self._channels[key]

    def add_raw(self, channel: int, log_time: int, publish_time: int, sequence: int, data: bytes) -> None:
        """Add an encoded message of a registered channel; times beyond int64 are read as negative numbers."""
        self._writer.add_message(channel, log_time % _TIMES, data, publish_time % _TIMES, sequence)

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Add a metadata record."""
        self._writer.add_metadata(name, dict(values))

    def attachment(self, attachment: Attachment, content: bytes) -> None:
        """Add an attachment of another file, with its content."""
        times = attachment.create_time, attachment.log_time
        self._writer.add_attachment(*times, attachment.name, attachment.media_type, content)

    def finish(self) -> None:
        """Write indexes and summary."""
        self._writer.finish()


def write_log(path: Path, events: Iterable[Event], signals: Iterable[Signal] = ()) -> None:
    """Write a finished log in one step: it is there whole, or not at all.

    Args:
        path: the log, `NAME.mcap`.
        events: in order; their `seq` is set to 0, 1, … in each run, and their `log_time` to when they happened.
        signals: samples in order of time.

    Raises:
        LogExistsError: the log exists.
        LogWriteError: it cannot be written.
        InvalidEventError: an event is not of the form the vocabulary asks for.
    """
    if exists(path):
        raise LogExistsError(path, "choose another name")

    def fill(writer: FinishedWriter) -> None:
        lanes, lane_messages, facts = Lanes(), list[Message](), list[RunStarted]()
        for event in _number_events(events):
            writer.add(event_message(event, event.time_ns, may_lack_outcome=True))
            lane_messages += lanes.after(event, event.time_ns)
            if isinstance(event, RunStarted):
                facts.append(event)
        # lanes and signals follow the events, so that a reader of events can skip their chunks
        for message in chain(lane_messages, (signal_message(signal, signal.time_ns) for signal in signals)):
            writer.add(message)
        for fact in facts:
            writer.metadata(RUN_METADATA, run_metadata(fact))

    write_atomically(path, fill)


@dataclass(frozen=True, slots=True)
class PackedEvents:
    """Events of many runs as they will be written, a list per field: so that a short log costs no frame of its own."""

    data: list[bytes]
    instants: list[int]
    numbers: list[int]
    tasks: list[tuple[str, str, str, str]]  # kind, agent, task, execution_id
    run_facts: dict[int, dict[str, str]]  # metadata of runs, by the position of their `run_started`

    def fill(self, writer: FinishedWriter, begin: int, end: int) -> None:
        """Add the events of a part to a log, as `write_log` does."""
        channel = writer.channel_of(channels.EVENTS) if end > begin else 0
        for at in range(begin, end):
            instant = self.instants[at]
            writer.add_raw(channel, instant, instant, self.numbers[at], self.data[at])
        self._add_lanes(writer, begin, end)
        for at in range(begin, end):
            if self.tasks[at][0] == RunStarted.kind:
                writer.metadata(RUN_METADATA, self.run_facts[at])

    def _add_lanes(self, writer: FinishedWriter, begin: int, end: int) -> None:
        lanes, channel_of, texts = Lanes(), dict[str, int](), dict[str, bytes]()
        for at in range(begin, end):
            kind, agent, task, execution = self.tasks[at]
            label = lanes.label_after(kind, agent, task, execution) if kind in _SHOWN_BY_LANES else None
            if label is None:
                continue
            if agent not in channel_of:
                channel_of[agent] = writer.channel_of(channels.lane(agent))
            if label not in texts:
                texts[label] = channels.encode_string(label)
            instant = self.instants[at]
            writer.add_raw(channel_of[agent], instant, instant, 0, texts[label])


def pack_events(events: pl.DataFrame) -> PackedEvents:
    """Return an events frame, in order and numbered by `seq` from 0 in each run, as it is written.

    Raises:
        InvalidEventError: an event is not of the form the vocabulary asks for.
    """
    numbers = events.select(
        pl.col("time_ns").clip(lower_bound=0).alias("instant"), pl.col("seq").and_(0xFFFFFFFF).alias("number")
    )
    is_start = (events["kind"] == RunStarted.kind).arg_true()
    started = ((at, from_row(row)) for at, row in zip(is_start, events[is_start].iter_rows(named=True), strict=True))
    return PackedEvents(
        list(encode_columns(events)),
        numbers["instant"].to_list(),
        numbers["number"].to_list(),
        events.select("kind", "agent", "task", "execution_id").rows(),
        {at: run_metadata(fact) for at, fact in started if isinstance(fact, RunStarted)},
    )


def write_packed(path: Path, packed: PackedEvents, begin: int, end: int) -> None:
    """Write a part of packed events as a finished log: what `write_log` writes of the same events, in less time.

    Its name survives a crash of the system after `sync_folder` only, which is called once for many logs.

    Raises:
        LogExistsError: the log exists.
        LogWriteError: it cannot be written.
    """
    if exists(path):
        raise LogExistsError(path, "choose another name")
    write_atomically(path, lambda writer: packed.fill(writer, begin, end), sync_names=False)


def packed_bytes(packed: PackedEvents, begin: int, end: int) -> bytes:
    """Return the bytes of the log that `write_packed` writes."""
    stream = io.BytesIO()
    writer = FinishedWriter(stream)
    packed.fill(writer, begin, end)
    writer.finish()
    return stream.getvalue()


def write_atomically(path: Path, fill: Callable[[FinishedWriter], None], *, sync_names: bool = True) -> None:
    """Let `fill` write a finished log that appears at `path` in one step, when all is written.

    Args:
        path: the log.
        fill: adds what it holds.
        sync_names: as of `replace_atomically`.

    Raises:
        LogWriteError: the file cannot be written.
    """

    def write(stream: IO[bytes]) -> None:
        writer = FinishedWriter(stream)
        fill(writer)
        writer.finish()

    replace_atomically(path, write, sync_names=sync_names)


def _number_events(events: Iterable[Event]) -> Iterator[Event]:
    counts: Counter[str] = Counter()
    for event in events:
        seq = counts[event.run_id]
        counts[event.run_id] += 1
        yield event if event.seq == seq else replace(event, seq=seq)
