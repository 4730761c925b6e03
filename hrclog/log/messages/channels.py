"""The channels of a log: their topics, message types and CDR encodings."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

from hrclog.errors import InvalidEventError
from hrclog.log.messages import message
from hrclog.wording import counted

EVENTS_TOPIC: Final = "/hrc/events"
PROFILE: Final = "ros2"
CDR: Final = "cdr"
SCHEMA_ENCODING: Final = "ros2msg"

STRING_TYPE: Final = "std_msgs/msg/String"
FLOAT_TYPE: Final = "std_msgs/msg/Float64"
JOINTS_TYPE: Final = "sensor_msgs/msg/JointState"
POSE_TYPE: Final = "geometry_msgs/msg/PoseStamped"

SCENE_TOPIC: Final = "/hrc/scene"
WORLD: Final = "world"
"""The frame of poses."""
LITTLE: Final = b"\x00\x01\x00\x00"
"""The encapsulation header of little-endian CDR."""

_POSE: Final = struct.Struct("<4siI16s7d")
_WORLD: Final = struct.pack("<I12s", len(WORLD) + 1, WORLD.encode())  # padded to the doubles

_HEADER_TYPES: Final = (
    "=" * 80
    + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    + "=" * 80
    + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
)
_POSE_TYPES: Final = (
    "=" * 80
    + "\nMSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"
    + "=" * 80
    + "\nMSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n"
    + "=" * 80
    + "\nMSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
)
_DEFINITIONS: Final = {
    message.TYPE_NAME: message.DEFINITION,
    STRING_TYPE: "string data\n",
    FLOAT_TYPE: "float64 data\n",
    JOINTS_TYPE: (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
        + _HEADER_TYPES
    ),
    POSE_TYPE: "std_msgs/Header header\ngeometry_msgs/Pose pose\n" + _HEADER_TYPES + _POSE_TYPES,
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

_remembered = lru_cache(maxsize=1024)  # a log has few channels and very many messages


def lane(agent: str) -> ChannelSpec:
    """Return the channel of an agent's active task, "" when idle."""
    return ChannelSpec(f"/hrc/agents/{topic_name(agent)}/active_task", STRING_TYPE, (("agent", agent),))


@_remembered
def float_signal(name: str, run_id: str) -> ChannelSpec:
    """Return the channel of a scalar signal."""
    return ChannelSpec(f"/hrc/signals/{topic_name(name)}", FLOAT_TYPE, (("signal", name), ("run_id", run_id)))


@_remembered
def joint_states(agent: str, run_id: str) -> ChannelSpec:
    """Return the channel of an agent's joints."""
    metadata = (("agent", agent), ("run_id", run_id))
    return ChannelSpec(f"/hrc/agents/{topic_name(agent)}/joint_states", JOINTS_TYPE, metadata)


@_remembered
def description(agent: str, run_id: str) -> ChannelSpec:
    """Return the channel of an agent's robot description, URDF."""
    metadata = (("agent", agent), ("run_id", run_id))
    return ChannelSpec(f"/hrc/agents/{topic_name(agent)}/description", STRING_TYPE, metadata)


@_remembered
def scene(run_id: str) -> ChannelSpec:
    """Return the channel of what stands in the cell, JSON."""
    return ChannelSpec(SCENE_TOPIC, STRING_TYPE, (("run_id", run_id),))


@_remembered
def object_pose(name: str, run_id: str) -> ChannelSpec:
    """Return the channel of where an object is."""
    return ChannelSpec(f"/hrc/objects/{topic_name(name)}/pose", POSE_TYPE, (("object", name), ("run_id", run_id)))


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
    return LITTLE + _string(text)


def decode_string(data: bytes) -> str:
    """Return the text of a little-endian CDR String.

    Raises:
        ValueError: the message is damaged.
    """
    try:
        (size,) = struct.unpack_from("<I", data, 4)
        if data[:4] != LITTLE or not 8 < 8 + size <= len(data):
            raise ValueError(f"found {counted(len(data), 'byte that is', 'bytes that are')} no text")
        return data[8 : 8 + size].removesuffix(b"\0").decode()
    except (struct.error, UnicodeDecodeError) as error:
        raise ValueError(f"a text cannot be decoded ({error})") from error


