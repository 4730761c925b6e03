"""Layouts and encodings other than ours give the same rows."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from event_strategies import EVENTS
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from hrclog.event_rows import to_row
from hrclog.events import COLUMNS, Event, Heartbeat, TaskStarted
from hrclog.log.logs import Logs
from hrclog.log.messages.message import DEFINITION, TYPE_NAME, encode_row
from hrclog.log.one_log import read_log

LINES = [line for line in DEFINITION.splitlines() if line.split("#")[0].strip()]
REVERSED = "\n".join(reversed(LINES))
EXTENDED = DEFINITION + "\nfloat64[] forces\nstring[<=4] witnesses\nint8 mood\n"
UNSET_TIME = TaskStarted(time_ns=-(2**63), agent="a", task="t", execution_id="e")


def write(
    path: Path,
    messages: list[bytes],
    definition: str = DEFINITION,
    encoding: str = "cdr",
    *,
    language: str = "ros2msg",
    name: str = TYPE_NAME,
    topic: str = "/hrc/events",
) -> Path:
    """Write messages as a foreign writer would: log time 1000 + i, publish time 2000 + i, sequence 50 + i."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema(name, language, definition.encode())
        channel = writer.register_channel(topic, encoding, schema)
        for i, message in enumerate(messages):
            writer.add_message(channel, 1000 + i, message, 2000 + i, 50 + i)
        writer.finish()
    return path


@cache
def store_of(definition: str) -> Typestore:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, TYPE_NAME))
    return store


def foreign(events: list[Event], definition: str, *, little_endian: bool = True, **further: object) -> list[bytes]:
    """Encode events with another library and layout."""
    store = store_of(definition)
    cls = store.types[TYPE_NAME]
    ours = [store_of(DEFINITION).deserialize_cdr(encode_row(to_row(event)), TYPE_NAME) for event in events]
    values = [{name: getattr(message, name) for name in COLUMNS} | further for message in ours]
    return [bytes(store.serialize_cdr(cls(**value), TYPE_NAME, little_endian=little_endian)) for value in values]


def expected(tmp_path: Path, events: list[Event]) -> pl.DataFrame:
    path = write(tmp_path / "ours.mcap", [encode_row(to_row(event)) for event in events])
    return read_log(path).events.drop("path").with_columns(run_id=pl.lit("r"))


def same(logs: Logs) -> pl.DataFrame:
    assert {diagnostic.code for diagnostic in logs.diagnostics} <= {"no_run_id"}
    return logs.events.drop("path").with_columns(run_id=pl.lit("r"))


SOME = st.lists(EVENTS, min_size=1, max_size=4)
few = settings(max_examples=30)


@few
@given(SOME)
def test_big_endian_messages_give_the_same_rows(tmp_path: Path, events: list[Event]) -> None:
    path = write(tmp_path / "big.mcap", foreign(events, DEFINITION, little_endian=False))
    assert same(read_log(path)).equals(expected(tmp_path, events))


@few
@given(SOME)
def test_fields_that_a_newer_version_added_at_the_end_are_passed_over(tmp_path: Path, events: list[Event]) -> None:
    messages = foreign(events, EXTENDED, forces=np.array([1.0, 2.0]), witnesses=["x"], mood=3)
    assert same(read_log(write(tmp_path / "new.mcap", messages, EXTENDED))).equals(expected(tmp_path, events))


@few
@given(SOME)
def test_fields_in_another_order_give_the_same_rows(tmp_path: Path, events: list[Event]) -> None:
    path = write(tmp_path / "reversed.mcap", foreign(events, REVERSED), REVERSED)
    assert same(read_log(path)).equals(expected(tmp_path, events))


@few
@given(SOME)
def test_json_objects_give_the_same_rows(tmp_path: Path, events: list[Event]) -> None:
    objects = [{name: value for name, value in to_row(event).items() if value not in ("", None)} for event in events]
    messages = [json.dumps(value, ensure_ascii=bool(i % 2)).encode() for i, value in enumerate(objects)]
    path = write(tmp_path / "json.mcap", messages, encoding="json")
    assert same(read_log(path)).equals(expected(tmp_path, events))


