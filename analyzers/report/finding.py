"""A sentence of a report's findings, and the words that such sentences share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from hrclog.analyzers.figures.text import printable


@dataclass(frozen=True, slots=True)
class Finding:
    """A sentence, and details as further sentences. `doubt` limits the other findings, `lost` reports lost data."""

    text: str
    details: tuple[str, ...] = ()
    kind: Literal["lost", "fact", "doubt"] = "fact"


def task_name(agent: str, task: str) -> str:
    """Return the name of a task in sentences."""
    return f"{printable(agent)}: {printable(task)}"
