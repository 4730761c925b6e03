"""Tags: facts of a run as `key=value`, such as its participant, its condition or the trial."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from numbers import Integral
from types import MappingProxyType
from typing import Final

from hrclog.errors import InvalidEventError

TAGS: Final = "tags"
"""Member of an event's details that holds tags."""

NO_TAGS: Final[Mapping[str, str]] = MappingProxyType({})

_FORM: Final = "key=value"
_LONGEST_KEY: Final = 80
_NO_SIGNS: Final = "=!"


def parse_tags(texts: Iterable[str]) -> dict[str, str]:
    """Return tags of `key=value` texts; a value may be empty.

    Raises:
        InvalidEventError: a text has another form, or a key has two values.
    """
    tags: dict[str, str] = {}
    for text in texts:
        key, separator, value = text.partition("=")
        if not separator:
            raise InvalidEventError(f"tag: found {text!r}, expected {_FORM}")
        key, value = _key(key), value.strip()
        if tags.setdefault(key, value) != value:
            raise InvalidEventError(f"tag: found two values of {key!r}, expected one")
    return tags


def checked_tags(tags: object) -> dict[str, str]:
    """Return tags with their values as texts: numbers as they are written, `true` and `false`.

    Args:
        tags: a mapping of keys to texts, numbers or truth values; None for no tags.

    Raises:
        InvalidEventError: it is no such mapping, or a value is empty.
    """
    if tags is None:
        return {}
    if not isinstance(tags, Mapping):
        raise InvalidEventError(f"tags are {tags!r}, expected values by key, such as {{'participant': 'P01'}}")
    checked = {_key(key): value_text(key, value) for key, value in tags.items()}
    if len(checked) < len(tags):
        raise InvalidEventError(f"tags are {tags!r}, expected each key once")
    for key, value in checked.items():
        if not value:
            raise InvalidEventError(f"tag {key!r} is empty, expected a value, or no such tag")
    return checked


def value_text(key: object, value: object) -> str:
    """Return the value of a tag as a text.

    Raises:
        InvalidEventError: it is no text, number or truth value.
    """
    if isinstance(value, str):
        return _storable(f"tag {key!r}", value.strip())
    if isinstance(value, bool) or (isinstance(value, float) and math.isfinite(value)):
        return json.dumps(value)
    if isinstance(value, Integral):  # of numpy too
        return json.dumps(int(value))
    raise InvalidEventError(f"tag {key!r} is {value!r}, expected a text or a number")


def _key(key: object) -> str:
    """Return the key of a tag, without spaces around it.

    Raises:
        InvalidEventError: it is none.
    """
    text = key.strip() if isinstance(key, str) else ""
    if not text or len(text) > _LONGEST_KEY or not text.isprintable() or any(sign in text for sign in _NO_SIGNS):
        expected = f"a name of at most {_LONGEST_KEY} characters without {' or '.join(_NO_SIGNS)}"
        raise InvalidEventError(f"tag: found the key {key!r}, expected {expected}")
    return _storable("tag", text)


def _storable(what: str, text: str) -> str:
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise InvalidEventError(f"{what}: found {text!r}, expected text that UTF-8 can hold") from error
    return text
