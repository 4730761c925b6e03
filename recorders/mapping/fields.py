"""Paths to the fields of messages: `goal.task`, `arguments[0]`, `status_list[-1].status`."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Final

import numpy as np

from hrclog.units import NS_PER_S

_STEP: Final = re.compile(r"([^\W\d]\w*)|\[(-?\d{1,9})\]", re.ASCII)
_PART: Final = r"[^\W\d]\w*(?:\[-?\d{1,9}\])*"
_PATH: Final = re.compile(rf"{_PART}(?:\.{_PART})*", re.ASCII)
_UUID_SIZE: Final = 16
_STAMPS: Final = (("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"))


class UnknownFieldError(ValueError):
    """A path names a field that messages of this type do not have."""


class AbsentFieldError(ValueError):
    """One message lacks what others of its type may have: an element of a list, a key of JSON."""


class FieldPath:
    """A path to a field of a message.

    Args:
        text: names joined by dots, elements of lists in brackets.

    Raises:
        ValueError: it is no such path.
    """

    def __init__(self, text: str) -> None:
        if not _PATH.fullmatch(text):
            raise ValueError(f"found {text!r}, expected a field such as goal.task or arguments[0]")
        self.text = text
        self._steps = [name or int(index) for name, index in _STEP.findall(text)]

    def of(self, content: Any) -> Any:  # noqa: ANN401 - a message's field may hold anything
        """Return the field of a message.

        Raises:
            UnknownFieldError: its type has no such field; lists those that it has.
            AbsentFieldError: this message lacks it.
        """
        for step in self._steps:
            content = _element(content, step, self.text) if isinstance(step, int) else _member(content, step, self.text)
        return content.item() if isinstance(content, np.generic) else content


def field_of(content: Any, path: str) -> Any:  # noqa: ANN401 - a message's field may hold anything
    """Return a field of a message whose type is known to have it; see `FieldPath.of`."""
    return _path(path).of(content)


@lru_cache(maxsize=256)
def _path(text: str) -> FieldPath:
    return FieldPath(text)


def field_names(content: Any) -> list[str]:  # noqa: ANN401 - any decoded message
    """Return the names of a message's fields, [] where it is a plain value or a list."""
    if isinstance(content, Mapping):
        return [str(name) for name in content]
    if dataclasses.is_dataclass(content):
        return [field.name for field in dataclasses.fields(content) if field.default is dataclasses.MISSING]
    return []


def has_field(content: Any, name: str) -> bool:  # noqa: ANN401 - any decoded message
    """Return whether a message has a field."""
    return name in (content if isinstance(content, Mapping) else getattr(type(content), "__dataclass_fields__", ()))


def word(value: Any) -> str:  # noqa: ANN401 - any field's value
    """Return a field's value as a word, as mapping files write it.

    Raises:
        ValueError: it is no single value.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return value.strip()
    if isinstance(value, float):
        return str(int(value)) if value.is_integer() else str(value)
    if isinstance(value, int):
        return str(value)
    raw = uuid_bytes(value)
    if raw is not None:
        return raw.hex()
    raise ValueError(f"found {type(value).__name__} in a field, expected a text, a number or a truth value")


def number(value: Any) -> int | float:  # noqa: ANN401 - any field's value
    """Return a field's value as a number; a truth value is 0 or 1.

    Raises:
        TypeError: it is none.
    """
    if not isinstance(value, int | float):
        raise TypeError(f"found {value!r:.60}, expected a number")
    return value


def uuid_bytes(value: Any) -> bytes | None:  # noqa: ANN401 - any field's value
    """Return the bytes of a UUID, as a message or as its array; None where it is none."""
    inner = getattr(value, "uuid", None) if not isinstance(value, Mapping) else value.get("uuid")
    inner = value if inner is None else inner
    if isinstance(inner, np.ndarray | list | bytes) and len(inner) == _UUID_SIZE:
        try:
            return bytes(inner if isinstance(inner, bytes) else [int(number) for number in inner])
        except (TypeError, ValueError):
            return None
    return None


def stamp_ns(value: Any) -> int | None:  # noqa: ANN401 - any field's value
    """Return a Time or Duration message as nanoseconds; None where it is none."""
    for seconds, rest in _STAMPS:
        if has_field(value, seconds) and has_field(value, rest):
            if isinstance(value, Mapping):
                return int(value[seconds]) * NS_PER_S + int(value[rest])
            return int(getattr(value, seconds)) * NS_PER_S + int(getattr(value, rest))
    return None


def _member(content: Any, name: str, path: str) -> Any:  # noqa: ANN401 - a message's field may hold anything
    if isinstance(content, Mapping):
        if name in content:
            return content[name]
        raise AbsentFieldError(f"no {path}; it has {_listed(field_names(content))}")
    if name not in getattr(type(content), "__dataclass_fields__", ()):
        names = field_names(content)
        what = f"it has {_listed(names)}" if names else f"{_before(path, name)} is no message, but {_kind(content)}"
        place = "" if path == name else f" of {path!r}"
        raise UnknownFieldError(f"found no field {name!r}{place}; {what}")
    return getattr(content, name)


def _element(content: Any, index: int, path: str) -> Any:  # noqa: ANN401 - a message's field may hold anything
    if not isinstance(content, list | tuple | np.ndarray):
        raise UnknownFieldError(f"found no list before [{index}] in {path!r}, but {_kind(content)}")
    if not -len(content) <= index < len(content):
        raise AbsentFieldError(f"no {path}: the list has {len(content)} elements")
    return content[index]


def _before(path: str, name: str) -> str:
    return path[: path.rfind(name)].rstrip(".") or "it"


def _kind(content: Any) -> str:  # noqa: ANN401 - a message's field may hold anything
    return "a list" if isinstance(content, list | np.ndarray) else type(content).__name__


def _listed(names: list[str], most: int = 30) -> str:
    shown = ", ".join(names[:most]) or "no fields"
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"