def test_comments_and_spaces_of_a_definition_do_not_matter(tmp_path: Path) -> None:
    definition = "# hello\n\n" + "\n".join(f"  {' '.join(line.split('#')[0].split())} # what" for line in LINES)
    messages = [encode_row(to_row(Heartbeat(time_ns=3)))]
    logs = read_log(write(tmp_path / "spaced.mcap", messages, definition))
    assert same(logs).equals(expected(tmp_path, [Heartbeat(time_ns=3)]))


@pytest.mark.parametrize("definition", [DEFINITION, REVERSED])
def test_an_event_without_a_time_happened_when_it_was_published(tmp_path: Path, definition: str) -> None:
    logs = read_log(write(tmp_path / "a.mcap", foreign([UNSET_TIME, UNSET_TIME], definition), definition))
    assert logs.events["time_ns"].to_list() == [2000, 2001]
    assert logs.events["log_time_ns"].to_list() == [1000, 1001]


def test_json_without_time_takes_that_of_the_message_and_no_number(tmp_path: Path) -> None:
    logs = read_log(write(tmp_path / "a.mcap", [b'{"kind":"heartbeat"}'] * 2, encoding="json"))
    assert logs.events.select("time_ns", "seq").rows() == [(2000, None), (2001, None)]


def test_events_of_several_topics_and_byte_orders_are_in_the_order_of_writing(tmp_path: Path) -> None:
    events: list[Event] = [TaskStarted(time_ns=9, agent=str(i), task="t", execution_id="e") for i in range(12)]
    messages = [foreign([event], DEFINITION, little_endian=i % 3 > 0)[0] for i, event in enumerate(events)]
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema(TYPE_NAME, "ros2msg", DEFINITION.encode())
        topics = [writer.register_channel(f"/{name}", "cdr", schema) for name in "ab"]
        for i, message in enumerate(messages):
            writer.add_message(topics[i % 5 > 2], 1000, message, 1000)
        writer.finish()
    assert read_log(tmp_path / "a.mcap").events["agent"].to_list() == [event.agent for event in events]  # type: ignore[attr-defined]  # all of them are events of tasks


def test_json_details_may_be_an_object_or_its_text(tmp_path: Path) -> None:
    messages = [b'{"kind":"heartbeat","details":{"a":[1]}}', b'{"kind":"heartbeat","details":"{\\"a\\": [1]}"}']
    logs = read_log(write(tmp_path / "a.mcap", messages, encoding="json"))
    assert logs.events["details"].to_list() == ['{"a": [1]}'] * 2


BAD_JSON = [
    "", "{", "[]", "3", "null", '"x"', "{}", '{"kind":3}', '{"kind":""}', '{"kind":"heartbeat","time_ns":"soon"}',
    '{"kind":"heartbeat","time_ns":1.5}', '{"kind":"heartbeat","time_ns":1e18}',
    '{"kind":"heartbeat","time_ns":1e999}', '{"kind":"heartbeat","time_ns":9223372036854775808}',
    '{"kind":"heartbeat","attempt":-1}', '{"kind":"heartbeat","attempt":true}', '{"kind":"heartbeat","agent":{}}',
    '{"kind":"heartbeat","agent":"\\ud800"}', '{"kind":"heartbeat","details":{"a":"\\udfff"}}',
    '{"kind":"heartbeat","details":[]}', '{"kind":"heartbeat","path_length":' + "9" * 400 + "}",
    '{"kind":"heartbeat","path_length":"far"}', "[" * 100_000, "\xff",
]  # fmt: skip


@pytest.mark.parametrize("text", BAD_JSON)
def test_a_json_message_that_is_no_event_is_reported_and_the_others_are_read(tmp_path: Path, text: str) -> None:
    good = b'{"kind":"heartbeat","run_id":"r"}'
    logs = read_log(write(tmp_path / "a.mcap", [good, text.encode("latin-1"), good], encoding="json"))
    assert logs.events.height == 2
    assert [diagnostic.code for diagnostic in logs.diagnostics] == ["undecodable_event"]


@pytest.mark.parametrize(
    "text", ['{"kind":"heartbeat","path_length":NaN}', '{"kind":"heartbeat","time_ns":2000.0,"x":1}']
)
def test_a_json_number_that_is_nan_or_whole_is_taken(tmp_path: Path, text: str) -> None:
    logs = read_log(write(tmp_path / "a.mcap", [text.encode()], encoding="json"))
    assert logs.events.select("time_ns", "path_length").rows() == [(2000, None)]


