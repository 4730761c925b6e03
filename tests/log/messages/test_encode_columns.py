"""Columns of events are encoded as their rows are, and refused for the same reasons."""

from __future__ import annotations

import polars as pl
import pytest
from event_strategies import EVENTS, TASK_FACTS
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.errors import InvalidEventError
from hrclog.event_rows import check_row, to_row
from hrclog.events import COLUMNS, Event, TaskStarted
from hrclog.log.messages import message
from hrclog.log.messages.encode_columns import check_columns, encode_columns

SCHEMA = pl.Schema({name: message.EVENTS[name] for name in COLUMNS})


def frame(events: list[Event]) -> pl.DataFrame:
    return pl.DataFrame([to_row(event) for event in events], schema=SCHEMA)


@settings(max_examples=60)
@given(st.lists(EVENTS, max_size=5))
def test_columns_are_encoded_as_their_rows_are(events: list[Event]) -> None:
    assert list(encode_columns(frame(events))) == [message.encode_row(to_row(event)) for event in events]


def test_blocks_join_without_a_seam(monkeypatch: pytest.MonkeyPatch) -> None:
    events = frame([TaskStarted(time_ns=at, agent="r", task="t" * at, execution_id="e") for at in range(1, 8)])
    whole = list(encode_columns(events))
    monkeypatch.setattr("hrclog.log.messages.encode_columns._BLOCK", 3)
    assert list(encode_columns(events)) == whole


WRONG = {
    "agent": " \x1f", "task": "", "execution_id": "\t", "outcome": "fine", "role": "main", "time_ns": -1,
    "planned_start_ns": 2**62, "speed_scale": 1.5, "cause": "weather",
}  # fmt: skip


@settings(max_examples=60)
@given(st.lists(TASK_FACTS, min_size=1, max_size=4), st.sampled_from(sorted(WRONG)), st.integers(0, 3))
def test_columns_are_refused_as_the_first_bad_row_is(events: list[Event], name: str, at: int) -> None:
    rows = [to_row(event) for event in events]
    rows[at % len(rows)][name] = WRONG[name]
    told = None
    for row in rows:
        try:
            check_row(row, may_lack_outcome=True)
        except InvalidEventError as error:
            told = str(error)
            break
    columns = pl.DataFrame(rows, schema=SCHEMA)
    if told is None:
        check_columns(columns)
        return
    with pytest.raises(InvalidEventError) as raised:
        check_columns(columns)
    assert str(raised.value) == told
