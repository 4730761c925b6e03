"""Messages of a file into events and signals, by the fastest way that their layout allows."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

import numpy as np
import polars as pl
from mcap.records import Channel, Schema

from hrclog.arrays import BoolArray, IntArray
from hrclog.errors import InvalidEventError
from hrclog.events import COLUMNS
from hrclog.log.limits import EVENT, EVENT_CHANNELS, EVENT_STATEMENTS, Budget, LimitError
from hrclog.log.mcap.contents import Batch, Contents, joined
from hrclog.log.messages import channels, message
from hrclog.log.messages.definition_cost import check_length
from hrclog.log.messages.definitions import OURS, ROS1, Definition, fields_of, type_name
from hrclog.log.messages.failures import Complain, Failures
from hrclog.log.messages.json_rows import parse_object, row_from_proto3
from hrclog.log.messages.message import EVENTS
from hrclog.log.messages.packed_messages import without_compression
from hrclog.log.messages.recorded_scene import SceneParts, is_scene
from hrclog.log.messages.signals import decode_signals, is_signal
from hrclog.wording import counted

EVENT_COLUMNS: Final = pl.Schema({name: EVENTS[name] for name in (*COLUMNS, "log_time_ns")})

_NO_EVENTS: Final = EVENT_COLUMNS.to_frame()
_SIGNAL_TYPES: Final = (channels.FLOAT_TYPE, channels.JOINTS_TYPE)
_SCENE_TYPES: Final = (channels.STRING_TYPE, channels.POSE_TYPE)

_MOST_TOLD: Final = 100  # channels that are told one by one
_KIND: Final = re.compile(rb"\bkind\b")

_Decode = Callable[[bytes], Any]
_DecodeBatch = Callable[[Batch], tuple[pl.DataFrame, IntArray]]
"""Returns the events, and which of the messages they are."""
_Fail = Callable[..., None]
"""Takes a reason, the log time of the first message, and how many there are."""


@dataclass(slots=True)
class Decoded:
    """Frames of one file, in pieces; without events also its (topic, type)s and how many messages there are of each.

    Events are in the order of writing; `seq` is null where the writer gave none.
    """

    events: list[pl.DataFrame] = field(default_factory=list)
    signals: list[pl.DataFrame] = field(default_factory=list)
    scene: SceneParts = field(default_factory=SceneParts)
    topics: Counter[tuple[str, str]] = field(default_factory=Counter)


def is_event_channel(channel: Channel, schema: Schema | None) -> bool:
    """Return whether a channel carries task events, by its type or its topic.

    JSON texts have no type of ours to tell them by: in a namespace, the end of the topic does.
    """
    if _type_of(schema) == message.TYPE_NAME:
        return True
    if channel.topic == channels.EVENTS_TOPIC:
        return channel.message_encoding == "json" or not _is_foreign(schema)
    is_json = channel.message_encoding == "json" or _type_of(schema) in ("", channels.STRING_TYPE)
    return is_json and channel.topic.endswith(channels.EVENTS_TOPIC)


def foreign_types(contents: Contents) -> list[tuple[str, str]]:
    """Return topic and type of the channels on topics of events that carry something else."""
    return [
        (channel.topic, _type_of(schema))
        for channel in contents.channels.values()
        if channel.topic.endswith(channels.EVENTS_TOPIC)
        and not is_event_channel(channel, schema := contents.schemas.get(channel.schema_id))
    ]


def is_wanted(channel: Channel, schema: Schema | None) -> bool:
    """Return whether a channel carries events, signals or a part of the scene."""
    return is_event_channel(channel, schema) or _is_signal(channel, schema) or _is_scene(channel, schema)


def decode_contents(contents: Contents, complain: Complain, *, signals: bool) -> Decoded:
    """Decode the events and, if wanted, signals and scene of a file."""
    decoded = Decoded()
    failures = Failures()
    decoders = _event_decoders(contents, failures, complain)
    undeclared: dict[int, tuple[int, int]] = {}
    budget = contents.budget
    for batch in joined(contents.batches):
        pieces: list[tuple[pl.DataFrame, IntArray]] = []
        for channel_id, rows_of_channel in _by_channel(batch):
            part = batch if rows_of_channel is None else _rows(batch, rows_of_channel)
            channel = contents.channels.get(channel_id)
            if channel is None:
                count, log_time = undeclared.get(channel_id, (0, int(part.log_time[0])))
                undeclared[channel_id] = count + len(part.start), log_time
            elif channel_id in decoders:
                events, rows = decoders[channel_id](without_compression(part, budget))
                pieces.append((events, rows if rows_of_channel is None else rows_of_channel[rows]))
            elif signals:
                _decode_signals(part, channel, contents, decoded, complain)
        decoded.events += _as_written(pieces)
    _report_undeclared(undeclared, complain)
    failures.report(complain)
    if not any(frame.height for frame in decoded.events):
        decoded.topics = contents.topics()
    return decoded


def _by_channel(batch: Batch) -> Iterator[tuple[int, IntArray | None]]:
    """Yield each channel of a batch and which of the messages are its own, None where all are."""
    if not len(batch.channel):
        return
    if (batch.channel == batch.channel[0]).all():
        yield int(batch.channel[0]), None
        return
    order = np.argsort(batch.channel, kind="stable")
    ids, begins = np.unique(batch.channel[order], return_index=True)
    yield from zip(ids.tolist(), np.split(order, begins[1:]), strict=True)


def _report_undeclared(undeclared: dict[int, tuple[int, int]], complain: Complain) -> None:
    for channel_id, (count, log_time) in list(undeclared.items())[:_MOST_TOLD]:
        text = f"{counted(count, 'message is', 'messages are')} on channel {channel_id}"
        complain("corrupt_data", f"{text}, which is not declared; the first has log time {log_time} ns", None)
    others = [count for count, _ in undeclared.values()][_MOST_TOLD:]
    if others:
        text = counted(sum(others), "message is", "messages are")
        complain("corrupt_data", f"{text} on {counted(len(others), 'further channel')} not declared", None)


def _as_written(pieces: list[tuple[pl.DataFrame, IntArray]]) -> list[pl.DataFrame]:
    """Return the events of a batch, channel by channel with their places in it, in the order of writing."""
    if len(pieces) < 2 and all((np.diff(rows) > 0).all() for _, rows in pieces):
        return [events for events, _ in pieces]
    order = np.argsort(np.concatenate([rows for _, rows in pieces]))
    return [pl.concat([events for events, _ in pieces])[order]]


def _decode_signals(part: Batch, channel: Channel, contents: Contents, decoded: Decoded, complain: Complain) -> None:
    schema = contents.schemas.get(channel.schema_id)
    if _is_signal(channel, schema):
        decoded.signals.append(decode_signals(without_compression(part, contents.budget), channel))
    elif _is_scene(channel, schema):
        part = without_compression(part, contents.budget)
        decoded.scene.take(part, channel, lambda text: complain("invalid_scene", text, None))


def _type_of(schema: Schema | None) -> str:
    return "" if schema is None else type_name(schema.name)


def _is_foreign(schema: Schema | None) -> bool:
    """Return whether a type can be none of ours: by its name, and as a definition may have moved to another package."""
    name = _type_of(schema)
    if schema is None or name in ("", channels.STRING_TYPE) or name.endswith("/TaskEvent"):
        return False
    return not _KIND.search(schema.data)


def _is_signal(channel: Channel, schema: Schema | None) -> bool:
    return is_signal(channel) and _type_of(schema) in ("", *_SIGNAL_TYPES)


def _is_scene(channel: Channel, schema: Schema | None) -> bool:
    return is_scene(channel) and _type_of(schema) in ("", *_SCENE_TYPES)


def _event_decoders(contents: Contents, failures: Failures, complain: Complain) -> dict[int, _DecodeBatch]:
    """Return by channel how its messages become events."""
    decoders: dict[int, _DecodeBatch] = {}
    for channel in contents.channels.values():
        schema = contents.schemas.get(channel.schema_id)
        if is_event_channel(channel, schema):
            fail = partial(failures.add, channel.topic)
            try:
                contents.budget.spend(EVENT_CHANNELS)
                decoder = _event_decoder(channel, schema, contents.budget, fail, complain)
            except LimitError as error:
                decoder = partial(_undecodable_events, reason=str(error), fail=fail)
            decoders[channel.id] = _bounded(decoder, contents.budget.most(EVENT), fail)
    return decoders


def _bounded(decode: _DecodeBatch, most: int, fail: _Fail) -> _DecodeBatch:
    """Return a decoder that passes over messages that are too large."""

    def decode_others(part: Batch) -> tuple[pl.DataFrame, IntArray]:
        sizes = part.end - part.start
        if sizes.max() <= most:
            return decode(part)
        fits = sizes <= most
        for at in np.flatnonzero(~fits).tolist():
            fail(str(LimitError(EVENT, int(sizes[at]), most)), int(part.log_time[at]))
        if not fits.any():
            return frame_of_rows([]), np.empty(0, np.int64)
        events, rows = decode(_select(part, fits))
        return events, np.flatnonzero(fits)[rows]

    return decode_others


def _event_decoder(
    channel: Channel, schema: Schema | None, budget: Budget, fail: _Fail, complain: Complain
) -> _DecodeBatch:
    wire = channel.message_encoding
    if wire == "json":
        return partial(_general_events, decode=parse_object, fail=fail)
    if wire not in (channels.CDR, ROS1):
        return partial(_undecodable_events, reason=f"encoded as {wire!r}, expected cdr or json", fail=fail)
    if _type_of(schema) == channels.STRING_TYPE:
        return partial(_general_events, decode=_ros1_object if wire == ROS1 else _cdr_object, fail=fail)
    check_length(0 if schema is None else len(schema.data))
    definition = _definition(channel, schema, complain)
    if wire == channels.CDR and definition.is_our_layout:
        return partial(_fast_events, fail=fail)
    budget.spend(EVENT_STATEMENTS, definition.n_statements)
    try:
        decode = definition.decoder(wire)
    except ValueError as error:
        return partial(_undecodable_events, reason=str(error), fail=fail)
    return partial(_general_events, decode=decode, fail=fail)


def _definition(channel: Channel, schema: Schema | None, complain: Complain) -> Definition:
    """Return the definition of an event channel; where the recorder did not find it, our own."""
    stored = Definition("") if schema is None else Definition(schema.data.decode(errors="replace"), schema.encoding)
    if not stored.is_empty:
        return stored
    text = f"{channel.topic} has no definition of {message.TYPE_NAME} beside it, and was read by that of this hrclog"
    complain("assumed_definition", text, None)
    return OURS


def _cdr_object(raw: bytes) -> dict[str, Any]:
    """Return the JSON object in a std_msgs/String as CDR."""
    if len(raw) < 8 or raw[0] or raw[1] > 1:
        raise InvalidEventError(f"found {counted(len(raw), 'byte that is', 'bytes that are')} no text")
    return _text_object(raw[8:], int.from_bytes(raw[4:8], "little" if raw[1] else "big"))


def _ros1_object(raw: bytes) -> dict[str, Any]:
    """Return the JSON object in a std_msgs/String of ROS 1."""
    return _text_object(raw[4:], int.from_bytes(raw[:4], "little"))


def _text_object(text: bytes, size: int) -> dict[str, Any]:
    if len(text) < size:
        raise InvalidEventError(f"found a text of {counted(len(text), 'byte')}, expected the {size} that it announces")
    return parse_object(text[:size].removesuffix(b"\0"))


def _undecodable_events(part: Batch, reason: str, fail: _Fail) -> tuple[pl.DataFrame, IntArray]:
    fail(reason, int(part.log_time[0]), len(part.start))
    return frame_of_rows([]), np.empty(0, np.int64)


def _fast_events(part: Batch, fail: _Fail) -> tuple[pl.DataFrame, IntArray]:
    frame, valid = message.decode_columns(part.data, part.start, part.end)
    stamps = {"log_time_ns": part.log_time, "publish_time": part.publish_time}
    frame = frame.with_columns(pl.Series(name, times[valid], pl.Int64) for name, times in stamps.items())
    frame = frame.with_columns(pl.col("time_ns").fill_null(pl.col("publish_time"))).select(EVENT_COLUMNS.names())
    rows = np.flatnonzero(valid)
    if len(rows) == len(valid):
        return frame, rows
    # another byte order or damage: the general decoder handles both
    others, other_rows = _general_events(_select(part, ~valid), OURS.decoder(), fail)
    return pl.concat([frame, others]), np.concatenate([rows, np.flatnonzero(~valid)[other_rows]])


def _general_events(part: Batch, decode: _Decode, fail: _Fail) -> tuple[pl.DataFrame, IntArray]:
    """Decode message by message."""
    rows: list[dict[str, Any]] = []
    kept: list[int] = []
    arrays = (part.start, part.end, part.log_time, part.publish_time)
    for at, (start, end, log_time, publish_time) in enumerate(zip(*(array.tolist() for array in arrays), strict=True)):
        try:
            row = _row(decode(part.data[start:end]))
        except Exception as error:  # noqa: BLE001 - a decoder of foreign bytes fails in ways of its own
            fail(str(error) if isinstance(error, InvalidEventError) else f"{type(error).__name__}: {error}", log_time)
            continue
        row["time_ns"] = publish_time if row["time_ns"] is None else row["time_ns"]
        rows.append(row | {"log_time_ns": log_time})
        kept.append(at)
    return frame_of_rows(rows), np.array(kept, np.int64)


def frame_of_rows(rows: list[dict[str, Any]]) -> pl.DataFrame:
    """Return flat event rows (with `log_time_ns`) as a frame."""
    return pl.DataFrame(rows, schema=EVENT_COLUMNS, orient="row") if rows else _NO_EVENTS


def _row(decoded: Any) -> dict[str, Any]:  # noqa: ANN401 - a mapping or a generated message class
    values = dict(decoded) if isinstance(decoded, dict) else dict(fields_of(decoded, COLUMNS))
    return row_from_proto3({name: _python_value(value) for name, value in values.items()})


def _python_value(value: Any) -> Any:  # noqa: ANN401 - numpy scalars of a decoder into Python's, None where unset
    if isinstance(value, np.generic):
        value = value.item()
    is_nan = isinstance(value, float) and np.isnan(value)
    return None if is_nan or (isinstance(value, int) and value == message.UNSET_INT) else value


def _select(batch: Batch, mask: BoolArray) -> Batch:
    return batch if mask.all() else _rows(batch, mask)


def _rows(batch: Batch, rows: BoolArray | IntArray) -> Batch:
    arrays = (batch.channel, batch.sequence, batch.log_time, batch.publish_time, batch.start, batch.end)
    return Batch(batch.data, *(array[rows] for array in arrays))
