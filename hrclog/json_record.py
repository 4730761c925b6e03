"""Read the fields of a JSON object strictly: every error says where, what was found and what was expected."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from hrclog.errors import ScenarioError
from hrclog.json_text import INPUT_JSON, JsonLimitError, parse_json, read_json_text

T = TypeVar("T")


class JsonRecord:
    """The fields of one JSON object and its place in the file.

    Args:
        value: the parsed value, which must be an object.
        where: file and position, for messages.
        allowed: names a field may have; any other name is an error, so that a typing mistake is never ignored.
        problems: what is wrong goes there, if it is given, and reading goes on with a value of the right type; nested
            objects share it. Without it the first error is raised.

    Raises:
        ScenarioError: not an object, or a field of an unknown name.
    """

    def __init__(self, value: object, where: str, allowed: Sequence[str], problems: list[str] | None = None) -> None:
        self.where = where
        self.problems = problems
        self._fields: Mapping[str, Any] = value if isinstance(value, Mapping) else {}
        self._silent = False
        if not isinstance(value, Mapping):
            self._note_error(wrong(where, value, "a JSON object"), None)
            self._silent = True  # do not report every field as missing too
        field_names = ", ".join(sorted(allowed))
        for name in sorted(set(self._fields) - set(allowed)):
            self._note_error(ScenarioError(f"{where}: unknown field {name!r}; the fields are {field_names}"), None)

    def __contains__(self, name: str) -> bool:
        return name in self._fields

    def error(self, name: str, expected: str) -> ScenarioError:
        """Return the error for a field with a wrong value."""
        return wrong(self._field_place(name), self._fields.get(name), expected)

    def instead(self, name: str, expected: str, value: T) -> T:
        """Note that a field is wrong and return a substitute; raise if problems are not collected."""
        return self._note_error(self.error(name, expected), value)

    def text(self, name: str, default: str | None = None) -> str:
        """Return a text; without a default it must be there and not be empty."""

        def is_valid(value: object) -> bool:
            return isinstance(value, str) and bool(value or default is not None) and _is_text(value)

        expected = "a text that is not empty" if default is None else "a text"
        value: str = self._value(name, default, is_valid, expected, default or "?")
        return value  # as it is: a default may be a member of an enumeration

    def choice(self, name: str, allowed: Sequence[str], default: str | None = None) -> str:
        """Return one of some texts."""

        def is_valid(value: object) -> bool:
            return isinstance(value, str) and value in allowed

        value: str = self._value(name, default, is_valid, f"one of {', '.join(allowed)}", allowed[0])
        return value  # as it is: a default may be a member of an enumeration

    def number(self, name: str, default: float | None = None, *, least: float = 0.0, most: float = math.inf) -> float:
        """Return a finite number from `least` to `most`."""

        def is_valid(value: Any) -> bool:  # noqa: ANN401 - a JSON value
            return _is_number(value) and least <= value <= most

        expected = f"a number from {least:g}" + (f" to {most:g}" if math.isfinite(most) else "")
        return float(self._value(name, default, is_valid, expected, max(least, min(1.0, most))))

    def positive(self, name: str) -> float:
        """Return a finite number above 0."""

        def is_valid(value: Any) -> bool:  # noqa: ANN401 - a JSON value
            return _is_number(value) and value > 0.0

        return float(self._value(name, None, is_valid, "a number above 0", 1.0))

    def integer(self, name: str, default: int | None = None, *, least: int = 0) -> int:
        """Return a whole number of at least `least`."""

        def is_valid(value: object) -> bool:
            return isinstance(value, int) and not isinstance(value, bool) and value >= least

        return int(self._value(name, default, is_valid, f"a whole number of at least {least}", least))

    def flag(self, name: str) -> bool:
        """Return true or false; false where it is not there."""
        return bool(self._value(name, False, lambda value: isinstance(value, bool), "true or false", False))

    def texts(self, name: str, default: tuple[str, ...] | None = None) -> tuple[str, ...]:
        """Return a list of texts."""

        def is_valid(value: object) -> bool:
            return isinstance(value, list) and all(
                isinstance(text, str) and bool(text) and _is_text(text) for text in value
            )

        return tuple(self._value(name, default, is_valid, "a list of texts", ()))

    def names(self, name: str) -> tuple[str, ...]:
        """Return the names of the fields of a nested object."""
        return tuple(self._value(name, None, lambda value: isinstance(value, Mapping), "a JSON object", ()))

    def numbers(self, name: str) -> tuple[float, ...]:
        """Return a list of finite numbers."""
        return tuple(map(float, self._value(name, None, _is_numbers, "a list of numbers", ())))

    def number_lists(self, name: str) -> list[tuple[float, ...]]:
        """Return a list of lists of finite numbers."""

        def is_valid(value: object) -> bool:
            return isinstance(value, list) and all(_is_numbers(entry) for entry in value)

        return [
            tuple(map(float, entry)) for entry in self._value(name, None, is_valid, "a list of lists of numbers", ())
        ]

    def record(self, name: str, allowed: Sequence[str]) -> JsonRecord:
        """Return a nested object."""
        return self._nested(self._value(name, None, lambda _: True, "", None), self._field_place(name), allowed)

    def records(self, name: str, allowed: Sequence[str], *, required: bool = True) -> list[JsonRecord]:
        """Return a list of nested objects; [] where it is not required and not there."""
        if name not in self._fields and not required:
            return []
        entries = self._value(name, None, lambda value: isinstance(value, list), "a list of JSON objects", [])
        return [
            self._nested(entry, f"{self._field_place(name)}[{index}]", allowed) for index, entry in enumerate(entries)
        ]

    def noted(self, read: Callable[[], T]) -> T | None:
        """Return what a function reads; where this object collects problems and it finds some, note them and go on.

        Args:
            read: may raise a ScenarioError.
        """
        return read() if self.problems is None else attempt(read, self.problems)

    def whole(self, read: Callable[[], T]) -> T | None:
        """Return what a function reads of this object, or None where something of that is wrong."""
        n_before = len(self.problems or ())
        value = read()
        return value if not self._silent and len(self.problems or ()) == n_before else None

    def strict(self) -> JsonRecord:
        """Return the same object, but with the first error raised."""
        return JsonRecord(self._fields, self.where, tuple(self._fields))

    def parts(self, entries: Iterable[JsonRecord], read: Callable[[JsonRecord], T]) -> tuple[T, ...]:
        """Return what a function reads of each of some nested objects, without those that are wrong."""
        values: list[T] = []
        for entry in entries:
            try:
                values.append(read(entry))
            except ScenarioError as error:
                if self.problems is None:
                    raise
                self.problems += error.problems
        return tuple(values)

    def check(self) -> None:
        """Raise if there are problems.

        Raises:
            ScenarioError: with all of them.
        """
        if self.problems:
            raise ScenarioError(*dict.fromkeys(self.problems))

    def _nested(self, value: object, where: str, allowed: Sequence[str]) -> JsonRecord:
        if value is None and self.problems is not None:
            missing = JsonRecord({}, where, allowed, self.problems)
            missing._silent = True  # its absence has been reported
            return missing
        return JsonRecord(value, where, allowed, self.problems)

    def _field_place(self, name: str) -> str:
        return f"{self.where}: {name}"

    def _value(
        self,
        name: str,
        default: Any,  # noqa: ANN401 - a JSON value
        is_valid: Callable[[Any], bool],
        expected: str,
        substitute: Any,  # noqa: ANN401 - a value of the type that is read
    ) -> Any:  # noqa: ANN401 - a JSON value
        """Return the value of a field, its default if it is absent, or the substitute if it is wrong."""
        if name not in self._fields:
            if default is not None:
                return default
            return self._note_error(ScenarioError(f"{self.where}: {name!r} is missing; add it"), substitute)
        value = self._fields[name]
        return value if is_valid(value) else self._note_error(self.error(name, expected), substitute)

    def _note_error(self, error: ScenarioError, value: T) -> T:
        """Note an error and return a substitute value; raise the error if problems are not collected."""
        if self.problems is None:
            raise error
        if not self._silent:
            self.problems.append(str(error))
        return value


def attempt(make: Callable[[], T], problems: list[str]) -> T | None:
    """Return what a function makes, or None and note its problems.

    Args:
        make: may raise a ScenarioError.
        problems: those of others, to which its own are added.
    """
    try:
        return make()
    except ScenarioError as error:
        problems += error.problems
        return None


def check_all(checks: Iterable[Callable[[], object]]) -> None:
    """Make checks that raise a ScenarioError each, and raise one with all that they found.

    Raises:
        ScenarioError: at least one check failed.
    """
    problems: list[str] = []
    for check in checks:
        attempt(check, problems)
    if problems:
        raise ScenarioError(*dict.fromkeys(problems))


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
    """Return the error for a wrong value."""
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
        return parse_json(read_json_text(path, INPUT_JSON), INPUT_JSON, parse_constant=_no_constant)
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read ({error.strerror}); expected {what}") from error
    except JsonLimitError as error:
        raise ScenarioError(f"{path}: {error}; expected {what}") from error
    except ValueError as error:
        raise ScenarioError(f"{path}: not JSON ({error}); expected {what}") from error


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is no JSON number")
