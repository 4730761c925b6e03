"""What could not be decoded: many messages of one channel that fail for one cause are one complaint with a count."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from hrclog.wording import counted

Complain = Callable[[str, str, int | None], None]
"""Takes a diagnostic code, a message and the byte offset or None."""

_MOST_CAUSES: Final = 10  # of a channel
_VALUES: Final = re.compile(r"'[^']*'|\"[^\"]*\"|[-+]?\d[\d.e+-]*")
_FURTHER: Final = "for further reasons"


@dataclass(slots=True)
class _Cause:
    example: str
    count: int
    first_log_time: int


class Failures:
    """The messages of a file that could not be decoded, by topic and cause; other values make no other cause."""

    def __init__(self) -> None:
        self._causes: dict[str, dict[str, _Cause]] = {}

    def add(self, topic: str, reason: str, log_time: int, count: int = 1) -> None:
        """Take in messages that failed for a reason, the first of them logged at a time."""
        causes = self._causes.setdefault(topic, {})
        cause = _VALUES.sub("…", reason)
        if cause not in causes and len(causes) >= _MOST_CAUSES:
            cause = reason = _FURTHER
        causes.setdefault(cause, _Cause(reason, 0, log_time)).count += count

    def report(self, complain: Complain, code: str = "undecodable_event", what: str = "cannot be decoded") -> None:
        """Complain once of each cause.

        Args:
            complain: takes the complaints.
            code: of the diagnostic.
            what: came of the messages.
        """
        for topic, causes in self._causes.items():
            for cause in causes.values():
                text = f"{counted(cause.count, 'message')} of {topic} {what} ({cause.example})"
                complain(code, f"{text}, the first with log time {cause.first_log_time} ns", None)
