"""Events as flat rows, the columns of `hrclog_msgs/msg/TaskEvent`; what has no column goes into the JSON `details`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import MISSING, Field, fields
from typing import Any, Final

from hrclog.errors import InvalidEventError
from hrclog.events import (
    COLUMNS,
    EVENT_CLASSES,
    EVENT_VERSION,
    FLOAT_COLUMNS,
    INT_COLUMNS,
    LATEST_NS,
    STRING_COLUMNS,
    TASK_KINDS,
    Cause,
    Event,
    Outcome,
    Role,
    UnknownEvent,
)
from hrclog.json_text import parse_json

_EMPTY_ROW: Final[dict[str, Any]] = (
    {"schema_version": EVENT_VERSION, "attempt": 0, "seq": 0}
    | dict.fromkeys((*INT_COLUMNS, *FLOAT_COLUMNS))
    | dict.fromkeys(STRING_COLUMNS, "")
)


def _default(spec: Field[Any]) -> Any:  # noqa: ANN401 - of the field's type
    return spec.default if spec.default_factory is MISSING else spec.default_factory()


_FLAT_FIELDS: Final = {
    cls: tuple(f.name for f in fields(cls) if f.name in _EMPTY_ROW and f.name != "details")
    for cls in EVENT_CLASSES.values()
}
_DETAIL_DEFAULTS: Final[dict[type[Event], dict[str, Any]]] = {
    cls: {f.name: _default(f) for f in fields(cls) if f.name not in _EMPTY_ROW} for cls in EVENT_CLASSES.values()
}
_OUTCOMES: Final = tuple(outcome.value for outcome in Outcome)
_CAUSES: Final = tuple(cause.value for cause in Cause)
_ROLES: Final = tuple(role.value for role in Role)


def to_row(event: Event) -> dict[str, Any]:
    """Return the flat columns of an event.

    Raises:
        InvalidEventError: `details` cannot be written as JSON, or name what is a field of the event.
    """
    if isinstance(event, UnknownEvent):
        return _EMPTY_ROW | dict(event.row)
    cls = type(event)
    row = _EMPTY_ROW.copy()
    row["kind"] = event.kind
    for name in _FLAT_FIELDS[cls]:
        row[name] = getattr(event, name)
    details = dict(event.details)
    for name, default in _DETAIL_DEFAULTS[cls].items():
        if name in details:
            raise InvalidEventError(f"{event.kind}: details name {name!r}, expected it in the event's own field")
        value = getattr(event, name)
        if value != default:
            details[name] = value
    if details:
        row["details"] = _to_json(event.kind, details)
    return row


def from_row(row: Mapping[str, Any]) -> Event:
    """Return the typed event of a flat row; the inverse of `to_row`.

    Args:
        row: columns of `COLUMNS`; missing ones count as unset, further ones are ignored.

    Raises:
        InvalidEventError: `details` is not a JSON object.
    """
    kind = row["kind"]
    cls = EVENT_CLASSES.get(kind)
    if cls is None:
        return UnknownEvent(
            time_ns=row["time_ns"],
            run_id=row.get("run_id", ""),
            seq=row.get("seq", 0),
            row={name: row[name] for name in COLUMNS if name in row},
        )
    details = parse_details(row.get("details", ""), kind)
    values: dict[str, Any] = {name: row[name] for name in _FLAT_FIELDS[cls] if name in row}
    for name, default in _DETAIL_DEFAULTS[cls].items():
        if name in details:
            value = details.pop(name)
            values[name] = tuple(value) if default == () and isinstance(value, list) else value
    return cls(**values, details=details)


def parse_details(text: str, kind: str = "event") -> dict[str, Any]:
    """Return the JSON object of a `details` text, {} for "".

    Raises:
        InvalidEventError: the text is not a JSON object.
    """
    if not text:
        return {}
    try:
        details = parse_json(text)
        json.dumps(details, ensure_ascii=False).encode()  # an escaped half of a surrogate pair is no text
    except ValueError as error:
        raise InvalidEventError(f"{kind}: details are not JSON ({error}): {text[:80]!r}") from error
    if not isinstance(details, dict):
        raise InvalidEventError(f"{kind}: details are {type(details).__name__}, expected a JSON object: {text[:80]!r}")
    return details


def readable_details(text: str) -> dict[str, Any]:
    """Return the JSON object of a `details` text, {} where it is none: the projection of intervals reports those."""
    try:
        return parse_details(text)
    except InvalidEventError:
        return {}


def check_row(row: Mapping[str, Any], *, may_lack_outcome: bool = False) -> None:
    """Raise if a row that is about to be written says something that the vocabulary forbids.

    Args:
        row: the flat columns.
        may_lack_outcome: whether the end of a task may tell no outcome.

    Raises:
        InvalidEventError: names the field, what was found and what is allowed.
    """
    kind = row["kind"]
    _check_instants(row)
    if kind in TASK_KINDS:
        for name in ("agent", "task", "execution_id"):
            if not row[name].strip():
                raise InvalidEventError(f"{kind}: {name} is empty, expected a name")
        _check_word(row, "role", _ROLES)
    is_unset = may_lack_outcome and kind == "task_ended" and not row["outcome"]
    if kind in ("task_ended", "run_ended") and not is_unset:
        _check_word(row, "outcome", _OUTCOMES)
    if kind == "task_paused":
        _check_word(row, "cause", _CAUSES)
    scale = row["speed_scale"]
    if scale is not None and not (isinstance(scale, int | float) and 0.0 <= scale <= 1.0):
        raise InvalidEventError(
            f"{kind}: speed_scale is {scale!r}, expected a number from 0 (stopped) to 1 (full speed)"
        )


def _check_instants(row: Mapping[str, Any]) -> None:
    for name in INT_COLUMNS:
        value = row[name]
        if value is None and name != "time_ns":
            continue
        lowest = 0 if name == "time_ns" else -LATEST_NS
        if not isinstance(value, int) or isinstance(value, bool) or not lowest <= value <= LATEST_NS:
            value_text = f"{row['kind']}: {name} is {value!r} ({type(value).__name__})"
            raise InvalidEventError(f"{value_text}, expected whole nanoseconds since 1970 from {lowest} to {LATEST_NS}")


def _check_word(row: Mapping[str, Any], name: str, words: tuple[str, ...]) -> None:
    if row[name] not in words:
        raise InvalidEventError(f"{row['kind']}: {name} is {row[name]!r}, expected one of {', '.join(words)}")


def _to_json(kind: str, details: Mapping[str, Any]) -> str:
    try:
        return json.dumps(details, ensure_ascii=False, separators=(",", ":"), sort_keys=True, allow_nan=False)
    except (TypeError, ValueError, RecursionError) as error:
        raise InvalidEventError(f"{kind}: details cannot be written as JSON ({error})") from error
