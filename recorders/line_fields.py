"""What the JSON lines of another program have in common: which fields they may have, and how values are checked."""

from __future__ import annotations

import difflib
import math
import sys
from collections.abc import Mapping, Sequence
from typing import Any, Final

from hrclog.errors import InvalidEventError
from hrclog.events import LATEST_NS
from hrclog.log.messages.json_rows import row_from_object, short

_LONGEST: Final = 80  # characters of a name that similar ones are sought for
_LARGEST: Final = int(sys.float_info.max)


def check_fields(value: Mapping[str, Any], known_names: Sequence[str], owner: str, otherwise: str) -> None:
    """Raise if a line has a field that its kind does not have: a misspelt `outcome` would be a success.

    Args:
        value: the JSON object of the line.
        known_names: of fields.
        owner: what has these fields.
        otherwise: what to do where no name is similar.

    Raises:
        InvalidEventError: names the field.
    """
    for name in value:
        if name not in known_names:
            similar_names = difflib.get_close_matches(name[:_LONGEST].lower(), known_names, 1)
            hint = f"did you mean {similar_names[0]!r}?" if similar_names else otherwise
            raise InvalidEventError(f"found the unknown field {short(name)}, expected those of {owner}; {hint}")


def text_of(kind: str, field: str, value: object) -> str:
    """Return a text that is not empty.

    Raises:
        InvalidEventError: it is none, or no valid Unicode.
    """
    text = row_from_object({"kind": kind, "reason": value})["reason"] if isinstance(value, str) else ""
    if not text.strip():
        raise InvalidEventError(f"{kind}: {field} is {short(value)}, expected a text that is not empty")
    return str(text)


def number_of(kind: str, what: str, value: object) -> float:
    """Return a number.

    Raises:
        InvalidEventError: it is none.
    """
    is_too_large = isinstance(value, int) and abs(value) > _LARGEST
    if isinstance(value, int | float) and not isinstance(value, bool) and not is_too_large:
        return float(value)
    raise InvalidEventError(f"{kind}: {what} is {short(value)}, expected a number of 64 bits")


def finite_of(kind: str, what: str, value: object) -> float:
    """Return a number that is neither NaN nor infinite.

    Raises:
        InvalidEventError: it is none.
    """
    number = number_of(kind, what, value)
    if not math.isfinite(number):
        raise InvalidEventError(f"{kind}: {what} is {number}, expected a finite number; leave out what is not known")
    return number


def instant_of(kind: str, value: Mapping[str, Any]) -> int | None:
    """Return the `time_ns` of a line, None where it has none.

    Raises:
        InvalidEventError: it is no instant.
    """
    if value.get("time_ns") is None:
        return None
    time_ns = int(row_from_object({"kind": kind, "time_ns": value["time_ns"]})["time_ns"])
    if not 0 <= time_ns <= LATEST_NS:
        text = f"{kind}: time_ns is {time_ns}, expected whole nanoseconds since 1970 from 0 to {LATEST_NS}"
        raise InvalidEventError(text)
    return time_ns
