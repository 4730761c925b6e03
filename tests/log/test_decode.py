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
from hrclog.log.message import DEFINITION, TYPE_NAME, encode_row
from hrclog.log.reader import Logs, read_log

LINES = [line for line in DEFINITION.splitlines() if line.split("#")[0].strip()]
REVERSED = "\n".join(reversed(LINES))
EXTENDED = DEFINITION + "\nfloat64[] forces\nstring[<=4] witnesses\nint8 mood\n"
UNSET_TIME = TaskStarted(time_ns=-(2**63), agent="a", task="t", execution_id="e")


def write(path: Path, messages: list[bytes], definition: str = DEFINITION, encoding: str = "cdr") -> Path:
    """Write messages as a foreign writer would: log time 1000 + i, publish time 2000 + i, sequence 50 + i."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema(TYPE_NAME, "ros2msg", definition.encode())
        channel = writer.register_channel("/hrc/events", encoding, schema)
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


def test_json_without_time_and_seq_takes_those_of_the_message(tmp_path: Path) -> None:
    logs = read_log(write(tmp_path / "a.mcap", [b'{"kind":"heartbeat"}'] * 2, encoding="json"))
    assert logs.events.select("time_ns", "seq").rows() == [(2000, 50), (2001, 51)]


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


def test_many_different_failures_share_a_few_diagnostics(tmp_path: Path) -> None:
    messages = [b'{"kind":%d}' % i for i in range(100)]
    logs = read_log(write(tmp_path / "a.mcap", messages, encoding="json"))
    assert len(logs.diagnostics) == 11
    assert logs.diagnostics[-1].message.startswith("90 messages cannot be decoded (for further reasons)")
