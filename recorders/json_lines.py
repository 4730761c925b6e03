"""What one JSON line of another program says: how a run begins, an event, or a sample of signals."""

from __future__ import annotations

import difflib
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final

from hrclog.errors import InvalidEventError
from hrclog.event_rows import check_row, from_row, parse_details, to_row
from hrclog.events import COLUMNS, TASK_KINDS, Event, Outcome, Role, RunStarted, TaskFact, UnknownEvent
from hrclog.ids import new_id
from hrclog.log.messages.json_rows import row_from_object
from hrclog.recorders.task_handle import instant
from hrclog.units import NS_PER_S
from hrclog.wording import counted

SIGNAL: Final = "signal"
"""The kind of a line that is a sample, not an event."""

BEGINNINGS: Final = ("task_dispatched", "task_started")
"""Kinds of the first event of an execution."""

_RUN_FACTS: Final = ("name", "agents", "plan", "task_properties", "dispatch_mode", "software", "seed", "tags")
_SIGNAL_FIELDS: Final = ("kind", "name", "value", "values", "time_ns")
_UNITS: Final = (("seconds", 1), ("milliseconds", 10**3), ("microseconds", 10**6))
_FIRST_S: Final = 946_684_800  # 2000-01-01
_LONGEST: Final = 80  # characters of a strange value
_LARGEST: Final = int(sys.float_info.max)
_LAST_S: Final = 4_102_444_800  # 2100-01-01


@dataclass(frozen=True, slots=True)
class Sample:
    """Values of scalar signals at one instant, None for now."""

    values: Mapping[str, float]
    time_ns: int | None = None