def encode_float(value: float) -> bytes:
    """Return a std_msgs/Float64 as CDR."""
    return struct.pack("<4sd", LITTLE, value)


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
        counts = f"{len(names)} names and {len(positions)} positions"
        raise InvalidEventError(f"joint state: found {counts}, expected as many")
    try:
        layout, head = _joints_layout(tuple(names))
        return layout.pack(LITTLE, time_ns // 10**9, time_ns % 10**9, head, *positions)
    except (struct.error, UnicodeEncodeError) as error:
        raise InvalidEventError(f"joint state: a field cannot be written ({error})") from error


@lru_cache(maxsize=64)
def _joints_layout(names: tuple[str, ...]) -> tuple[struct.Struct, bytes]:
    """Return how joint states of these names are laid out, and what lies between the stamp and the positions."""
    body = bytearray(8)  # the stamp
    body += _string("")
    _align(body, 4)
    body += struct.pack("<I", len(names))
    for name in names:
        _align(body, 4)
        body += _string(name)
    _align(body, 4)
    body += struct.pack("<I", len(names))
    if names:
        _align(body, 8)
    head = bytes(body[8:])
    return struct.Struct(f"<4siI{len(head)}s{len(names)}d8x"), head  # 8x: no velocities, no efforts


def encode_pose(time_ns: int, position: Sequence[float], quaternion: Sequence[float]) -> bytes:
    """Return a geometry_msgs/PoseStamped in the frame `WORLD` as CDR.

    Args:
        time_ns: stamp.
        position: m, shape (3,).
        quaternion: x, y, z, w, shape (4,).

    Raises:
        InvalidEventError: a shape is wrong, or a field cannot be written.
    """
    if len(position) != 3 or len(quaternion) != 4:
        counts = f"{len(position)} coordinates and {len(quaternion)} parts of a quaternion"
        raise InvalidEventError(f"pose: found {counts}, expected 3 and 4")
    try:
        return _POSE.pack(LITTLE, time_ns // 10**9, time_ns % 10**9, _WORLD, *position, *quaternion)
    except struct.error as error:
        raise InvalidEventError(f"pose: a field cannot be written ({error})") from error


def joint_names(data: bytes) -> tuple[list[str], int, int]:
    """Return the names of a little-endian CDR JointState, the byte at which its positions begin, and how many it has.

    Raises:
        ValueError: the message is damaged.
    """
    try:
        position = 12  # stamp, behind the encapsulation header
        _, position = _read_string(data, position)
        position, n_names = _read_count(data, position)
        names = []
        for _ in range(n_names):
            name, position = _read_string(data, position)
            names.append(name)
        position, count = _read_count(data, position)
    except (struct.error, UnicodeDecodeError) as error:
        raise ValueError(f"a joint state cannot be decoded ({error})") from error
    position += -(position - 4) % 8 if count else 0
    if position + 8 * count > len(data):
        raise ValueError(f"a joint state of {counted(len(data), 'byte')} has no room for {counted(count, 'position')}")
    return names, position, count


def _string(text: str) -> bytes:
    encoded = text.encode()
    return struct.pack("<I", len(encoded) + 1) + encoded + b"\0"


def _align(body: bytearray, size: int) -> None:
    body += bytes(-len(body) % size)


def _read_count(data: bytes, position: int) -> tuple[int, int]:
    """Return the byte behind a count, and the count."""
    position += -(position - 4) % 4
    return position + 4, int(struct.unpack_from("<I", data, position)[0])


def _read_string(data: bytes, position: int) -> tuple[str, int]:
    position, size = _read_count(data, position)
    return data[position : position + size].rstrip(b"\0").decode(), position + size