@pytest.mark.parametrize(
    ("definition", "encoding"), [(DEFINITION, "protobuf"), ("this is no definition", "cdr"), ("string data", "cdr")]
)
def test_an_event_channel_that_cannot_be_decoded_is_reported_once(
    tmp_path: Path, definition: str, encoding: str
) -> None:
    messages = [encode_row(to_row(Heartbeat(time_ns=3)))] * 5
    logs = read_log(write(tmp_path / "a.mcap", messages, definition, encoding))
    assert logs.events.is_empty()
    assert [diagnostic.code for diagnostic in logs.diagnostics] == ["undecodable_event"]
    assert "5 messages" in logs.diagnostics[0].message


def test_messages_that_fail_for_one_cause_share_a_diagnostic_whatever_their_values(tmp_path: Path) -> None:
    messages = [b'{"kind":%d}' % i for i in range(100)]
    logs = read_log(write(tmp_path / "a.mcap", messages, encoding="json"))
    assert [diagnostic.message for diagnostic in logs.diagnostics] == [
        "100 messages of /hrc/events cannot be decoded (kind is 0, expected a text), the first with log time 1000 ns"
    ]


def test_many_different_failures_share_a_few_diagnostics(tmp_path: Path) -> None:
    kinds = [f'{{"kind": {value}}}'.encode() for value in ("1", "[]", "{}", "true", '""')]
    fields = [f'{{"kind": "heartbeat", "{name}": [{i}]}}'.encode() for i, name in enumerate(COLUMNS[3:])]
    logs = read_log(write(tmp_path / "a.mcap", kinds + fields, encoding="json"))
    assert len(logs.diagnostics) == 11
    assert "for further reasons" in logs.diagnostics[-1].message


def test_failures_are_counted_over_the_whole_file_and_not_for_each_batch(tmp_path: Path) -> None:
    messages = [b'{"kind":"' + b"x" * 3_000_000] * 3
    logs = read_log(write(tmp_path / "a.mcap", messages, encoding="json"))
    assert [diagnostic.message[:10] for diagnostic in logs.diagnostics] == ["3 messages"]


def test_numbers_may_be_texts_and_names_in_camel_case_as_proto3_writes_them(tmp_path: Path) -> None:
    texts = {"kind": "task_ended", "time_ns": str(2**60 + 1), "seq": "7", "attempt": "2", "path_length": "0.5"}
    unset = {"plannedStartNs": str(-(2**63)), "speedScale": "NaN", "executionId": "e", "plannedEndNs": "-3"}
    logs = read_log(write(tmp_path / "a.mcap", [json.dumps(texts | unset).encode()], encoding="json"))
    names = ["time_ns", "seq", "attempt", "path_length", "planned_start_ns", "speed_scale", "execution_id"]
    assert logs.events.select(*names, "planned_end_ns").rows() == [(2**60 + 1, 7, 2, 0.5, None, None, "e", -3)]


def idl(lines: list[str]) -> str:
    kinds = {"uint32": "unsigned long", "int64": "long long", "float64": "double", "string": "string"}
    fields = [line.split("#")[0].split() for line in lines]
    struct = "".join(f"{kinds[kind]} {name}; " for kind, name in fields)
    return f"module hrclog_msgs {{ module msg {{ struct TaskEvent {{ {struct} }}; }}; }};"


@pytest.mark.parametrize(
    ("text", "layout"),
    [
        (idl(LINES), DEFINITION),
        (f"{'=' * 80}\nIDL: hrclog_msgs/msg/TaskEvent\n{idl(LINES)}", DEFINITION),
        (idl(LINES[::-1]), REVERSED),
    ],
)
def test_a_definition_may_be_idl(tmp_path: Path, text: str, layout: str) -> None:
    events: list[Event] = [Heartbeat(time_ns=3), TaskStarted(time_ns=4, agent="a", task="t", execution_id="e")]
    path = write(tmp_path / "idl.mcap", foreign(events, layout), text, language="ros2idl")
    assert same(read_log(path)).equals(expected(tmp_path, events))