def run_facts(value: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of a recorder that a `run_started` states; the name is `run`.

    Raises:
        InvalidEventError: a field is unknown or has the wrong type.
    """
    _check_fields(value, (*COLUMNS, *_RUN_FACTS))
    row = row_from_object(value)
    details = parse_details(row["details"], RunStarted.kind)
    details.pop("segment", None)  # the recorder counts its own
    from_details = {name: details.pop(name) for name in _RUN_FACTS if name in details}
    stated = {name: value[name] for name in _RUN_FACTS if value.get(name) is not None}
    facts = {name: fact for name, fact in (from_details | stated).items() if fact is not None}
    facts["run"] = facts.pop("name", "")
    return facts | start_fact(value) | ({"details": details} if details else {})


def start_fact(value: Mapping[str, Any]) -> dict[str, Any]:
    """Return when a run began that begins with a line, if the line has an instant."""
    return {} if value.get("time_ns") is None else {"time_ns": int(value["time_ns"])}


def event_of(value: Mapping[str, Any], open_executions: Iterable[TaskFact]) -> Event:
    """Return the event of a line.

    Args:
        value: the JSON object of the line.
        open_executions: an event without `execution_id` means the one of its agent and task.

    Raises:
        InvalidEventError: the line is no event.
    """
    row = _event_row(value)
    if row["kind"] in TASK_KINDS and not row["execution_id"]:
        row["execution_id"] = _execution_id(row, open_executions)
    return from_row(row)


def sample_of(value: Mapping[str, Any]) -> Sample:
    """Return the sample of a line of kind `signal`: a `name` and a `value`, or `values` by their names.

    Raises:
        InvalidEventError: a field is missing, unknown or of the wrong type.
    """
    _check_fields(value, _SIGNAL_FIELDS)
    has_one, has_several = "name" in value or "value" in value, "values" in value
    if has_one == has_several:
        fields = ", ".join(name for name in _SIGNAL_FIELDS if name in value)
        raise InvalidEventError(f"signal: found {fields}, expected name and value, or values by name")
    values = value["values"] if has_several else {value.get("name"): value.get("value")}
    if not isinstance(values, Mapping) or not values:
        raise InvalidEventError(f"signal: values is {values!r}, expected an object of numbers by name")
    row = row_from_object({"kind": SIGNAL, "time_ns": value.get("time_ns")})
    return Sample({_signal_name(name): _signal_value(name, values[name]) for name in values}, row["time_ns"])


def check_first(value: Mapping[str, Any]) -> None:
    """Raise if a line cannot be recorded, whatever came before it.

    Raises:
        InvalidEventError: says why.
    """
    if value.get("kind") == SIGNAL:
        sample_of(value)
        return
    row = _event_row(value)
    times = {"time_ns": max(row["time_ns"], 0)} if value.get("time_ns") is None else {}
    check_row(to_row(from_row(row | times | {"execution_id": row["execution_id"] or "?"})))


def check_unit(value: Mapping[str, Any], start_ns: int | None) -> None:
    """Raise if `time_ns` is plainly a number of seconds, milliseconds or microseconds since 1970.

    Args:
        value: the JSON object of a line.
        start_ns: when the run began, None if this line begins it. A run that began on a clock of its own, for example
            at 0, is not questioned.

    Raises:
        InvalidEventError: says which unit was found.
    """
    time = value.get("time_ns")
    if isinstance(time, bool) or not isinstance(time, int | float):
        return
    if start_ns is not None and start_ns < _FIRST_S * NS_PER_S:
        return
    for unit, per_second in _UNITS:
        if _FIRST_S * per_second <= time < _LAST_S * per_second:
            day = datetime.fromtimestamp(time / per_second, UTC).date()
            factor = NS_PER_S // per_second
            raise InvalidEventError(
                f"time_ns is {time}: found {unit} since 1970 ({day}), expected nanoseconds; multiply by {factor}, or "
                "begin a run on a clock of its own with a run_started at time_ns 0"
            )


def _event_row(value: Mapping[str, Any]) -> dict[str, Any]:
    """Return the flat row of an event with its defaults; a task event may lack its `execution_id`."""
    _check_fields(value, COLUMNS)
    row = row_from_object(value)
    row["time_ns"] = instant(row["time_ns"])
    row["seq"] = 0
    row["role"] = row["role"] or Role.PRIMARY.value
    if row["kind"] in ("task_ended", "run_ended"):
        row["outcome"] = row["outcome"] or Outcome.SUCCEEDED.value
    if isinstance(from_row(row), UnknownEvent):
        expected = f"one of the vocabulary (see docs/events.md) or {SIGNAL}"
        raise InvalidEventError(f"kind is {row['kind']!r}, expected {expected}")
    return row


def _signal_name(name: object) -> str:
    text = row_from_object({"kind": SIGNAL, "reason": name})["reason"] if isinstance(name, str) else ""
    if not text.strip():
        raise InvalidEventError(f"signal: name is {name!r}, expected a name")
    return str(text)


def _signal_value(name: object, value: object) -> float:
    is_too_large = isinstance(value, int) and abs(value) > _LARGEST
    if isinstance(value, int | float) and not isinstance(value, bool) and not is_too_large:
        return float(value)
    raise InvalidEventError(f"signal: the value of {name!r} is {_short(value)}, expected a number of 64 bits")


def _short(value: object) -> str:
    """Return how a value is written, or that it is a large number: Python refuses to write the largest."""
    return "a larger number" if isinstance(value, int) and abs(value) > _LARGEST else repr(value)[:_LONGEST]


def _check_fields(value: Mapping[str, Any], known_names: tuple[str, ...]) -> None:
    for name in value:
        if name not in known_names:
            similar_names = difflib.get_close_matches(name.lower(), known_names, 1)
            owner = SIGNAL if known_names == _SIGNAL_FIELDS else "TaskEvent"
            otherwise = f"they are {', '.join(known_names)}" if owner == SIGNAL else "put further facts into details"
            hint = f"did you mean {similar_names[0]!r}?" if similar_names else otherwise
            raise InvalidEventError(f"found the unknown field {name!r}, expected those of {owner}; {hint}")


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
