"""Read the fields of a JSON object strictly: every error says where, what was found and what was expected."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hrclog.errors import ScenarioError


class JsonRecord:
    """The fields of one JSON object and its place in the file.

    Args:
        value: the parsed value, which must be an object.
        where: file and position, for messages.
        allowed: names a field may have; any other name is an error, so that a typing mistake is never ignored.

    Raises:
        ScenarioError: not an object, or a field of an unknown name.
    """

    def __init__(self, value: object, where: str, allowed: Sequence[str]) -> None:
        if not isinstance(value, Mapping):
            raise wrong(where, value, "a JSON object")
        self._fields: Mapping[str, Any] = value
        self.where = where
        unknown = sorted(set(value) - set(allowed))
        if unknown:
            raise ScenarioError(f"{where}: unknown field {unknown[0]!r}; the fields are {', '.join(sorted(allowed))}")

    def __contains__(self, name: str) -> bool:
        return name in self._fields

    def error(self, name: str, expected: str) -> ScenarioError:
        """Return the error that says a field is not what it should be."""
        return wrong(self._at(name), self._fields.get(name), expected)

    def text(self, name: str, default: str | None = None) -> str:
        """Return a text; without a default it must be there and not be empty."""
        if name not in self._fields and default is not None:
            return default
        value = self._required(name)
        if not isinstance(value, str) or not (value or default is not None) or not _is_text(value):
            raise self.error(name, "a text that is not empty" if default is None else "a text")
        return value

    def number(self, name: str, default: float | None = None, *, least: float = 0.0, most: float = math.inf) -> float:
        """Return a finite number from `least` to `most`."""
        if name not in self._fields and default is not None:
            return default
        value = self._required(name)
        fine = _is_number(value)
        if not fine or not least <= value <= most:
            raise self.error(name, f"a number from {least:g}" + (f" to {most:g}" if math.isfinite(most) else ""))
        return float(value)

    def positive(self, name: str) -> float:
        """Return a finite number above 0."""
        value = self.number(name)
        if value <= 0.0:
            raise self.error(name, "a number above 0")
        return value

    def integer(self, name: str, default: int | None = None, *, least: int = 0) -> int:
        """Return a whole number of at least `least`."""
        if name not in self._fields and default is not None:
            return default
        value = self._required(name)
        if not isinstance(value, int) or isinstance(value, bool) or value < least:
            raise self.error(name, f"a whole number of at least {least}")
        return value

    def flag(self, name: str) -> bool:
        """Return true or false; false where it is not there."""
        value = self._fields.get(name, False)
        if not isinstance(value, bool):
            raise self.error(name, "true or false")
        return value

    def texts(self, name: str, default: tuple[str, ...] | None = None) -> tuple[str, ...]:
        """Return a list of texts."""
        if name not in self._fields and default is not None:
            return default
        value = self._required(name)
        if not isinstance(value, list) or not all(isinstance(text, str) and text and _is_text(text) for text in value):
            raise self.error(name, "a list of texts")
        return tuple(value)

    def names(self, name: str) -> tuple[str, ...]:
        """Return the names of the fields of a nested object."""
        value = self._required(name)
        if not isinstance(value, Mapping):
            raise self.error(name, "a JSON object")
        return tuple(value)

    def numbers(self, name: str) -> tuple[float, ...]:
        """Return a list of finite numbers."""
        value = self._required(name)
        if not _is_numbers(value):
            raise self.error(name, "a list of numbers")
        return tuple(map(float, value))

    def number_lists(self, name: str) -> list[tuple[float, ...]]:
        """Return a list of lists of finite numbers."""
        value = self._required(name)
        if not isinstance(value, list) or not all(_is_numbers(entry) for entry in value):
            raise self.error(name, "a list of lists of numbers")
        return [tuple(map(float, entry)) for entry in value]

    def record(self, name: str, allowed: Sequence[str]) -> JsonRecord:
        """Return a nested object."""
        return JsonRecord(self._required(name), self._at(name), allowed)

    def records(self, name: str, allowed: Sequence[str], *, required: bool = True) -> list[JsonRecord]:
        """Return a list of nested objects; [] where it is not required and not there."""
        if name not in self._fields and not required:
            return []
        value = self._required(name)
        if not isinstance(value, list):
            raise self.error(name, "a list of JSON objects")
        return [JsonRecord(entry, f"{self._at(name)}[{index}]", allowed) for index, entry in enumerate(value)]

    def _at(self, name: str) -> str:
        return f"{self.where}: {name}"

    def _required(self, name: str) -> Any:  # noqa: ANN401 - a JSON value
        if name not in self._fields:
            raise ScenarioError(f"{self.where}: {name!r} is missing; add it")
        return self._fields[name]


def _is_numbers(value: object) -> bool:
    return isinstance(value, list) and all(_is_number(entry) for entry in value)


def _is_number(value: object) -> bool:
    """Return whether a value is a number that a float can hold; integers in JSON may be longer."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def _is_text(value: str) -> bool:
    """Return whether a text can be written: half of a surrogate pair cannot."""
    return not any("\ud800" <= character <= "\udfff" for character in value)


def wrong(where: str, found: object, expected: str) -> ScenarioError:
    """Return the error of a value that is not what it should be."""
    return ScenarioError(f"{where}: found {str(found)[:80]!r}, expected {expected}; correct it")


def read_json(path: Path, what: str) -> object:
    """Return the value of a JSON file.

    Args:
        path: the file.
        what: what the file should hold, for messages.

    Raises:
        ScenarioError: it cannot be read, or is not JSON.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"), parse_constant=_no_constant)
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read ({error.strerror}); expected {what}") from error
    except RecursionError as error:
        raise ScenarioError(f"{path}: nested too deeply; expected {what}") from error
    except ValueError as error:
        raise ScenarioError(f"{path}: not JSON ({error}); expected {what}") from error


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is no JSON number")
