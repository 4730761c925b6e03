"""Read JSON that others wrote, within limits of size and depth: a few KB of brackets must not take the stack."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

DEEPEST: Final = 100
"""So many lists and objects may lie within each other."""

_MIB: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class JsonLimits:
    """How large a JSON text may be.

    Attributes:
        n_bytes: bytes, or characters.
        n_values: values, as brackets and commas tell them.
    """

    n_bytes: int
    n_values: int


EVENT_JSON: Final = JsonLimits(8 * _MIB, 250_000)
"""Of an event, its details, a scene, a value in a knowledge base."""

INPUT_JSON: Final = JsonLimits(64 * _MIB, 2_000_000)
"""Of what a user writes: plans, problems, scenarios, scripts, synergies."""

RESULT_JSON: Final = JsonLimits(1024 * _MIB, 50_000_000)
"""Of what programs write: analyses, truth files, manifests, exports, dumps."""


class JsonLimitError(ValueError):
    """A JSON text is larger or deeper than its limit; the text says which, and for how much."""

    def __init__(self, what: str, found: int | None, most: int) -> None:
        count = "more" if found is None else f"{found:,}"
        super().__init__(f"limit reached: {count} {what}, expected at most {most:,}")


def parse_json(
    text: str | bytes,
    limits: JsonLimits = EVENT_JSON,
    *,
    object_hook: Callable[[dict[str, Any]], Any] | None = None,
    parse_constant: Callable[[str], Any] | None = None,
) -> Any:  # noqa: ANN401 - any JSON value
    """Return the value of a JSON text.

    Args:
        text: JSON.
        limits: how large it may be.
        object_hook: makes the value of an object; None keeps it.
        parse_constant: makes the value of NaN and infinities; None keeps them.

    Raises:
        JsonLimitError: the text is too large, or too deep.
        ValueError: it is no JSON.
    """
    if len(text) > limits.n_bytes:
        raise JsonLimitError("bytes of JSON", len(text), limits.n_bytes)
    n_containers = text.count("[") + text.count("{") if isinstance(text, str) else text.count(b"[") + text.count(b"{")
    n_values = n_containers + (text.count(",") if isinstance(text, str) else text.count(b","))
    if n_values > limits.n_values:
        raise JsonLimitError("values of JSON", n_values, limits.n_values)
    try:
        if object_hook is None and parse_constant is None:
            value = json.loads(text)
        else:
            value = json.loads(text, object_hook=object_hook, parse_constant=parse_constant)
    except RecursionError as error:
        raise JsonLimitError("lists and objects of JSON within each other", None, DEEPEST) from error
    if n_containers > DEEPEST:
        check_depth(value)
    return value


def check_depth(value: object) -> None:
    """Raise if a JSON value is too deep.

    Raises:
        JsonLimitError: it is.
    """
    level = [value]
    for _ in range(DEEPEST):
        level = [
            entry
            for container in level
            if isinstance(container, dict | list)
            for entry in (container.values() if isinstance(container, dict) else container)
            if isinstance(entry, dict | list)
        ]
        if not level:
            return
    raise JsonLimitError("lists and objects of JSON within each other", None, DEEPEST)


def read_json_text(path: Path, limits: JsonLimits, encoding: str = "utf-8") -> str:
    """Return the text of a JSON file.

    Args:
        path: the file.
        limits: how large it may be.
        encoding: of the text.

    Raises:
        OSError: it cannot be read.
        ValueError: it is no text, or too large.
    """
    with path.open("rb") as stream:
        data = stream.read(limits.n_bytes + 1)
    if len(data) > limits.n_bytes:
        raise JsonLimitError("bytes of JSON", path.stat().st_size, limits.n_bytes)
    return data.decode(encoding)


def read_json_file(path: Path, limits: JsonLimits, encoding: str = "utf-8") -> Any:  # noqa: ANN401 - any JSON value
    """Return the value of a JSON file; the arguments are those of `read_json_text`.

    Raises:
        OSError: it cannot be read.
        ValueError: it is no JSON, too large or too deep.
    """
    return parse_json(read_json_text(path, limits, encoding), limits)
