"""Events and signals into messages: the counterpart of `decode`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hrclog.errors import InvalidEventError
from hrclog.event_rows import check_row, to_row
from hrclog.events import Event, RunStarted
from hrclog.log.messages import channels
from hrclog.log.messages.channels import ChannelSpec
from hrclog.log.messages.message import encode_row
from hrclog.scene import scene_text


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


@dataclass(frozen=True, slots=True)
class DescriptionSignal:
    """What an agent looks like and how its joints move it: URDF, whose joints have the names of its `JointSignal`s."""

    run_id: str
    agent: str
    time_ns: int
    urdf: str


@dataclass(frozen=True, slots=True)
class SceneSignal:
    """What stands in the cell at the start of a run; the fields of the mapping are in docs/log-format.md."""

    run_id: str
    time_ns: int
    scene: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class PoseSignal:
    """Where an object of the scene is: its centre in m, and its rotation as a quaternion x, y, z, w."""

    run_id: str
    name: str
    time_ns: int
    position: tuple[float, float, float]
    quaternion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)


Signal = FloatSignal | JointSignal | DescriptionSignal | SceneSignal | PoseSignal


@dataclass(frozen=True, slots=True)
class Message:
    """One encoded message of a channel."""

    channel: ChannelSpec
    log_time: int
    publish_time: int
    data: bytes
    sequence: int = 0


def event_message(event: Event, log_time: int, *, may_lack_outcome: bool = False) -> Message:
    """Return an event as a message.

    Args:
        event: what happened.
        log_time: when it is written.
        may_lack_outcome: whether the end of a task may tell no outcome, as some sources do not.

    Raises:
        InvalidEventError: a field is not of the form the vocabulary asks for.
    """
    row = to_row(event)
    data = encode_row(row)
    check_row(row, may_lack_outcome=may_lack_outcome)
    # what is written after a whole turn of the 32-bit counter, or before 1970, is right in the payload
    return Message(channels.EVENTS, max(log_time, 0), max(event.time_ns, 0), data, event.seq & 0xFFFFFFFF)


def signal_message(signal: Signal, log_time: int) -> Message:
    """Return a signal's sample as a message.

    Raises:
        InvalidEventError: a joint has no position, a scene is none, a text is not valid Unicode, or a time is out of
            range.
    """
    channel, data = _encode_signal(signal)
    return Message(channel, max(log_time, 0), max(signal.time_ns, 0), data)


def _encode_signal(signal: Signal) -> tuple[ChannelSpec, bytes]:
    match signal:
        case FloatSignal(run_id, name, _, value):
            return channels.float_signal(name, run_id), channels.encode_float(value)
        case JointSignal(run_id, agent, time_ns, names, positions):
            return channels.joint_states(agent, run_id), channels.encode_joints(time_ns, names, positions)
        case PoseSignal(run_id, name, time_ns, position, quaternion):
            return channels.object_pose(name, run_id), channels.encode_pose(time_ns, position, quaternion)
        case DescriptionSignal(run_id, agent, _, urdf):
            return channels.description(agent, run_id), _text("description", urdf)
        case SceneSignal(run_id, _, scene):
            return channels.scene(run_id), _text("scene", _scene_text(scene))


def _scene_text(scene: Mapping[str, Any]) -> str:
    try:
        return scene_text(scene)
    except ValueError as error:
        raise InvalidEventError(f"scene: {error}") from error


def _text(what: str, text: str) -> bytes:
    try:
        return channels.encode_string(text)
    except UnicodeEncodeError as error:
        raise InvalidEventError(f"{what}: the text is not valid Unicode") from error


def run_metadata(event: RunStarted) -> dict[str, str]:
    """Return the run facts that go into the log's metadata."""
    agents = "\n".join(event.agents)
    return {"run_id": event.run_id, "name": event.name, "segment": str(event.segment), "agents": agents}