@pytest.mark.parametrize("language", ["ros2msg", "ros2idl", "unknown", ""])
@pytest.mark.parametrize("definition", ["", " \n", "# not found"])
def test_an_empty_definition_of_our_type_is_ours_and_an_info_says_so(
    tmp_path: Path, definition: str, language: str
) -> None:
    if language == "ros2idl" and definition.strip():
        return
    messages = [encode_row(to_row(Heartbeat(time_ns=3, run_id="r")))]
    logs = read_log(write(tmp_path / "a.mcap", messages, definition, language=language))
    assert logs.events.height == 1
    assert [(found.code, found.severity) for found in logs.diagnostics] == [("assumed_definition", "info")]


@pytest.mark.parametrize("definition", ["int8 a\n" * 200_000, "string[1000000000] x\nint64 time_ns\n"])
def test_a_definition_that_asks_for_too_much_is_refused_and_the_file_is_read(tmp_path: Path, definition: str) -> None:
    logs = read_log(write(tmp_path / "a.mcap", [bytes(4000)] * 2, definition))
    assert [found.code for found in logs.diagnostics] == ["undecodable_event"]
    assert "2 messages" in logs.diagnostics[0].message


@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize("topic", ["/hrc/events", "/cell_1/hrc/events"])
def test_events_may_be_json_texts_in_a_string(tmp_path: Path, topic: str, *, big_endian: bool) -> None:
    store = get_typestore(Stores.LATEST)
    string = store.types["std_msgs/msg/String"]
    texts = [json.dumps({"kind": "heartbeat", "run_id": "r", "reason": "läuft", "seq": str(i)}) for i in range(3)]
    messages = [
        bytes(store.serialize_cdr(string(data=text), "std_msgs/msg/String", little_endian=not big_endian))
        for text in texts
    ]
    torn = messages[0][:-5]
    path = write(tmp_path / "a.mcap", [*messages, torn], "string data", name="std_msgs/msg/String", topic=topic)
    logs = read_log(path)
    assert logs.events.select("seq", "reason").rows() == [(i, "läuft") for i in range(3)]
    assert [found.code for found in logs.diagnostics] == ["undecodable_event"]


def test_a_string_on_another_topic_is_no_event(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", [b"\0\1\0\0\2\0\0\0a\0"], "string data", name="std_msgs/msg/String", topic="/x")
    assert [found.code for found in read_log(path).diagnostics] == ["no_events"]


@pytest.mark.parametrize("definition", ["int32 x\n", ""])
@pytest.mark.parametrize("encoding", ["cdr", "ros1", "protobuf"])
def test_another_type_on_our_topic_is_named_and_no_event(tmp_path: Path, definition: str, encoding: str) -> None:
    path = write(tmp_path / "a.mcap", [bytes(8)] * 3, definition, encoding, name="cell_msgs/msg/State")
    logs = read_log(path)
    assert [found.code for found in logs.diagnostics] == ["foreign_type", "no_events"]
    assert "/hrc/events carries cell_msgs/msg/State" in logs.diagnostics[0].message
    assert "/hrc/events (cell_msgs/msg/State, 3 messages)" in logs.diagnostics[1].message


@pytest.mark.parametrize("topic", ["/hrc/events", "/cell_2/hrc/events"])
def test_another_type_beside_our_events_costs_a_remark(tmp_path: Path, topic: str) -> None:
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        ours = writer.register_channel("/hrc/events", "json", 0)
        theirs = writer.register_channel(topic, "cdr", writer.register_schema("foo/msg/Bar", "ros2msg", b"int32 x"))
        for channel, data in ((ours, b'{"kind":"heartbeat","run_id":"r"}'), (theirs, bytes(8))):
            writer.add_message(channel, 5, data, 5)
        writer.finish()
    logs = read_log(tmp_path / "a.mcap")
    assert logs.events.height == 1
    assert [(found.code, found.severity) for found in logs.diagnostics] == [("foreign_type", "info")]


def test_our_definition_in_another_package_is_ours(tmp_path: Path) -> None:
    messages = [encode_row(to_row(Heartbeat(time_ns=3, run_id="r")))]
    for name, definition in (("cell_msgs/msg/Happening", DEFINITION), ("cell_msgs/msg/TaskEvent", "")):
        assert read_log(write(tmp_path / "a.mcap", messages, definition, name=name)).events.height == 1


def test_a_signal_topic_of_a_foreign_type_is_no_signal(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mcap", [bytes(12)], "int64 data", name="std_msgs/msg/Int64", topic="/hrc/signals/x")
    assert read_log(path, signals=True).signals.is_empty()
