"""ROS 2 bags (a folder, mcap or sqlite3) and ROS 1 bags that carry the event topic, through rosbags."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

from hrclog.errors import LogReadError
from hrclog.log import channels, message

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from rosbags.interfaces import Connection
    from rosbags.typesys.store import Typestore

_OUR_TYPES: Final = (
    message.TYPE_NAME,
    channels.FLOAT_TYPE,
    channels.JOINTS_TYPE,
    channels.POSE_TYPE,
    channels.STRING_TYPE,
)


@dataclass(slots=True)
class BagTopic:
    """The raw messages of one topic of a bag; `decode` turns one into an object with the type's fields."""

    topic: str
    type_name: str
    definition: str
    cdr: bool
    decode: Callable[[bytes], Any]
    times_ns: list[int] = field(default_factory=list)
    messages: list[bytes] = field(default_factory=list)


def is_bag(path: Path) -> bool:
    """Return whether a path is a ROS 1 bag file or a ROS 2 bag folder."""
    return path.is_dir() or path.suffix == ".bag"


def read_bag(path: Path) -> list[BagTopic]:
    """Return the topics of a bag that hrclog understands.

    Raises:
        LogReadError: the bag cannot be opened, or breaks off.
    """
    from rosbags.highlevel import AnyReader

    topics: dict[int, BagTopic] = {}
    try:
        with AnyReader([path], default_typestore=_store(message.TYPE_NAME, message.DEFINITION)) as reader:
            connections = [connection for connection in reader.connections if _is_event_or_signal(connection)]
            if not connections:  # rosbags would take an empty list for all
                return []
            topics = {
                connection.id: _topic(connection, reader.typestore, cdr=path.is_dir()) for connection in connections
            }
            for connection, time_ns, raw in reader.messages(connections):
                topic = topics[connection.id]
                topic.times_ns.append(time_ns)
                topic.messages.append(bytes(raw))
    except Exception as error:
        raise LogReadError(path, f"a bag that cannot be read ({error})", "a ROS 1 or ROS 2 bag") from error
    return list(topics.values())


def definition_decoder(type_name: str, definition: str) -> Callable[[bytes], Any]:
    """Return a decoder of CDR messages whose layout differs from ours.

    Raises:
        ValueError: the definition cannot be parsed.
    """
    try:
        store = _store(type_name, definition)
    except Exception as error:
        raise ValueError(f"the definition of {type_name} cannot be parsed ({error})") from error
    return lambda raw: store.deserialize_cdr(raw, type_name)


def fields_of(decoded: Any, names: Sequence[str]) -> Mapping[str, Any]:  # noqa: ANN401 - a generated message class
    """Return those fields of a decoded message that exist."""
    return {name: getattr(decoded, name) for name in names if hasattr(decoded, name)}


@lru_cache(maxsize=8)
def _store(type_name: str, definition: str) -> Typestore:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.LATEST)
    store.register(get_types_from_msg(definition, type_name))
    return store


def _is_event_or_signal(connection: Connection) -> bool:
    named = connection.topic.startswith("/hrc/") or connection.msgtype == message.TYPE_NAME
    return named and connection.msgtype in _OUR_TYPES


def _topic(connection: Connection, store: Typestore, *, cdr: bool) -> BagTopic:
    """Return a topic without its messages; a bag that carries no definitions is taken to hold our own."""
    name = connection.msgtype
    definition = connection.msgdef.data or (message.DEFINITION if name == message.TYPE_NAME else "")
    decode = store.deserialize_cdr if cdr else store.deserialize_ros1
    return BagTopic(connection.topic, name, definition, cdr, lambda raw: decode(raw, name))
