"""Decoders of other people's messages: by the definition beside them, or by the standard one where that is no use.

Definitions of action topics are unusable as recorders store them: up to Jazzy they are empty, of the language
"unknown"; from Kilted on the text of the whole action stands beside each of its topics, even beside the status.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

from mcap.records import Channel, Schema

from hrclog.log.messages import channels
from hrclog.log.messages.action_heads import head_decoder
from hrclog.log.messages.definition_cost import check_length
from hrclog.log.messages.definitions import IDL, ROS1, Definition, decoder_by, type_name
from hrclog.log.messages.json_rows import parse_object
from hrclog.log.messages.standard_types import OLDER_TYPES, STANDARD_TYPES

Decode = Callable[[bytes], Any]

_SEPARATOR: Final = "=" * 80 + "\n"
_ACTION: Final = re.compile(r"\A\s*(?:=+\s*\n)?ACTION: *(\S+)[^\n]*\n")
_DIVIDER: Final = re.compile(r"^---[^\S\n]*$", re.MULTILINE)
_FIXED: Final = ("action_msgs/msg/GoalStatusArray",)
"""Types that are what they are, whatever a recorder stored beside them."""

_UUID: Final = "unique_identifier_msgs/UUID goal_id\n"
_EVENT: Final = (
    "service_msgs/ServiceEventInfo info\n{package}/{action}_{service}_Request[<=1] request\n"
    "{package}/{action}_{service}_Response[<=1] response\n"
)
_ACTION_PARTS: Final = {
    "FeedbackMessage": f"{_UUID}{{package}}/{{action}}_Feedback feedback\n",
    "SendGoal_Request": f"{_UUID}{{package}}/{{action}}_Goal goal\n",
    "SendGoal_Response": "bool accepted\nbuiltin_interfaces/Time stamp\n",
    "GetResult_Request": _UUID,
    "GetResult_Response": "int8 status\n{package}/{action}_Result result\n",
    "SendGoal_Event": _EVENT.replace("{service}", "SendGoal"),
    "GetResult_Event": _EVENT.replace("{service}", "GetResult"),
}
"""What ROS 2 makes of an action, by the end of the type's name."""


@dataclass(frozen=True, slots=True)
class Decoder:
    """How messages of a channel are decoded; `assumed` names the type where its definition was not in the recording."""

    decode: Decode
    assumed: str = ""


def decoder_of(channel: Channel, schema: Schema | None) -> Decoder:
    """Return how the messages of a channel are decoded.

    Raises:
        ValueError: there is no definition to decode them by, or the encoding is unknown; says so.
    """
    wire = channel.message_encoding
    if wire == "json":
        return Decoder(parse_object)
    if wire not in (channels.CDR, ROS1):
        raise ValueError(f"encoded as {wire!r}, expected cdr, ros1 or json")
    name = "" if schema is None else type_name(schema.name)
    check_length(0 if schema is None else len(schema.data))
    text = "" if schema is None or schema.encoding == "unknown" else schema.data.decode(errors="replace")
    if name in _FIXED:
        return Decoder(_standard(name, wire), "" if text.strip() else name)
    action = _ACTION.match(text)
    if action is not None:
        return Decoder(_by_action(text[action.end() :], name, wire))
    if not text.strip():
        head = head_decoder(name) if wire == channels.CDR else None
        if head is not None:
            return Decoder(head)
        return Decoder(_standard(name, wire), name)
    language = IDL if schema is not None and schema.encoding == IDL else channels.SCHEMA_ENCODING
    return Decoder(decoder_by(Definition(text, language), name, wire))


def with_definition(schema: Schema | None, definition: str) -> Schema | None:
    """Return a schema with a definition in the place of none; of an action, its text or that of its goal alone.

    Args:
        schema: of a channel.
        definition: of its type.
    """
    if schema is None or (schema.encoding != "unknown" and schema.data.strip()):
        return schema
    name = type_name(schema.name)
    text = definition
    if name.endswith(tuple(f"_{part}" for part in _ACTION_PARTS)):
        own, separator, used = definition.partition(_SEPARATOR)
        missing = 2 - len(_DIVIDER.findall(own))
        if missing and "_SendGoal_" not in name:  # its head is all that can be read
            return schema
        text = f"ACTION: {name}\n{own.rstrip()}\n" + "---\n" * missing + separator + used
    return replace(schema, encoding=channels.SCHEMA_ENCODING, data=text.encode())


def _by_action(text: str, name: str, wire: str) -> Decode:
    """Return a decoder of one of the types that ROS 2 makes of an action.

    Args:
        text: definition of the action, and below it those of types that it uses.
        name: of the type, `package/action/Name_FeedbackMessage` or another part.
        wire: encoding.
    """
    package, _, part = name.replace("/action/", "/msg/").partition("/msg/")
    action, kind = next(
        ((part.removesuffix(f"_{kind}"), kind) for kind in _ACTION_PARTS if part.endswith(f"_{kind}")), ("", "")
    )
    own, separator, used = text.partition(_SEPARATOR)
    sections = _DIVIDER.split(own)
    if not action or len(sections) != 3:
        raise ValueError(f"the definition of {name} cannot be parsed (it is no goal, result and feedback of an action)")
    types = {
        f"{action}_{role}": section for role, section in zip(("Goal", "Result", "Feedback"), sections, strict=True)
    }
    types |= {
        f"{action}_{other}": layout.format(package=package, action=action) for other, layout in _ACTION_PARTS.items()
    }
    main = types.pop(f"{action}_{kind}")
    whole = main + "".join(f"{_SEPARATOR}MSG: {package}/{other}\n{layout}\n" for other, layout in types.items())
    return decoder_by(Definition(whole + separator + used), f"{package}/msg/{part}", wire)


def _standard(name: str, wire: str) -> Decode:
    """Return a decoder by the standard definition of a type.

    Raises:
        ValueError: there is none.
    """
    if name in OLDER_TYPES:
        return _newest_that_fits(
            [decoder_by(Definition(texts[name]), name, wire) for texts in (STANDARD_TYPES, OLDER_TYPES)]
        )
    if name in STANDARD_TYPES:
        return decoder_by(Definition(STANDARD_TYPES[name]), name, wire)
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if wire == ROS1 else Stores.LATEST)
    if name not in store.fielddefs:
        what = f"the definition of {name}" if name else "any type"
        raise ValueError(f"{what} is not in the recording, and it is no standard one")
    decode = store.deserialize_ros1 if wire == ROS1 else store.deserialize_cdr
    return lambda raw: decode(raw, name)


def _newest_that_fits(decoders: list[Decode]) -> Decode:
    def decode(raw: bytes) -> Any:  # noqa: ANN401 - a generated message class
        *newer, oldest = decoders
        for decoder in newer:
            try:
                return decoder(raw)
            except Exception:  # noqa: BLE001, S112 - a decoder of foreign bytes fails in ways of its own
                continue
        return oldest(raw)

    return decode
