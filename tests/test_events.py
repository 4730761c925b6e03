"""Events and their flat rows."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from event_strategies import EVENTS
from hypothesis import given

from hrclog.errors import InvalidEventError
from hrclog.event_rows import check_row, from_row, parse_details, to_row
from hrclog.events import (
    COLUMNS,
    EVENT_CLASSES,
    TASK_KINDS,
    Event,
    Heartbeat,
    PlanChanged,
    RunEnded,
    RunStarted,
    SafetyStateChanged,
    TaskEnded,
    TaskPaused,
    TaskStarted,
    UnknownEvent,
)

STARTED = TaskStarted(time_ns=1, agent="robot", task="pick", execution_id="e")
ENDED = TaskEnded(time_ns=2, agent="robot", task="pick", execution_id="e")


@given(EVENTS)
def test_a_row_gives_its_event_back(event: Event) -> None:
    assert from_row(to_row(event)) == event


@given(EVENTS)
def test_a_row_has_all_columns_and_no_others(event: Event) -> None:
    assert tuple(to_row(event)) == COLUMNS


@given(EVENTS)
def test_every_drawn_event_may_be_written(event: Event) -> None:
    check_row(to_row(event))


@pytest.mark.parametrize("kind", EVENT_CLASSES)
def test_every_kind_is_past_tense_and_names_its_class(kind: str) -> None:
    cls = EVENT_CLASSES[kind]
    assert cls.kind == kind
    assert "".join(word.title() for word in kind.split("_")) == cls.__name__


def test_the_task_kinds_are_those_of_executions() -> None:
    assert TASK_KINDS == ("task_dispatched", "task_started", "task_ended", "task_paused", "task_resumed")


def test_an_unknown_kind_keeps_all_its_columns() -> None:
    row = to_row(STARTED) | {"kind": "task_teleported", "zone": "Mars", "time_ns": 7, "seq": 3, "run_id": "r"}
    event = from_row(row)
    assert isinstance(event, UnknownEvent)
    assert (event.time_ns, event.seq, event.run_id) == (7, 3, "r")
    assert to_row(event) == row


def test_columns_that_are_missing_count_as_unset_and_further_ones_are_ignored() -> None:
    row = {"kind": "task_started", "time_ns": 1, "agent": "robot", "task": "pick", "execution_id": "e", "colour": "red"}
    assert from_row(row) == STARTED


@pytest.mark.parametrize("plan", [{}, [], "", 0, False])
def test_a_plan_that_is_empty_is_not_the_same_as_none(plan: object) -> None:
    assert from_row(to_row(PlanChanged(time_ns=1, plan=plan))).plan == plan  # type: ignore[attr-defined]  # a PlanChanged


def test_details_may_not_name_a_field_of_the_event() -> None:
    with pytest.raises(InvalidEventError, match=r"'seed'.*own field"):
        to_row(RunStarted(time_ns=1, details={"seed": 3}))


def _nested(depth: int) -> list[Any]:
    value: list[Any] = []
    for _ in range(depth):
        value = [value]
    return value


@pytest.mark.parametrize(
    "details", [{"x": float("nan")}, {"x": float("inf")}, {"x": object()}, {1: 0, "a": 0}, {"x": _nested(100_000)}]
)
def test_details_that_json_cannot_hold_are_refused(details: dict[Any, Any]) -> None:
    with pytest.raises(InvalidEventError, match="heartbeat: details cannot be written as JSON"):
        to_row(Heartbeat(time_ns=1, details=details))


@pytest.mark.parametrize("text", ["{", "[1]", "3", '"x"', "null", "{'a': 1}", "[" * 100_000])
def test_details_that_are_no_json_object_are_refused(text: str) -> None:
    with pytest.raises(InvalidEventError, match="task_ended: details are"):
        parse_details(text, "task_ended")


def test_empty_details_are_an_empty_object() -> None:
    assert parse_details("") == {}


@pytest.mark.parametrize(
    ("event", "message"),
    [
        (replace(STARTED, agent=""), "agent is empty"),
        (replace(STARTED, task=""), "task is empty"),
        (replace(STARTED, execution_id=""), "execution_id is empty"),
        (replace(ENDED, outcome="aborted"), "outcome is 'aborted', expected one of succeeded, failed, canceled"),
        (replace(ENDED, outcome="unknown"), "outcome is 'unknown'"),
        (RunEnded(time_ns=1, outcome=""), "outcome is ''"),
        (
            TaskPaused(time_ns=1, agent="a", task="t", execution_id="e", cause="lunch"),
            "cause is 'lunch', expected one of safety, operator, dependency",
        ),
        (SafetyStateChanged(time_ns=1, speed_scale=-0.1), "speed_scale is -0.1"),
        (SafetyStateChanged(time_ns=1, speed_scale=float("nan")), "speed_scale is nan"),
        (SafetyStateChanged(time_ns=1, speed_scale=float("inf")), "speed_scale is inf"),
        (Heartbeat(time_ns=None), "time_ns is None"),  # type: ignore[arg-type]  # the wrong type is the point
    ],
)
def test_what_the_vocabulary_forbids_is_named(event: Event, message: str) -> None:
    with pytest.raises(InvalidEventError, match=message):
        check_row(to_row(event))
