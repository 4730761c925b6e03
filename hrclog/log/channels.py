"""The channels of a log: their topics, message types and CDR encodings."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from hrclog.errors import InvalidEventError
from hrclog.log import message

EVENTS_TOPIC: Final = "/hrc/events"
PROFILE: Final = "ros2"
CDR: Final = "cdr"
SCHEMA_ENCODING: Final = "ros2msg"

STRING_TYPE: Final = "std_msgs/msg/String"
FLOAT_TYPE: Final = "std_msgs/msg/Float64"
JOINTS_TYPE: Final = "sensor_msgs/msg/JointState"

_DEFINITIONS: Final = {
    message.TYPE_NAME: message.DEFINITION,
    STRING_TYPE: "string data\n",
    FLOAT_TYPE: "float64 data\n",
    JOINTS_TYPE: (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
        + "=" * 80
        + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
        + "=" * 80
        + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    ),
}


@dataclass(frozen=True, slots=True)
class ChannelSpec:
    """A channel to be: topic, message type and, as pairs of key and value, what the topic stands for."""

    topic: str
    type_name: str
    metadata: tuple[tuple[str, str], ...] = ()

    @property
    def definition(self) -> bytes:
        """Return the type's ROS 2 definition text."""
        return _DEFINITIONS[self.type_name].encode()


EVENTS: Final = ChannelSpec(EVENTS_TOPIC, message.TYPE_NAME)


def lane(agent: str) -> ChannelSpec:
    """Return the channel of an agent's active task, "" when idle."""
    return ChannelSpec(f"/hrc/agents/{topic_name(agent)}/active_task", STRING_TYPE, (("agent", agent),))


def float_signal(name: str, run_id: str) -> ChannelSpec:
    """Return the channel of a scalar signal."""
    return ChannelSpec(f"/hrc/signals/{topic_name(name)}", FLOAT_TYPE, (("signal", name), ("run_id", run_id)))


def joint_states(agent: str, run_id: str) -> ChannelSpec:
    """Return the channel of an agent's joints."""
    metadata = (("agent", agent), ("run_id", run_id))
    return ChannelSpec(f"/hrc/agents/{topic_name(agent)}/joint_states", JOINTS_TYPE, metadata)


def topic_name(name: str) -> str:
    """Return a valid ROS topic token for any text; different texts give different tokens.

    Raises:
        InvalidEventError: the text is not valid Unicode.
    """
    token = re.sub(r"\W", "_", name, flags=re.ASCII)
    if token == name and token and not token[0].isdigit() and "__" not in token:
        return token
    try:
        checksum = zlib.crc32(name.encode())
    except UnicodeEncodeError as error:
        raise InvalidEventError(f"found the name {name!r}, expected valid Unicode") from error
    return re.sub("_+", "_", f"_{token}_{checksum:08x}")


def encode_string(text: str) -> bytes:
    """Return a std_msgs/String as CDR."""
    return b"\x00\x01\x00\x00" + _string(text)


def encode_float(value: float) -> bytes:
    """Return a std_msgs/Float64 as CDR."""
    return struct.pack("<4sd", b"\x00\x01\x00\x00", value)


def encode_joints(time_ns: int, names: Sequence[str], positions: Sequence[float]) -> bytes:
    """Return a sensor_msgs/JointState as CDR, velocities and efforts empty.

    Args:
        time_ns: stamp.
        names: joint names, shape (n,).
        positions: rad or m, shape (n,).

    Raises:
        InvalidEventError: the two differ in length, a name is not valid Unicode, or the time is out of range.
    """
    if len(names) != len(positions):
        found = f"{len(names)} names and {len(positions)} positions"
        raise InvalidEventError(f"joint state: found {found}, expected as many")
    try:
        body = bytearray(struct.pack("<iI", time_ns // 10**9, time_ns % 10**9))
        body += _string("")
        _align(body, 4)
        body += struct.pack("<I", len(names))
        for name in names:
            _align(body, 4)
            body += _string(name)
    except (struct.error, UnicodeEncodeError) as error:
        raise InvalidEventError(f"joint state: a field cannot be written ({error})") from error
    for values in (positions, (), ()):
        _align(body, 4)
        body += struct.pack("<I", len(values))
        if values:
            _align(body, 8)
            body += struct.pack(f"<{len(values)}d", *values)
    return b"\x00\x01\x00\x00" + bytes(body)


def decode_joints(data: bytes) -> tuple[list[str], tuple[float, ...]]:
    """Return names and positions of a little-endian CDR JointState.

    Raises:
        ValueError: the message is damaged.
    """
    try:
        position = 12  # stamp, behind the encapsulation header
        _, position = _read_string(data, position)
        position, (count,) = _read(data, position, 4, "<I")
        names = []
        for _ in range(int(count)):
            name, position = _read_string(data, position)
            names.append(name)
        position, (count,) = _read(data, position, 4, "<I")
        if not count:
            return names, ()
        _, values = _read(data, position, 8, f"<{count}d")
    except (struct.error, UnicodeDecodeError) as error:
        raise ValueError(f"a joint state cannot be decoded ({error})") from error
    return names, values


def _string(text: str) -> bytes:
    encoded = text.encode()
    return struct.pack("<I", len(encoded) + 1) + encoded + b"\0"


def _align(body: bytearray, size: int) -> None:
    body += bytes(-len(body) % size)


def _read(data: bytes, position: int, align: int, layout: str) -> tuple[int, tuple[float, ...]]:
    position += -(position - 4) % align
    return position + struct.calcsize(layout), struct.unpack_from(layout, data, position)


def _read_string(data: bytes, position: int) -> tuple[str, int]:
    position, (size,) = _read(data, position, 4, "<I")
    return data[position : position + int(size)].rstrip(b"\0").decode(), position + int(size)
