"""TaskEvent as CDR: columns give rows back, rows events, and damaged messages are told apart."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import polars as pl
import pytest
from event_strategies import EVENTS
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from hrclog.errors import InvalidEventError
from hrclog.event_rows import from_row, to_row
from hrclog.events import COLUMNS, FLOAT_COLUMNS, INT_COLUMNS, STRING_COLUMNS, Event, Heartbeat
from hrclog.log.messages.message import DEFINITION, TYPE_NAME, decode_columns, encode_row
from hrclog.log.messages.message import EVENTS as COLUMN_TYPES

INT64 = st.integers(-(2**63) + 1, 2**63 - 1)
ROWS = st.fixed_dictionaries(
    {"schema_version": st.integers(0, 2**32 - 1), "attempt": st.integers(0, 2**32 - 1), "seq": INT64}
    | dict.fromkeys(INT_COLUMNS, st.none() | INT64)
    | dict.fromkeys(FLOAT_COLUMNS, st.none() | st.floats(allow_nan=False))
    | dict.fromkeys(STRING_COLUMNS, st.text(max_size=30))
)
EMPTY = to_row(Heartbeat(time_ns=1))


def _decode(messages: list[bytes], lead: bytes = b"") -> tuple[pl.DataFrame, list[bool]]:
    sizes = np.array([len(message) for message in messages], np.int64)
    ends = np.cumsum(sizes) + len(lead)
    frame, good = decode_columns(lead + b"".join(messages), ends - sizes, ends)
    return frame, good.tolist()


@pytest.mark.slow
@given(st.lists(ROWS, max_size=6), st.binary(max_size=9))
def test_columns_give_any_rows_back_wherever_they_lie_in_the_buffer(rows: list[dict[str, Any]], lead: bytes) -> None:
    frame, good = _decode([encode_row(row) for row in rows], lead)
    assert frame.select(COLUMNS).rows(named=True) == rows
    assert all(good)


@given(st.lists(EVENTS, min_size=1, max_size=6))
def test_columns_give_any_events_back(events: list[Event]) -> None:
    frame, _ = _decode([encode_row(to_row(event)) for event in events])
    assert [from_row(row) for row in frame.iter_rows(named=True)] == events


STORE = get_typestore(Stores.EMPTY)
STORE.register(get_types_from_msg(DEFINITION, TYPE_NAME))


@given(ROWS)
def test_another_cdr_decoder_reads_the_same_fields(row: dict[str, Any]) -> None:
    decoded: Any = STORE.deserialize_cdr(encode_row(row), TYPE_NAME)
    for name in COLUMNS:
        found = getattr(decoded, name)
        if row[name] is None:
            assert found == -(2**63) if name in INT_COLUMNS else math.isnan(found)
        else:
            assert found == row[name]


def test_columns_have_the_documented_types() -> None:
    for messages in ([], [encode_row(EMPTY)]):
        frame, _ = _decode(messages)
        assert dict(frame.select(COLUMNS).schema) == {name: COLUMN_TYPES[name] for name in COLUMNS}


@pytest.mark.parametrize(
    "text", ["", "\0", "a\0", "\0a", "a" * 11, "a" * 12, "a" * 13, "é" * 6, "é" * 7, "a\0" * 9, "🦾" * 50]
)
def test_a_text_survives_at_every_length_that_is_stored_differently(text: str) -> None:
    frame, _ = _decode([encode_row(EMPTY | dict.fromkeys(STRING_COLUMNS, text))] * 2)
    assert frame.select(STRING_COLUMNS).rows() == [(text,) * len(STRING_COLUMNS)] * 2


def test_a_nan_counts_as_unset_and_infinities_stay() -> None:
    row = EMPTY | {"path_length": math.nan, "planning_time_s": math.inf, "planned_duration_s": -math.inf}
    frame, _ = _decode([encode_row(row)])
    assert frame.select("path_length", "planning_time_s", "planned_duration_s").rows() == [(None, math.inf, -math.inf)]


@pytest.mark.slow
@given(st.lists(st.tuples(ROWS, st.none() | st.integers(0, 400)), min_size=1, max_size=5))
def test_a_message_that_is_cut_short_is_left_out_and_the_others_are_decoded(
    messages: list[tuple[dict[str, Any], int | None]],
) -> None:
    encoded = [encode_row(row) for row, _ in messages]
    cuts = [cut is not None and cut < _needed(data) for data, (_, cut) in zip(encoded, messages, strict=True)]
    frame, good = _decode([data[:cut] for data, (_, cut) in zip(encoded, messages, strict=True)])
    assert good == [not cut for cut in cuts]
    assert frame.select(COLUMNS).rows(named=True) == [
        row for (row, _), cut in zip(messages, cuts, strict=True) if not cut
    ]


def _needed(data: bytes) -> int:
    """Return how many bytes a message needs: the padding behind its last text may be missing."""
    return len(data.rstrip(b"\0")) + 1 if data.endswith(b"\0\0") else len(data)


@given(ROWS, st.data())
def test_bytes_that_are_flipped_never_break_the_decoder(row: dict[str, Any], data: st.DataObject) -> None:
    message = bytearray(encode_row(row))
    message[data.draw(st.integers(0, len(message) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    frame, good = _decode([encode_row(row), bytes(message), encode_row(row)])
    assert (good[0], good[2]) == (True, True)
    assert frame.select(COLUMNS).row(0, named=True) == row == frame.select(COLUMNS).row(-1, named=True)


def test_a_text_that_is_not_utf_8_is_left_out() -> None:
    good = encode_row(EMPTY | {"agent": "robot number one"})
    frame, mask = _decode([good, good.replace(b"robot number", b"robot\xffnumber"), good])
    assert mask == [True, False, True]
    assert frame["agent"].to_list() == ["robot number one"] * 2


def test_a_text_without_its_final_nul_is_read_in_full() -> None:
    message = encode_row(EMPTY | {"details": "{}"})
    short = message[: message.rindex(b"{}") - 4] + b"\2\0\0\0{}"
    assert _decode([short])[0]["details"].to_list() == ["{}"]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("attempt", -1),
        ("attempt", 2**32),
        ("seq", 2**63),
        ("time_ns", 1.5),
        ("time_ns", -(2**63) - 1),
        ("path_length", "long"),
        ("agent", "\ud800"),
        ("agent", None),
        ("agent", b"robot"),
    ],
)
def test_a_field_that_does_not_fit_is_refused(name: str, value: object) -> None:
    with pytest.raises(InvalidEventError, match="heartbeat: a field cannot be written"):
        encode_row(EMPTY | {name: value})
