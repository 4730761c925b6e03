"""Write finished logs: chunked, zstd, indexed, there whole or not at all."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import IO, Final

from mcap.writer import Writer as McapWriter

from hrclog.errors import LogExistsError
from hrclog.events import Event, RunStarted
from hrclog.log.files.system import exists, replace_atomically
from hrclog.log.mcap.attachments import Attachment
from hrclog.log.messages import channels
from hrclog.log.messages.encode import Message, Signal, event_message, run_metadata, signal_message
from hrclog.log.writing.journal import LIBRARY
from hrclog.log.writing.lanes import Lanes

RUN_METADATA: Final = "hrclog.run"

_CHUNK_SIZE: Final = 1 << 16  # damage costs a chunk
_TIMES: Final = 1 << 64  # how many the format has


class FinishedWriter:
    """Collect the messages of a finished log.

    Args:
        stream: where the bytes go.
    """

    def __init__(self, stream: IO[bytes]) -> None:
        self._writer = McapWriter(stream, chunk_size=_CHUNK_SIZE, enable_data_crcs=True)
        self._writer.start(profile=channels.PROFILE, library=LIBRARY)
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._channels: dict[object, int] = {}

    def add(self, message: Message) -> None:
        """Add a message."""
        channel = self._channels.get(message.channel)
        if channel is None:
            spec = message.channel
            schema = self.schema(spec.type_name, channels.SCHEMA_ENCODING, spec.definition)
            channel = self.channel(spec, spec.topic, channels.CDR, schema, dict(spec.metadata))
        self._writer.add_message(channel, message.log_time, message.data, message.publish_time, message.sequence)

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
        self._writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it untyped


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


def write_atomically(path: Path, fill: Callable[[FinishedWriter], None]) -> None:
    """Let `fill` write a finished log that appears at `path` in one step, when all is written.

    Raises:
        LogWriteError: the file cannot be written.
    """

    def write(stream: IO[bytes]) -> None:
        writer = FinishedWriter(stream)
        fill(writer)
        writer.finish()

    replace_atomically(path, write)


def _number_events(events: Iterable[Event]) -> Iterator[Event]:
    counts: Counter[str] = Counter()
    for event in events:
        seq = counts[event.run_id]
        counts[event.run_id] += 1
        yield event if event.seq == seq else replace(event, seq=seq)
