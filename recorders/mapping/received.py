"""A message of a foreign topic, whatever transport it came by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Received:
    """A decoded message.

    Attributes:
        topic: where it was published.
        type_name: its type as ROS 2 writes it, "" where it has none.
        time_ns: when it was logged or received.
        content: its fields, as attributes or as a mapping.
    """

    topic: str
    type_name: str
    time_ns: int
    content: Any
