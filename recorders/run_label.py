"""What a JSON line calls its run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hrclog.log.messages.json_rows import text_column


@dataclass(frozen=True, slots=True)
class RunLabel:
    """What a line calls its run, "" for nothing.

    Attributes:
        run_id: the id that the writing program gives it; the recorder gives it another.
        run: the name by which lines name it.
    """

    run_id: str = ""
    run: str = ""

    @property
    def key(self) -> str:
        """Return by what the run is told from others: the id says more than a name."""
        return self.run_id or self.run


UNNAMED = RunLabel()


def take_label(value: dict[str, Any]) -> RunLabel:
    """Take what a line calls its run out of its fields.

    Raises:
        InvalidEventError: it is no text.
    """
    if "run_id" not in value and "run" not in value:
        return UNNAMED
    return RunLabel(_text("run_id", value.pop("run_id", None)), _text("run", value.pop("run", None)))


def _text(field: str, name: object) -> str:
    return "" if name is None else text_column(field, name).strip()
