"""What the JSON lines of another program have in common: which fields they may have, and how values are checked."""

from __future__ import annotations

import difflib
import math
import sys
from collections.abc import Collection, Mapping
from typing import Any, Final

from hrclog.errors import InvalidEventError
from hrclog.events import LATEST_NS
from hrclog.log.messages.json_rows import integer_column, short, text_column

RUN_FACTS: Final = ("name", "agents", "plan", "task_properties", "dispatch_mode", "software", "seed", "tags")
"""What `run_started` says of a run, beside the columns of an event."""

_LONGEST: Final = 80  # characters of a name that similar ones are sought for
_LARGEST: Final = int(sys.float_info.max)


def check_fields(value: Mapping[str, Any], known_names: Collection[str], owner: str) -> None:
    """Raise if a line has a field that its kind does not have: a misspelt `outcome` would be a success.

    Args:
        value: the JSON object of the line.
        known_names: of fields.
        owner: what has these fields.

    Raises:
        InvalidEventError: names the field.
    """
    for name in value:
        if name not in known_names:
            hint = _hint(name, known_names)
            raise InvalidEventError(f"found the unknown field {short(name)}, expected those of {owner}; {hint}")


def _hint(name: str, known_names: Collection[str]) -> str:
    """Return what to do with a field that is not known."""
    if name in RUN_FACTS:
        return "it belongs into the run_started of a run"
    similar_names = difflib.get_close_matches(name[:_LONGEST].lower(), known_names, 1)
    if similar_names:
        return f"did you mean {similar_names[0]!r}?"
    return "put further facts into details" if "details" in known_names else f"they are {', '.join(known_names)}"


def text_of(kind: str, field: str, value: object) -> str:
    """Return a text that is not empty.

    Raises:
        InvalidEventError: it is none, or no valid Unicode.
    """
    if not isinstance(value, str) or not value.strip():
        raise InvalidEventError(f"{kind}: {field} is {short(value)}, expected a text that is not empty")
    return text_column(field, value)


def number_of(kind: str, name: object, value: object) -> float:
    """Return the number of that name.

    Raises:
        InvalidEventError: it is none.
    """
    if isinstance(value, float):
        return value
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) <= _LARGEST:
        return float(value)
    raise InvalidEventError(f"{kind}: {short(name)} is {short(value)}, expected a number of 64 bits")


def finite_of(kind: str, name: object, value: object) -> float:
    """Return the number of that name, which is neither NaN nor infinite.

    Raises:
        InvalidEventError: it is none.
    """
    number = number_of(kind, name, value)
    if not math.isfinite(number):
        text = f"{kind}: {short(name)} is {number}, expected a finite number"
        raise InvalidEventError(f"{text}; leave out what is not known")
    return number


def instant_of(kind: str, value: Mapping[str, Any]) -> int | None:
    """Return the `time_ns` of a line, None where it has none.

    Raises:
        InvalidEventError: it is no instant.
    """
    if value.get("time_ns") is None:
        return None
    time_ns = integer_column("time_ns", value["time_ns"])
    if not 0 <= time_ns <= LATEST_NS:
        text = f"{kind}: time_ns is {time_ns}, expected whole nanoseconds since 1970 from 0 to {LATEST_NS}"
        raise InvalidEventError(text)
    return time_ns
