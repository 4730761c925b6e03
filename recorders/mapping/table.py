"""Read one table of a mapping file: every key is known, every value is of its kind, all problems are told at once."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final

from hrclog.recorders.mapping.fields import FieldPath
from hrclog.recorders.mapping.values import Time, TopicPattern, Value

_VALUE_KEYS: Final = ("field", "names", "default")
_UNITS_NS: Final = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}
_PLACEHOLDER: Final = re.compile(r"\{([^\W\d]\w*)\}", re.ASCII)


class Table:
    """A table whose keys are asked for one by one; what is wrong collects in `problems`.

    Args:
        where: how messages name it, `action[1]`.
        content: what the file says.
        problems: takes what is wrong.
    """

    def __init__(self, where: str, content: Mapping[str, Any], problems: list[str]) -> None:
        self.where = where
        self._content = content
        self._problems = problems
        self._asked: list[str] = []

    def __contains__(self, key: str) -> bool:
        return key in self._content

    def problem(self, text: str) -> None:
        """Note something wrong."""
        self._problems.append(f"{self.where}: {text}")

    def close(self) -> None:
        """Note keys that nobody asked for."""
        for key in self._content:
            if key not in self._asked:
                self.problem(f"found the key {key!r}, expected one of {', '.join(sorted(set(self._asked)))}")

    def text(self, key: str, default: str | None = None) -> str:
        """Return a text; one without a default is required."""
        value = self._get(key, default)
        if isinstance(value, str) and value:
            return value
        if value != default or default is None:
            self._wrong(key, value, "a text")
        return default or ""

    def choice(self, key: str, choices: tuple[str, ...], default: str | None = None) -> str:
        """Return one of several words."""
        value = self._get(key, default)
        if value in choices:
            return str(value)
        self._wrong(key, value, f"one of {', '.join(choices)}")
        return choices[0]

    def flag(self, key: str) -> bool:
        """Return a truth value, false where it is not there."""
        value = self._get(key, default=False)
        if not isinstance(value, bool):
            self._wrong(key, value, "true or false")
        return value is True

    def number(self, key: str, default: float, *, above: float) -> float:
        """Return a number above a bound."""
        value = self._get(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not above < value < float("inf"):
            self._wrong(key, value, f"a number above {above:g}")
            return default
        return float(value)

    def words(self, key: str, default: tuple[str, ...] = ()) -> tuple[str, ...]:
        """Return a list of texts, numbers or truth values as words; a single one is a list of one."""
        value = self._get(key, default)
        items = list(value) if isinstance(value, list | tuple) else [value]
        if not all(isinstance(item, str | int | float | bool) for item in items):
            self._wrong(key, value, "a list of texts or numbers")
            return default
        return tuple(_word(item) for item in items)

    def renames(self, key: str) -> dict[str, str] | None:
        """Return a table of words for words, None where there is none."""
        value = self._get(key, None)
        if value is None:
            return None
        if not isinstance(value, Mapping) or not all(isinstance(word, str) for word in value.values()):
            self._wrong(key, value, 'a table of texts such as { 1 = "normal" }')
            return None
        return dict(value)

    def topic(self, default: str | None = None) -> TopicPattern:
        """Return the topics that the table is about."""
        return TopicPattern(self.text("topic", default))

    def path(self, key: str, default: str | None = None) -> FieldPath:
        """Return a path to a field."""
        return self._path(key, self.text(key, default)) or FieldPath("data")

    def value(self, key: str, default: str | Value | None = None, captures: tuple[str, ...] = ()) -> Value:
        """Return what a name is, or where it stands; one without a default is required.

        Args:
            key: of the table.
            default: what it is where the key is not there.
            captures: placeholders of the topic; one that is called like the key is the default.
        """
        content = self._content.get(key)
        self._asked.append(key)
        if content is None and key in captures:
            return Value("{" + key + "}")
        if content is None and default is not None:
            return default if isinstance(default, Value) else Value(default)
        if isinstance(content, str) and content:
            strange = [name for name in _PLACEHOLDER.findall(content) if name not in captures]
            if strange:
                self._wrong(key, content, f"placeholders of the topic ({', '.join(captures) or 'it has none'})")
            return Value(content)
        if isinstance(content, Mapping) and "field" in content and set(content) <= set(_VALUE_KEYS):
            return self._field_value(key, content)
        self._wrong(key, content, 'a text, or { field = "...", names = { ... }, default = "..." }')
        return Value("?")

    def time(self) -> Time:
        """Return where the time of messages stands."""
        content = self._get("time", None)
        if content is None:
            return Time()
        if content == "log":
            return Time(by_log=True)
        if isinstance(content, Mapping) and set(content) <= {"field", "unit"} and isinstance(content.get("field"), str):
            unit = content.get("unit")
            if unit is None or unit in _UNITS_NS:
                return Time(self._path("time", content["field"]), unit_ns=_UNITS_NS.get(str(unit)))
        self._wrong("time", content, '"log", or { field = "header.stamp" }, with a unit (s, ms, us, ns) for numbers')
        return Time()

    def _field_value(self, key: str, content: Mapping[str, Any]) -> Value:
        path = self._path(key, content["field"])
        names, default = content.get("names", {}), content.get("default", "")
        if not isinstance(names, Mapping) or not all(isinstance(name, str) for name in names.values()):
            self._wrong(f"{key}.names", names, "a table of texts")
            names = {}
        if not isinstance(default, str):
            self._wrong(f"{key}.default", default, "a text")
            default = ""
        return Value("", path or FieldPath("data"), dict(names), default)

    def _path(self, key: str, text: Any) -> FieldPath | None:  # noqa: ANN401 - whatever the file says
        try:
            return FieldPath(text) if isinstance(text, str) else FieldPath("")
        except ValueError:
            self._wrong(key, text, "a field such as goal.task or arguments[0]")
            return None

    def _get(self, key: str, default: Any) -> Any:  # noqa: ANN401 - whatever the file says
        self._asked.append(key)
        return self._content.get(key, default)

    def _wrong(self, key: str, value: Any, expected: str) -> None:  # noqa: ANN401 - whatever the file says
        found = "nothing" if value is None else repr(value)[:80]
        self.problem(f"{key}: found {found}, expected {expected}")


def _word(item: str | float) -> str:
    if isinstance(item, bool):
        return "true" if item else "false"
    return str(item)
