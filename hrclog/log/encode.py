"""Events and signals into messages: the counterpart of `decode`."""

from __future__ import annotations

from dataclasses import dataclass

from hrclog.event_rows import check_row, to_row
from hrclog.events import Event, RunStarted
from hrclog.log import channels
from hrclog.log.channels import ChannelSpec
from hrclog.log.message import encode_row


@dataclass(frozen=True, slots=True)
class FloatSignal:
    """One sample of a scalar signal."""

    run_id: str
    name: str
    time_ns: int
    value: float


@dataclass(frozen=True, slots=True)
class JointSignal:
    """One sample of an agent's joints, rad or m."""

    run_id: str
    agent: str
    time_ns: int
    names: tuple[str, ...]
    positions: tuple[float, ...]


Signal = FloatSignal | JointSignal


@dataclass(frozen=True, slots=True)
class Message:
    """One encoded message of a channel."""

    channel: ChannelSpec
    log_time: int
    publish_time: int
    data: bytes
    sequence: int = 0


def event_message(event: Event, log_time: int) -> Message:
    """Return an event as a message.

    Raises:
        InvalidEventError: a field is not of the form the vocabulary asks for.
    """
    row = to_row(event)
    data = encode_row(row)
    check_row(row)
    # what is written after a whole turn of the 32-bit counter, or before 1970, is right in the payload
    return Message(channels.EVENTS, max(log_time, 0), max(event.time_ns, 0), data, event.seq & 0xFFFFFFFF)


def signal_message(signal: Signal, log_time: int) -> Message:
    """Return a signal's sample as a message.

    Raises:
        InvalidEventError: a joint has no position, a text is not valid Unicode, or a time is out of range.
    """
    if isinstance(signal, FloatSignal):
        channel, data = channels.float_signal(signal.name, signal.run_id), channels.encode_float(signal.value)
    else:
        channel = channels.joint_states(signal.agent, signal.run_id)
        data = channels.encode_joints(signal.time_ns, signal.names, signal.positions)
    return Message(channel, max(log_time, 0), max(signal.time_ns, 0), data)


def run_metadata(event: RunStarted) -> dict[str, str]:
    """Return the run facts that go into the log's metadata."""
    agents = "\n".join(event.agents)
    return {"run_id": event.run_id, "name": event.name, "segment": str(event.segment), "agents": agents}
