"""Events given as JSON objects with the same field names as `TaskEvent`, checked field by field."""

from __future__ import annotations

import json
import re
import reprlib
import sys
from collections.abc import Mapping
from typing import Any, Final

from hrclog.errors import InvalidEventError
from hrclog.events import COLUMNS, EVENT_VERSION, FLOAT_COLUMNS, INT_COLUMNS, STRING_COLUMNS
from hrclog.json_text import parse_json

_COUNTERS: Final = ("schema_version", "attempt", "seq")
_DEFAULTS: Final[dict[str, Any]] = (
    {"schema_version": EVENT_VERSION, "attempt": 1, "seq": None}
    | dict.fromkeys((*INT_COLUMNS, *FLOAT_COLUMNS))
    | dict.fromkeys(STRING_COLUMNS, "")
)
_INTEGER: Final = re.compile(r"[+-]?[0-9]{1,19}")
_UNSET: Final = -(2**63)
_LARGEST: Final = int(sys.float_info.max)
_SHORT: Final = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 80


def _camel_case(name: str) -> str:
    first, *others = name.split("_")
    return first + "".join(word.capitalize() for word in others)


_OF_CAMEL_CASE: Final = {_camel_case(name): name for name in COLUMNS if "_" in name}
"""Column by the name that proto3 JSON gives it."""


def parse_object(text: str | bytes) -> dict[str, Any]:
    """Return the JSON object of a text.

    Raises:
        InvalidEventError: the text is not a JSON object.
    """
    try:
        value = parse_json(text)
    except ValueError as error:
        raise InvalidEventError(f"found no JSON ({error}), expected one JSON object per event") from error
    if not isinstance(value, dict):
        raise InvalidEventError(f"found a JSON {type(value).__name__}, expected one object per event")
    return value


def short(value: object) -> str:
    """Return how a value is written, shortened: a line may hold megabytes, or lists in lists."""
    is_too_large = isinstance(value, int) and abs(value) > _LARGEST
    return "a larger number" if is_too_large else _SHORT.repr(value)


def row_from_proto3(value: Mapping[str, Any]) -> dict[str, Any]:
    """Return the flat event row of a JSON object whose numbers may be texts and whose names may be in camelCase.

    That is how proto3 JSON writes messages: numbers of 64 bits and NaN are texts there.

    Raises:
        InvalidEventError: as `row_from_object`.
    """
    if not _OF_CAMEL_CASE.keys().isdisjoint(value):
        value = {_OF_CAMEL_CASE.get(name, name): field_value for name, field_value in value.items()}
    texts = [name for name in (*_COUNTERS, *INT_COLUMNS, *FLOAT_COLUMNS) if isinstance(value.get(name), str)]
    return row_from_object({**value, **{name: _number(name, value[name]) for name in texts}} if texts else value)


def _number(name: str, text: str) -> float | str | None:
    """Return the number that a text holds, None where it stands for unset, and the text itself if it is none."""
    if name not in FLOAT_COLUMNS:
        if not _INTEGER.fullmatch(text):
            return text
        number = int(text)
        return None if number == _UNSET else number
    try:
        value = float(text)
    except ValueError:
        return text
    return None if value != value else value  # noqa: PLR0124 - NaN


def row_from_object(value: Mapping[str, Any]) -> dict[str, Any]:
    """Return the flat event row of a JSON object; `seq` and `time_ns` stay None where it gives none.

    Further fields are ignored, as a newer writer may add some; `details` may be an object or its JSON text.

    Raises:
        InvalidEventError: a known field has the wrong type, or `kind` is missing.
    """
    row = _DEFAULTS.copy()
    for name, field_value in value.items():
        if name in _DEFAULTS and field_value is not None:
            row[name] = _column_value(name, field_value)
    if not row["kind"]:
        raise InvalidEventError("found an object without `kind`, expected for example task_started")
    return row


def _column_value(name: str, value: Any) -> Any:  # noqa: ANN401 - any JSON value in, the column's type out
    if name == "details" and isinstance(value, dict):
        value = json.dumps(value, ensure_ascii=False, sort_keys=True)
    if name in STRING_COLUMNS:
        return text_column(name, value)
    number = _number_column(name, value)
    return _float(name, number) if name in FLOAT_COLUMNS else _integer(name, number)


def _number_column(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InvalidEventError(f"{name} is {short(value)}, expected a number")
    return value


def integer_column(name: str, value: object) -> int:
    """Return a whole number, within what the column takes.

    Raises:
        InvalidEventError: it is none.
    """
    return _integer(name, _number_column(name, value))


def text_column(name: str, value: object) -> str:
    """Return a text.

    Raises:
        InvalidEventError: it is none, or no valid Unicode.
    """
    if not isinstance(value, str):
        raise InvalidEventError(f"{name} is {short(value)}, expected a text")
    try:
        value.encode()
    except UnicodeEncodeError as error:
        raise InvalidEventError(f"{name} is {short(value)}, expected valid Unicode") from error
    return value


def _integer(name: str, value: float) -> int:
    low, high = (0, 2**32) if name in _COUNTERS[:2] else (-(2**63) + 1, 2**63)
    # instants of today do not fit into a float
    if isinstance(value, float) and not (abs(value) <= 2**53 and value.is_integer()):
        raise InvalidEventError(
            f"{name} is {short(value)}, expected an integer, which no float above 2^53 holds exactly"
        )
    if not low <= value < high:
        raise InvalidEventError(f"{name} is {short(value)}, expected a whole number from {low} to {high - 1}")
    return int(value)


def _float(name: str, value: float) -> float:
    try:
        return float(value)
    except OverflowError as error:
        raise InvalidEventError(f"{name} is {short(value)}, expected a number of 64 bits") from error
