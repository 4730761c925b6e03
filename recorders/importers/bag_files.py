"""Recordings of ROS among paths, folders and globs: each with its parts, a name and its messages."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from mcap.records import Channel, Schema

from hrclog.arrays import IntArray
from hrclog.diagnostic import Diagnostic
from hrclog.errors import LogReadError
from hrclog.log.bags.folder import open_bag
from hrclog.log.files.discover import find_logs
from hrclog.log.files.names import BAG_METADATA, plain_name
from hrclog.log.mcap.contents import Batch, Contents
from hrclog.log.messages.definitions import type_name
from hrclog.log.messages.failures import Failures
from hrclog.log.messages.foreign import Decode, decoder_of, with_definition
from hrclog.log.messages.packed_messages import without_compression
from hrclog.log.parts import complaints, read_part
from hrclog.recorders.mapping.received import Received

_ENDINGS: Final = (".mcap.partial", ".mcap", ".db3", ".bag.active", ".bag")
_NUMBER: Final = re.compile(r"_\d+$")

Topic = tuple[str, str]
"""(topic, type)."""


@dataclass(frozen=True, slots=True)
class Recording:
    """One recording: its name, where it is, its parts in order, and parts that are listed and not there."""

    name: str
    path: Path
    parts: Sequence[Path]
    missing: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class Content:
    """What a recording holds of what was wanted.

    Attributes:
        topics: how many messages each has.
        definitions: of the topics' types, as they were recorded.
        assumed: types that were read by a standard definition, as none was recorded.
    """

    topics: dict[Topic, int] = field(default_factory=dict)
    definitions: dict[Topic, str] = field(default_factory=dict)
    assumed: set[str] = field(default_factory=set)
    _rows: list[_Rows] = field(default_factory=list)
    _failures: Failures = field(default_factory=Failures)

    def messages(self) -> Iterator[Received]:
        """Yield the messages in order of log time; those of one time in the order of the files."""
        if not self._rows:
            return
        times = np.concatenate([rows.batch.log_time for rows in self._rows])
        owners = np.repeat(np.arange(len(self._rows)), [len(rows.batch.start) for rows in self._rows])
        places = np.concatenate([rows.place for rows in self._rows])
        inner = np.concatenate([np.arange(len(rows.batch.start)) for rows in self._rows])
        for row in np.lexsort((places, times)).tolist():
            rows, at = self._rows[owners[row]], inner[row]
            batch, time_ns = rows.batch, int(times[row])
            try:
                content = rows.decode(batch.data[batch.start[at] : batch.end[at]])
            except Exception as error:  # noqa: BLE001 - a decoder of foreign bytes fails in ways of its own
                self._failures.add(rows.topic[0], f"{type(error).__name__}: {error}", time_ns)
                continue
            yield Received(rows.topic[0], rows.topic[1], time_ns, content)

    def report(self, recording: Recording, diagnostics: list[Diagnostic]) -> None:
        """Say which messages could not be decoded."""
        self._failures.report(complaints(recording.path, diagnostics))


@dataclass(frozen=True, slots=True)
class _Rows:
    """Messages of one channel, and where they stand among all of the recording."""

    topic: Topic
    decode: Decode
    batch: Batch
    place: IntArray


def find_recordings(sources: Iterable[Path]) -> list[Recording]:
    """Return the recordings that paths, folders and globs name; parts of a ROS 2 bag are one recording.

    Raises:
        LogReadError: a bag's folder cannot be opened, or has no part.
    """
    given = list(sources)
    recordings: dict[Path, Recording] = {}
    for path in find_logs(given):
        folder = path.parent
        if path.is_dir():
            bag = open_bag(path)
            recordings[path] = Recording(path.resolve().name, path, bag.parts, bag.missing)
        elif path not in given and _stem(path) != folder.resolve().name and _is_part(path, folder):
            if folder not in recordings:
                recordings[folder] = Recording(folder.resolve().name, folder, open_bag(folder).parts)
        else:
            recordings[path] = Recording(_stem(path), path, [path])
    return list(recordings.values())


def no_definition(_topic: str, _type_name: str) -> str:
    """Return "": nothing is known of a type but what the recording holds."""
    return ""


def read_recording(
    recording: Recording,
    wants: Callable[[str, str], bool],
    diagnostics: list[Diagnostic],
    definition: Callable[[str, str], str] = no_definition,
) -> Content:
    """Read the messages of wanted topics; a bad part costs only itself.

    Args:
        recording: where they are.
        wants: says of a topic and its type whether its messages are needed.
        diagnostics: takes what is lost or doubtful.
        definition: returns that of a topic's type, "" for none; it stands in where the recording holds none.

    Raises:
        LogReadError: no part can be read.
    """
    diagnostics += [
        Diagnostic("missing_part", f"{BAG_METADATA} lists this file, which is not there", str(recording.path / name))
        for name in recording.missing
    ]
    content = Content()
    failures: list[LogReadError] = []

    def wanted(channel: Channel, schema: Schema | None) -> bool:
        return wants(*_topic(channel, schema))

    for part in recording.parts:
        try:
            contents = read_part(part, wanted, complaints(part, diagnostics), mapped=True)
        except LogReadError as error:
            failures.append(error)
            continue
        _take_part(contents, wants, content, definition)
    if failures and len(failures) == len(recording.parts):
        raise failures[0]
    diagnostics += [Diagnostic("unreadable_file", error.reason, str(error.path)) for error in failures]
    return content


def _take_part(
    contents: Contents, wants: Callable[[str, str], bool], content: Content, definition: Callable[[str, str], str]
) -> None:
    for topic, count in contents.topics().items():
        key = (topic[0], type_name(topic[1]))
        content.topics[key] = content.topics.get(key, 0) + count
    for channel in contents.channels.values():
        schema = contents.schemas.get(channel.schema_id)
        if schema is not None:
            content.definitions[_topic(channel, schema)] = schema.data.decode(errors="replace")
    decoders: dict[int, Decode | str] = {}
    place = sum(len(rows.batch.start) for rows in content._rows)  # noqa: SLF001 - it fills it
    for batch in contents.batches:
        for channel_id in np.unique(batch.channel).tolist():
            if channel_id not in contents.channels:
                continue
            channel, rows = contents.channels[channel_id], np.flatnonzero(batch.channel == channel_id)
            schema = contents.schemas.get(channel.schema_id)
            topic = _topic(channel, schema)
            if not wants(*topic):
                continue
            part = without_compression(_select(batch, rows), contents.budget)
            if channel_id not in decoders:
                decoders[channel_id] = _decoder(channel, schema, content, definition(*topic))
            decode = decoders[channel_id]
            if isinstance(decode, str):
                content._failures.add(topic[0], decode, int(part.log_time[0]), len(part.start))  # noqa: SLF001 - it fills it
            else:
                content._rows.append(_Rows(topic, decode, part, place + rows))  # noqa: SLF001 - it fills it
        place += len(batch.start)


def _decoder(channel: Channel, schema: Schema | None, content: Content, definition: str) -> Decode | str:
    """Return how messages are decoded, or why they cannot be."""
    try:
        decoder = decoder_of(channel, with_definition(schema, definition) if definition else schema)
    except ValueError as error:
        return str(error)
    if decoder.assumed:
        content.assumed.add(decoder.assumed)
    return decoder.decode


def _topic(channel: Channel, schema: Schema | None) -> Topic:
    return channel.topic, "" if schema is None else type_name(schema.name)


def _select(batch: Batch, rows: IntArray) -> Batch:
    arrays = (batch.channel, batch.sequence, batch.log_time, batch.publish_time, batch.start, batch.end)
    return Batch(batch.data, *(array[rows] for array in arrays))


def _is_part(path: Path, folder: Path) -> bool:
    """Return whether a file is a part of the bag in its folder, by the name that rosbag2 gives it."""
    return _NUMBER.sub("", _stem(path)) == folder.resolve().name


def _stem(path: Path) -> str:
    name = plain_name(path.name)
    return next((name.removesuffix(ending) for ending in _ENDINGS if name.endswith(ending)), name) or path.name


def topics_text(topics: Iterable[Topic], most: int = 40) -> str:
    """Say which topics there are."""
    listed = sorted(set(topics))
    shown = ", ".join(f"{topic} ({kind or 'no type'})" for topic, kind in listed[:most])
    others = len(listed) - most
    return f"{shown or 'no topics'}{f' and {others:,} more' if others > 0 else ''}"
