"""Definitions of message types, as recorders store them beside the messages: layouts, and decoders made from them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

from hrclog.log.messages import channels, message
from hrclog.log.messages.definition_cost import check_types, checked_idl, checked_text, without_comments

if TYPE_CHECKING:
    from rosbags.interfaces.typing import Typesdict
    from rosbags.typesys.store import Typestore

IDL: Final = "ros2idl"
ROS1: Final = "ros1"
"""Message encoding of ROS 1, which has no alignment and no encapsulation header."""

_SEPARATOR: Final = "=" * 80
_LONGEST_ERROR: Final = 200  # characters of what the parser says, which may repeat the definition


@dataclass(frozen=True, slots=True)
class Definition:
    """The text that a recorder stored for `hrclog_msgs/msg/TaskEvent`, and the language that it is in."""

    text: str
    language: str = channels.SCHEMA_ENCODING

    @property
    def n_statements(self) -> int:
        """Return how many lines it has that state something."""
        return without_comments(self.text).count("\n")

    @property
    def is_empty(self) -> bool:
        """Return whether it defines nothing: the recorder did not find the type."""
        return not self.text.strip() or (self.language != IDL and not _fields(self.text))

    @property
    def is_our_layout(self) -> bool:
        """Return whether it begins with our fields; newer versions only add fields at the end."""
        if self.language != IDL:
            known_fields, fields = _fields(message.DEFINITION), _fields(self.text)
            return fields[: len(known_fields)] == known_fields
        try:
            ours, theirs = _layout(Definition(message.DEFINITION)), _layout(self)
        except Exception:  # noqa: BLE001 - a parser of foreign texts fails in ways of its own
            return False
        return theirs[: len(ours)] == ours

    def decoder(self, wire: str = channels.CDR) -> Callable[[bytes], Any]:
        """Return a decoder of messages on that wire, `cdr` or `ros1`, into objects with the type's fields.

        Raises:
            ValueError: the definition cannot be parsed.
        """
        return decoder_by(self, message.TYPE_NAME, wire)


OURS: Final = Definition(message.DEFINITION)


def decoder_by(definition: Definition, name: str, wire: str) -> Callable[[bytes], Any]:
    """Return a decoder of messages of a type into objects with its fields.

    Args:
        definition: of the type, and of those that it uses where they are no standard ones.
        name: of the type.
        wire: `cdr` or `ros1`.

    Raises:
        ValueError: the definition cannot be parsed.
    """
    try:
        store = _store(definition, name)
        store.fielddefs[name]
    except Exception as error:
        text = str(error)
        shown = f"{text[:_LONGEST_ERROR]} …" if len(text) > _LONGEST_ERROR else text
        raise ValueError(f"the definition of {name} cannot be parsed ({shown})") from error
    decode = store.deserialize_ros1 if wire == ROS1 else store.deserialize_cdr
    return lambda raw: decode(raw, name)


def type_name(name: str) -> str:
    """Return the name of a type as ROS 2 writes it; ROS 1 has no `msg` in the middle."""
    package, separator, rest = name.partition("/")
    return f"{package}/msg/{rest}" if separator and "/" not in rest else name


def fields_of(decoded: Any, names: Sequence[str]) -> Mapping[str, Any]:  # noqa: ANN401 - a generated message class
    """Return those fields of a decoded message that exist."""
    return {name: getattr(decoded, name) for name in names if hasattr(decoded, name)}


@lru_cache(maxsize=8)
def _fields(definition: str) -> list[tuple[str, ...]]:
    main = definition.split(_SEPARATOR, maxsplit=1)[0]  # types that it uses follow
    lines = (line.split("#", maxsplit=1)[0].split() for line in main.splitlines())
    return [tuple(words[:2]) for words in lines if words]  # type and name, without the default


@lru_cache(maxsize=64)
def _store(definition: Definition, name: str) -> Typestore:
    from rosbags.typesys import Stores, TypesysError, get_typestore

    types = _types(definition, name)
    check_types(types)
    store = get_typestore(Stores.LATEST)
    try:
        store.register(types)
    except TypesysError:  # another version of a standard type
        store = get_typestore(Stores.EMPTY)
        store.register(types)
    return store


def _types(definition: Definition, name: str) -> Typesdict:
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    if definition.language != IDL:
        return get_types_from_msg(checked_text(definition.text), name)
    types: Typesdict = {}
    for part in checked_idl(definition.text).split(f"{_SEPARATOR}\n"):
        if part.strip():
            head, newline, rest = part.partition("\n")
            types.update(get_types_from_idl(rest if newline and head.startswith("IDL: ") else part))
    return types


def _layout(definition: Definition) -> list[tuple[str, Any]]:
    """Return the names and types of a TaskEvent's fields."""
    store = _store(definition, message.TYPE_NAME)
    return [(name, kind) for name, kind in store.fielddefs[message.TYPE_NAME][1]]
