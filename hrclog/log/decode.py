"""Messages of a file into events and signals, by the fastest way that their layout allows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

import numpy as np
import polars as pl
from mcap.records import Channel, Schema

from hrclog.arrays import BoolArray
from hrclog.errors import InvalidEventError
from hrclog.events import COLUMNS
from hrclog.log import channels, message
from hrclog.log.bags import BagTopic, definition_decoder, fields_of
from hrclog.log.contents import Batch, Contents, joined
from hrclog.log.json_rows import parse_object, row_from_object
from hrclog.log.message import EVENTS
from hrclog.log.recorded_scene import SceneParts, is_scene
from hrclog.log.signals import decode_signals, is_signal
from hrclog.wording import counted

Complain = Callable[[str, str, int | None], None]
"""Takes a diagnostic code, a message and the byte offset or None."""

EVENT_COLUMNS: Final = pl.Schema({name: EVENTS[name] for name in (*COLUMNS, "log_time_ns")})

_MAX_REASONS: Final = 10

_Decode = Callable[[bytes], Any]
_DecodeBatch = Callable[[Batch], pl.DataFrame]


@dataclass(slots=True)
class Decoded:
    """Frames of one file, in pieces."""

    events: list[pl.DataFrame] = field(default_factory=list)
    signals: list[pl.DataFrame] = field(default_factory=list)
    scene: SceneParts = field(default_factory=SceneParts)


def is_event_channel(channel: Channel, schema: Schema | None) -> bool:
    """Return whether a channel carries task events, by its type or its topic."""
    return (schema is not None and schema.name == message.TYPE_NAME) or channel.topic == channels.EVENTS_TOPIC


def is_wanted(channel: Channel, schema: Schema | None) -> bool:
    """Return whether a channel carries events, signals or a part of the scene."""
    return is_event_channel(channel, schema) or is_signal(channel) or is_scene(channel)


def decode_contents(contents: Contents, complain: Complain, *, signals: bool) -> Decoded:
    """Decode the events and, if wanted, signals and scene of an MCAP file."""
    decoded = Decoded()
    decoders = _event_decoders(contents, complain)
    for batch in joined(contents.batches):
        for channel_id in np.unique(batch.channel).tolist():
            part = _select(batch, batch.channel == channel_id)
            channel = contents.channels.get(channel_id)
            if channel is None:
                text = f"{counted(len(part.start), 'message is', 'messages are')} on channel {channel_id}"
                where = f"the first has log time {part.log_time[0]} ns"
                complain("corrupt_data", f"{text}, which is not declared; {where}", None)
            elif channel_id in decoders:
                decoded.events.append(decoders[channel_id](part))
            elif signals and is_signal(channel):
                decoded.signals.append(decode_signals(part, channel))
            elif signals and is_scene(channel):
                decoded.scene.take(part, channel, partial(_report_scene, complain))
    return decoded


def decode_topics(topics: Iterable[BagTopic], complain: Complain, *, signals: bool) -> Decoded:
    """Decode the events and, if wanted, signals and scene of a bag."""
    decoded = Decoded()
    for topic in topics:
        batch = _topic_batch(topic)
        channel = Channel(0, topic.topic, channels.CDR, {}, 0)
        if topic.type_name == message.TYPE_NAME:
            fast = topic.cdr and _is_our_layout(topic.definition)
            decode = _fast_events if fast else _general_events
            decoded.events.append(decode(batch, topic.decode, complain))
        elif signals and topic.cdr and is_signal(channel):
            decoded.signals.append(decode_signals(batch, channel))
        elif signals and topic.cdr and is_scene(channel):
            decoded.scene.take(batch, channel, partial(_report_scene, complain))
    return decoded


def _report_scene(complain: Complain, text: str) -> None:
    complain("invalid_scene", text, None)


def _event_decoders(contents: Contents, complain: Complain) -> dict[int, _DecodeBatch]:
    """Return by channel how its messages become events."""
    schemas = {channel.id: contents.schemas.get(channel.schema_id) for channel in contents.channels.values()}
    return {
        channel.id: _event_decoder(channel, schemas[channel.id], complain)
        for channel in contents.channels.values()
        if is_event_channel(channel, schemas[channel.id])
    }


def _event_decoder(channel: Channel, schema: Schema | None, complain: Complain) -> _DecodeBatch:
    if channel.message_encoding == "json":
        return partial(_general_events, decode=parse_object, complain=complain)
    definition = schema.data.decode(errors="replace") if schema is not None else message.DEFINITION
    if channel.message_encoding != channels.CDR:
        return partial(_undecodable_events, reason=f"encoded as {channel.message_encoding!r}", complain=complain)
    if _is_our_layout(definition):
        return partial(_fast_events, decode=None, complain=complain)
    try:
        decode = definition_decoder(message.TYPE_NAME, definition)
    except ValueError as error:
        return partial(_undecodable_events, reason=str(error), complain=complain)
    return partial(_general_events, decode=decode, complain=complain)


def _is_our_layout(definition: str) -> bool:
    """Return whether a definition begins with our fields; newer versions only add fields at the end."""
    known_fields, bag_fields = _fields(message.DEFINITION), _fields(definition)
    return bag_fields[: len(known_fields)] == known_fields


def _fields(definition: str) -> list[tuple[str, ...]]:
    main = definition.split("=" * 80, maxsplit=1)[0]  # types that it uses follow
    lines = (line.split("#", maxsplit=1)[0].split() for line in main.splitlines())
    return [tuple(words[:2]) for words in lines if words]  # type and name, without the default


def _undecodable_events(part: Batch, reason: str, complain: Complain) -> pl.DataFrame:
    text = f"{counted(len(part.start), 'message')} cannot be decoded ({reason})"
    complain("undecodable_event", f"{text}, expected cdr with a readable definition, or json", None)
    return frame_of_rows([])


def _fast_events(part: Batch, decode: _Decode | None, complain: Complain) -> pl.DataFrame:
    frame, valid = message.decode_columns(part.data, part.start, part.end)
    stamps = {"log_time_ns": part.log_time, "publish_time": part.publish_time, "sequence": part.sequence}
    frame = frame.with_columns(pl.Series(name, times[valid], pl.Int64) for name, times in stamps.items())
    frame = frame.with_columns(
        pl.col("time_ns").fill_null(pl.col("publish_time")), pl.col("seq").fill_null(pl.col("sequence"))
    )
    frame = frame.select(EVENT_COLUMNS.names())
    if valid.all():
        return frame
    # another byte order or damage: the general decoder handles both
    decode = decode or definition_decoder(message.TYPE_NAME, message.DEFINITION)
    return pl.concat([frame, _general_events(_select(part, ~valid), decode, complain)])


def _general_events(part: Batch, decode: _Decode, complain: Complain) -> pl.DataFrame:
    """Decode message by message; those that fail for the same reason share a complaint."""
    rows: list[dict[str, Any]] = []
    failures: Counter[str] = Counter()
    first: dict[str, int] = {}  # log times: a message in a compressed chunk has no offset in the file
    arrays = (part.start, part.end, part.log_time, part.publish_time, part.sequence)
    for start, end, log_time, publish_time, sequence in zip(*(array.tolist() for array in arrays), strict=True):
        try:
            row = _row(decode(part.data[start:end]))
        except Exception as error:  # noqa: BLE001 - a decoder of foreign bytes fails in ways of its own
            reason = str(error) if isinstance(error, InvalidEventError) else f"{type(error).__name__}: {error}"
            reason = reason if reason in failures or len(failures) < _MAX_REASONS else "for further reasons"
            failures[reason] += 1
            first.setdefault(reason, log_time)
            continue
        row["time_ns"] = publish_time if row["time_ns"] is None else row["time_ns"]
        row["seq"] = sequence if row["seq"] is None else row["seq"]
        rows.append(row | {"log_time_ns": log_time})
    for reason, count in failures.items():
        text = f"{counted(count, 'message')} cannot be decoded ({reason})"
        complain("undecodable_event", f"{text}, the first with log time {first[reason]} ns", None)
    return frame_of_rows(rows)


def frame_of_rows(rows: list[dict[str, Any]]) -> pl.DataFrame:
    """Return flat event rows (with `log_time_ns`) as a frame."""
    return pl.DataFrame(rows, schema=EVENT_COLUMNS, orient="row")


def _row(decoded: Any) -> dict[str, Any]:  # noqa: ANN401 - a mapping or a generated message class
    values = dict(decoded) if isinstance(decoded, dict) else dict(fields_of(decoded, COLUMNS))
    return row_from_object({name: _python_value(value) for name, value in values.items()})


def _python_value(value: Any) -> Any:  # noqa: ANN401 - numpy scalars of a decoder into Python's, None where unset
    if isinstance(value, np.generic):
        value = value.item()
    is_nan = isinstance(value, float) and np.isnan(value)
    return None if is_nan or (isinstance(value, int) and value == message.UNSET_INT) else value


def _select(batch: Batch, mask: BoolArray) -> Batch:
    arrays = (batch.channel, batch.sequence, batch.log_time, batch.publish_time, batch.start, batch.end)
    return batch if mask.all() else Batch(batch.data, *(array[mask] for array in arrays))


def _topic_batch(topic: BagTopic) -> Batch:
    sizes = np.array([len(raw) for raw in topic.messages], np.int64)
    ends = np.cumsum(sizes)
    times = np.array(topic.times_ns, np.int64)
    zeros = np.zeros(len(times), np.int64)
    order = np.arange(len(times))
    return Batch(b"".join(topic.messages), zeros, order, times, times, ends - sizes, ends)
