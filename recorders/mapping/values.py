"""Where names, times and topics come from: constants, placeholders in topics, and fields of messages."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import ROUND_HALF_EVEN, Decimal
from typing import Any, Final

from hrclog.recorders.mapping.facts import Captures, Clock, Instant
from hrclog.recorders.mapping.fields import (
    AbsentFieldError,
    FieldPath,
    UnknownFieldError,
    field_of,
    has_field,
    number,
    stamp_ns,
    word,
)
from hrclog.recorders.mapping.received import Received

_PART: Final = re.compile(r"\{([^\W\d]\w*)\}|\*", re.ASCII)


class TopicPattern:
    """The topics that a table of the mapping is about.

    ROS 1 may leave out the first slash.

    Args:
        text: a topic, in which `{agent}`, `{task}` and other names in braces stand for one part each, `*` for any part.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        text = text.removeprefix("/")
        self.names: tuple[str, ...] = tuple(dict.fromkeys(name for name in _PART.findall(text) if name))
        pieces, position = [], 0
        seen: set[str] = set()
        for part in _PART.finditer(text):
            name = part[1]
            pieces.append(re.escape(text[position : part.start()]))
            pieces.append("[^/]+" if not name else f"(?P={name})" if name in seen else f"(?P<{name}>[^/]+)")
            seen.add(name or "")
            position = part.end()
        self._known: dict[str, Captures | None] = {}
        self._pattern = re.compile("".join(pieces) + re.escape(text[position:]))

    def captures(self, topic: str) -> Captures | None:
        """Return what the placeholders stand for in a topic, None where it is another topic."""
        if topic not in self._known:
            match = self._pattern.fullmatch(topic.removeprefix("/"))
            self._known[topic] = None if match is None else match.groupdict()
        return self._known[topic]


@dataclass(frozen=True, slots=True)
class Value:
    """A name that is constant, or stands in a field.

    Attributes:
        text: the constant, with placeholders of the topic in braces.
        path: the field, None for a constant.
        names: what values of the field are called.
        default: what it is where a message lacks the field, "" if that is not known.
    """

    text: str
    path: FieldPath | None = None
    names: Mapping[str, str] = field(default_factory=dict)
    default: str = ""

    def of(self, content: Any, captures: Captures) -> str:  # noqa: ANN401 - any decoded message
        """Return the name, "" where the message does not tell it.

        Raises:
            UnknownFieldError: messages of this type have no such field.
            ValueError: the field holds no single value.
        """
        if self.path is None:
            return _PART.sub(lambda part: captures.get(part[1] or "", part[0]), self.text)
        try:
            name = word(self.path.of(content))
        except AbsentFieldError:
            return self.default
        except UnknownFieldError:
            if not self.default:
                raise
            return self.default
        return self.names.get(name, name) or self.default


@dataclass(frozen=True, slots=True)
class Time:
    """Where the time of a message stands.

    Attributes:
        path: the field; None means `header.stamp` where there is one that was set, and else the log time.
        unit_ns: nanoseconds of one unit of a number, None where the field holds a Time message.
        by_log: whether the log time counts in any case.
    """

    path: FieldPath | None = None
    unit_ns: int | None = None
    by_log: bool = False

    def of(self, received: Received) -> Instant:
        """Return when a message says that it happened.

        Raises:
            UnknownFieldError: messages of this type have no such field.
            ValueError: the field holds no time.
        """
        if self.by_log:
            return Instant(received.time_ns)
        if self.path is not None:
            return Instant(self._ns(self.path.of(received.content)), Clock.STAMP)
        return header_instant(received)

    def _ns(self, value: Any) -> int:  # noqa: ANN401 - any field's value
        stamp = stamp_ns(value)
        if stamp is not None:
            return stamp
        if self.unit_ns is None:
            raise UnknownFieldError(f"found {value!r} in {self.path_text!r}, expected a Time, or a unit of the number")
        return int((Decimal(number(value)) * self.unit_ns).to_integral_value(ROUND_HALF_EVEN))

    @property
    def path_text(self) -> str:
        """Return the path as the file writes it."""
        return self.path.text if self.path else ""


def header_instant(received: Received) -> Instant:
    """Return the stamp of a message's header where it was set, else its log time."""
    if has_field(received.content, "header"):
        header = field_of(received.content, "header")
        stamp = stamp_ns(field_of(header, "stamp")) if has_field(header, "stamp") else None
        if stamp:
            return Instant(stamp, Clock.STAMP)
    return Instant(received.time_ns)
