"""What one JSON line of another program says of a run: how it begins, or an event; samples are in `sample_lines`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

from hrclog.errors import InvalidEventError
from hrclog.event_rows import check_row, from_row, parse_details, to_row
from hrclog.events import COLUMNS, EVENT_CLASSES, TASK_KINDS, Event, Outcome, Role, RunStarted, TaskFact
from hrclog.ids import new_id
from hrclog.log.messages.json_rows import row_from_object, short
from hrclog.recorders.line_fields import RUN_FACTS, check_fields, instant_of
from hrclog.recorders.sample_lines import SAMPLE_KINDS, is_sample, sample_of
from hrclog.recorders.task_handle import instant
from hrclog.wording import counted

BEGINNINGS: Final = ("task_dispatched", "task_started")
"""Kinds of the first event of an execution."""

_START_FIELDS: Final = (*COLUMNS, *RUN_FACTS)


def run_facts(value: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of a recorder that a `run_started` states; the name is `run`.

    Raises:
        InvalidEventError: a field is unknown or has the wrong type.
    """
    check_fields(value, _START_FIELDS, "run_started")
    row = row_from_object(value)
    details = parse_details(row["details"], RunStarted.kind)
    details.pop("segment", None)  # the recorder counts its own
    from_details = {name: details.pop(name) for name in RUN_FACTS if name in details}
    stated = {name: value[name] for name in RUN_FACTS if value.get(name) is not None}
    facts = {name: fact for name, fact in (from_details | stated).items() if fact is not None}
    facts["run"] = facts.pop("name", "")
    return facts | start_fact(value) | ({"details": details} if details else {})


def start_fact(value: Mapping[str, Any]) -> dict[str, Any]:
    """Return when a run began that begins with a line, if the line has an instant.

    Raises:
        InvalidEventError: it is no instant.
    """
    time_ns = instant_of(RunStarted.kind, value)
    return {} if time_ns is None else {"time_ns": time_ns}


def event_of(value: Mapping[str, Any], open_executions: Callable[[], Iterable[TaskFact]]) -> Event:
    """Return the event of a line.

    Args:
        value: the JSON object of the line.
        open_executions: asked for them where an event names no `execution_id`: it means the one of its agent and task.

    Raises:
        InvalidEventError: the line is no event.
    """
    row = _event_row(value)
    if row["kind"] in TASK_KINDS and not row["execution_id"]:
        row["execution_id"] = _execution_id(row, open_executions())
    return from_row(row)


def check_first(value: Mapping[str, Any]) -> None:
    """Raise if a line cannot be recorded, whatever came before it.

    Raises:
        InvalidEventError: says why.
    """
    if is_sample(value):
        sample_of(value)
        return
    row = _event_row(value)
    times = {"time_ns": max(row["time_ns"], 0)} if value.get("time_ns") is None else {}
    check_row(to_row(from_row(row | times | {"execution_id": row["execution_id"] or "?"})))


def _event_row(value: Mapping[str, Any]) -> dict[str, Any]:
    """Return the flat row of an event with its defaults; a task event may lack its `execution_id`."""
    check_fields(value, COLUMNS, "TaskEvent")
    row = row_from_object(value)
    row["time_ns"] = instant(row["time_ns"])
    row["seq"] = 0
    row["role"] = row["role"] or Role.PRIMARY.value
    if row["kind"] in ("task_ended", "run_ended"):
        row["outcome"] = row["outcome"] or Outcome.SUCCEEDED.value
    if row["kind"] not in EVENT_CLASSES:
        expected = f"one of the vocabulary (see docs/events.md), or {', '.join(SAMPLE_KINDS)}"
        raise InvalidEventError(f"kind is {short(row['kind'])}, expected {expected}")
    return row


def _execution_id(row: Mapping[str, Any], open_executions: Iterable[TaskFact]) -> str:
    """Return the execution id for a task event that has none."""
    if row["kind"] in BEGINNINGS:
        return new_id()
    open_ids = [fact.execution_id for fact in open_executions if (fact.agent, fact.task) == (row["agent"], row["task"])]
    if len(open_ids) == 1:
        return open_ids[0]
    raise InvalidEventError(
        f"{row['kind']} of {row['agent']!r}, {row['task']!r} names no execution_id: "
        f"found {counted(len(open_ids), 'open execution')} of that task, expected one"
    )
