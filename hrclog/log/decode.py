"""Messages of a file into events and signals, by the fastest way that their layout allows."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import polars as pl
from mcap.records import Channel, Schema

from hrclog.errors import InvalidEventError
from hrclog.events import COLUMNS
from hrclog.log import channels, message
from hrclog.log.bags import BagTopic, definition_decoder, fields_of
from hrclog.log.json_rows import parse_object, row_from_object
from hrclog.log.message import EVENTS
from hrclog.log.records import Batch, Contents

Complain = Callable[[str, str, int | None], None]
"""Takes a diagnostic code, a message and the byte offset or None."""

EVENT_COLUMNS: Final = pl.Schema({name: EVENTS[name] for name in (*COLUMNS, "log_time_ns")})
SIGNAL_COLUMNS: Final = pl.Schema({"run_id": pl.String, "name": pl.String, "time_ns": pl.Int64, "value": pl.Float64})


@dataclass(slots=True)
class Decoded:
    """Frames of one file, in pieces."""

    events: list[pl.DataFrame] = field(default_factory=list)
    signals: list[pl.DataFrame] = field(default_factory=list)


def is_event_channel(channel: Channel, schema: Schema | None) -> bool:
    """Return whether a channel carries task events, by its type or its topic."""
    return (schema is not None and schema.name == message.TYPE_NAME) or channel.topic == channels.EVENTS_TOPIC


def is_wanted(channel: Channel, schema: Schema | None) -> bool:
    """Return whether a channel carries events or signals."""
    return is_event_channel(channel, schema) or _is_signal(channel)


def decode_contents(contents: Contents, complain: Complain) -> Decoded:
    """Decode the events and signals of an MCAP file."""
    decoded = Decoded()
    strange: dict[int, Callable[[bytes], Any] | None] = {}
    for batch in contents.batches:
        for channel_id in np.unique(batch.channel).tolist():
            channel = contents.channels.get(channel_id)
            part = _select(batch, batch.channel == channel_id)
            if channel is None:
                complain("corrupt_data", f"{len(part.start)} messages are on channel {channel_id}, which is not declared",
                         int(part.start[0]))
                continue
            schema = contents.schemas.get(channel.schema_id)
            if is_event_channel(channel, schema):
                decoded.events.append(_events(part, channel, schema, strange, complain))
            elif _is_signal(channel):
                decoded.signals.append(_signals(part, channel))
    return decoded


def decode_topics(topics: Iterable[BagTopic], complain: Complain) -> Decoded:
    """Decode the events and signals of a bag."""
    decoded = Decoded()
    for topic in topics:
        batch = _joined(topic)
        if topic.type_name == message.TYPE_NAME:
            if topic.cdr and _is_our_layout(topic.definition):
                decoded.events.append(_fast_events(batch, topic.decode, complain))
            else:
                decoded.events.append(_general_events(batch, topic.decode, complain))
        elif topic.cdr and topic.topic.startswith("/hrc/"):
            schema_id = 0
            channel = Channel(0, topic.topic, channels.CDR, {}, schema_id)
            decoded.signals.append(_signals(batch, channel))
    return decoded


def frame_of_rows(rows: list[dict[str, Any]]) -> pl.DataFrame:
    """Return flat event rows (with `log_time_ns`) as a frame."""
    return pl.DataFrame(rows, schema=EVENT_COLUMNS, orient="row")


def _events(
    part: Batch,
    channel: Channel,
    schema: Schema | None,
    strange: dict[int, Callable[[bytes], Any] | None],
    complain: Complain,
) -> pl.DataFrame:
    if channel.message_encoding == "json":
        return _general_events(part, parse_object, complain)
    definition = schema.data.decode(errors="replace") if schema is not None else message.DEFINITION
    if channel.id not in strange:
        strange[channel.id] = _strange_decoder(channel, definition, complain)
    decode = strange[channel.id]
    if channel.message_encoding != channels.CDR or (decode is None and not _is_our_layout(definition)):
        complain("undecodable_event", f"{len(part.start)} messages of {channel.topic} are encoded as "
                 f"{channel.message_encoding!r}, expected cdr with a readable definition, or json", None)
        return frame_of_rows([])
    return _fast_events(part, decode, complain) if _is_our_layout(definition) else _general_events(part, decode, complain)


def _strange_decoder(channel: Channel, definition: str, complain: Complain) -> Callable[[bytes], Any] | None:
    if channel.message_encoding != channels.CDR or _is_our_layout(definition):
        return None
    try:
        return definition_decoder(message.TYPE_NAME, definition)
    except ValueError as error:
        complain("undecodable_event", f"{channel.topic}: {error}", None)
        return None


def _is_our_layout(definition: str) -> bool:
    """Return whether a definition begins with our fields; newer versions only add fields at the end."""
    ours, theirs = _fields(message.DEFINITION), _fields(definition)
    return theirs[: len(ours)] == ours


def _fields(definition: str) -> list[tuple[str, ...]]:
    lines = (line.split("#")[0].split() for line in definition.split("=" * 80)[0].splitlines())
    return [tuple(words) for words in lines if words]


def _fast_events(part: Batch, decode: Callable[[bytes], Any] | None, complain: Complain) -> pl.DataFrame:
    frame, good = message.decode_columns(part.data, part.start, part.end)
    frame = frame.with_columns(pl.Series("log_time_ns", part.log_time[good], pl.Int64)).select(EVENT_COLUMNS.names())
    if good.all():
        return frame
    # another byte order, or damage: the general decoder knows
    decode = decode or definition_decoder(message.TYPE_NAME, message.DEFINITION)
    return pl.concat([frame, _general_events(_select(part, ~good), decode, complain)])


def _general_events(part: Batch, decode: Callable[[bytes], Any] | None, complain: Complain) -> pl.DataFrame:
    rows: list[dict[str, Any]] = []
    for start, end, log_time, publish_time, sequence in zip(
        part.start.tolist(), part.end.tolist(), part.log_time.tolist(), part.publish_time.tolist(),
        part.sequence.tolist(), strict=True,
    ):
        try:
            assert decode is not None  # noqa: S101 - callers pass None only for empty parts
            row = _row(decode(bytes(part.data[start:end])))
        except InvalidEventError as error:
            complain("undecodable_event", str(error), start)
            continue
        except Exception as error:  # noqa: BLE001 - a decoder of foreign bytes fails in ways of its own
            complain("undecodable_event", f"a message of {end - start} bytes cannot be decoded ({error})", start)
            continue
        row["time_ns"] = publish_time if row["time_ns"] is None else row["time_ns"]
        row["seq"] = sequence if row["seq"] is None else row["seq"]
        rows.append(row | {"log_time_ns": log_time})
    return frame_of_rows(rows)


def _row(decoded: Any) -> dict[str, Any]:  # noqa: ANN401 - a mapping or a generated message class
    values = dict(decoded) if isinstance(decoded, dict) else dict(fields_of(decoded, COLUMNS))
    for name in message.EVENTS:
        if values.get(name) == message.UNSET_INT:
            values[name] = None
    return row_from_object({name: _plain(value) for name, value in values.items()})


def _plain(value: Any) -> Any:  # noqa: ANN401 - numpy scalars of a decoder into Python's
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and np.isnan(value) else value


def _is_signal(channel: Channel) -> bool:
    return channel.message_encoding == channels.CDR and channel.topic.startswith("/hrc/") and (
        "signal" in channel.metadata
        or channel.topic.startswith("/hrc/signals/")
        or channel.topic.endswith("/joint_states")
    )


def _signals(part: Batch, channel: Channel) -> pl.DataFrame:
    run_id = channel.metadata.get("run_id", "")
    if channel.topic.endswith("/joint_states"):
        return _joint_signals(part, channel.metadata.get("agent") or channel.topic.split("/")[-2], run_id)
    name = channel.metadata.get("signal") or channel.topic.rsplit("/", 1)[-1]
    whole = part.end - part.start >= 12
    raw = np.frombuffer(part.data, np.uint8)
    windows = np.lib.stride_tricks.sliding_window_view(raw, 8)
    values = np.ascontiguousarray(windows[part.start[whole] + 4]).view("<f8")[:, 0]
    return pl.DataFrame({"time_ns": part.publish_time[whole], "value": values}).select(
        pl.lit(run_id).alias("run_id"), pl.lit(name).alias("name"), "time_ns", "value"
    )


def _joint_signals(part: Batch, agent: str, run_id: str) -> pl.DataFrame:
    rows: list[tuple[str, str, int, float]] = []
    for start, end, time_ns in zip(part.start.tolist(), part.end.tolist(), part.publish_time.tolist(), strict=True):
        try:
            names, positions = channels.decode_joints(bytes(part.data[start:end]))
        except ValueError:
            continue
        rows += [(run_id, f"{agent}/{name}", time_ns, value) for name, value in zip(names, positions, strict=False)]
    return pl.DataFrame(rows, schema=SIGNAL_COLUMNS, orient="row")


def _select(batch: Batch, mask: np.typing.NDArray[np.bool_]) -> Batch:
    arrays = (batch.channel, batch.sequence, batch.log_time, batch.publish_time, batch.start, batch.end)
    return batch if mask.all() else Batch(batch.data, *(array[mask] for array in arrays))


def _joined(topic: BagTopic) -> Batch:
    sizes = np.array([len(raw) for raw in topic.messages], np.int64)
    ends = np.cumsum(sizes)
    times = np.array(topic.times_ns, np.int64)
    zeros = np.zeros(len(times), np.int64)
    order = np.arange(len(times))
    return Batch(b"".join(topic.messages), zeros, order, times, times, ends - sizes, ends)
