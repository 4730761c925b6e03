"""Other people's messages: by the definition beside them, whatever state it is in, or by the standard one."""

from __future__ import annotations

import pytest
import ros_bags as bags
from hypothesis import given
from hypothesis import strategies as st
from mcap.records import Channel, Schema

from hrclog.log.messages.foreign import Decoder, decoder_of
from hrclog.log.messages.standard_types import OLDER_TYPES, STANDARD_TYPES

T = 1_700_000_000_000_000_000
SENT = [
    bags.status_array(T, "/a", [("g", T, 2)]),
    *bags.send_goal(T, "/a", "g", "weld", 3),
    *bags.get_result(T, "/a", "g", 4, "fine", 3),
    bags.feedback(T, "/a", "g", 0.5),
]


def decoder(kind: str, encoding: str, text: str, wire: str = "cdr") -> Decoder:
    return decoder_of(Channel(1, "/t", wire, {}, 1), Schema(id=1, name=kind, encoding=encoding, data=text.encode()))


@pytest.mark.parametrize("style", ["kilted", "jazzy", "none"])
@pytest.mark.parametrize("sent", SENT, ids=lambda sent: sent.topic.rsplit("/_action/", 1)[-1])
def test_messages_of_actions_tell_ids_and_states_whatever_is_stored_beside_them(sent: bags.Sent, style: str) -> None:
    message = decoder(sent.kind, *bags.definition_of(sent.kind, style)).decode(sent.data)
    whole = bags.ROS2.deserialize_cdr(sent.data, sent.kind.replace("/action/", "/msg/"))
    if isinstance(message, dict):
        assert style != "kilted"
        assert known(message) == known(whole)
    else:
        assert str(message).replace("__action__", "__msg__") == str(whole)


def known(message: object) -> dict[str, object]:
    """Return what the head of a message of an action tells."""
    get = message.get if isinstance(message, dict) else lambda name: getattr(message, name, None)
    if get("goal_id") is not None:
        return {"goal": raw_id(get("goal_id"))}
    parts = [part for name in ("request", "response") for part in get(name)]
    found: dict[str, object] = {}
    for part in parts:
        names = ("goal_id", "status", "accepted")
        fields = part if isinstance(part, dict) else {name: getattr(part, name, None) for name in names}
        if fields.get("goal_id") is not None:
            found["goal"] = raw_id(fields["goal_id"])
        found |= {name: int(fields[name]) for name in names[1:] if fields.get(name) is not None}
    return found


def raw_id(value: object) -> bytes:
    return value if isinstance(value, bytes) else bytes(value.uuid)  # type: ignore[attr-defined]  # a message class made at run time


@given(st.binary(max_size=70), st.sampled_from([sent.kind for sent in SENT if "/action/" in sent.kind]))
def test_noise_is_a_value_error_or_a_message(data: bytes, kind: str) -> None:
    decode = decoder(kind, "unknown", "").decode
    try:
        message = decode(data)
    except ValueError:
        return
    assert isinstance(message, dict)


@pytest.mark.parametrize(
    ("kind", "encoding", "text", "problem"),
    [
        ("a/msg/B", "ros2msg", "", "is not in the recording"),
        ("", "", "", "any type is not in the recording"),
        ("a/msg/B", "ros2msg", "?!", "cannot be parsed"),
        ("a/msg/B", "ros2msg", "string[1000000000] x", "arrays of"),
        ("a/msg/B", "ros2msg", "int8 x\n" * 20_000, "characters"),
        ("a/action/B_SendGoal_Event", "ros2msg", "ACTION: a/action/B\nint8 x\n", "no goal, result and feedback"),
        ("a/action/B_Other", "ros2msg", "ACTION: a/action/B\n---\n---\n", "no goal, result and feedback"),
    ],
)
def test_what_cannot_be_decoded_says_why(kind: str, encoding: str, text: str, problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        decoder(kind, encoding, text)
    with pytest.raises(ValueError, match="encoded as 'protobuf'"):
        decoder(kind, encoding, text, "protobuf")


@pytest.mark.parametrize("kind", sorted(STANDARD_TYPES))
def test_standard_types_can_be_decoded_and_are_told(kind: str) -> None:
    assert decoder(kind, "", "").assumed == kind


def test_a_log_of_nav2_before_jazzy_has_no_uid() -> None:
    sent = bags.tree_log(T, [(T, "Pick", "IDLE", "RUNNING")])
    kind = sent.kind
    assert [change.uid for change in decoder(kind, "", "").decode(sent.data).event_log] == [4]
    older = decoder(kind, "ros2msg", OLDER_TYPES[kind])
    assert not hasattr(older.decode(shorter(sent)).event_log[0], "uid")
    [change] = decoder(kind, "", "").decode(shorter(sent)).event_log
    assert (change.node_name, change.current_status) == ("Pick", "RUNNING")
    long = bags.tree_log(T, [(T, "Pic", "IDLE", "RUNNING")])  # without padding behind the name
    assert not hasattr(decoder(kind, "", "").decode(shorter(long, b"Pic\0")).event_log[0], "uid")


def shorter(sent: bags.Sent, name: bytes = b"Pick\0") -> bytes:
    """Return a log of one change without its uid, which stands behind the node's name and padding."""
    at = sent.data.index(name) + len(name)
    uid_at = at + -(at - 4) % 2
    rest_at = uid_at + 2
    rest_at += -(rest_at - 4) % 4
    head = sent.data[:at]
    return head + bytes(-(len(head) - 4) % 4) + sent.data[rest_at:]


def test_messages_of_ros_1_and_json() -> None:
    sent = bags.ros1_status(T, T, "/a", [("g", 1)])
    assert decoder(sent.kind, "", "", "ros1").decode(sent.data).status_list[0].goal_id.id == "g"
    assert decoder("x", "jsonschema", "{}", "json").decode(b'{"a": 1}') == {"a": 1}
