"""What messages say, once they are understood: events and samples without a run, and on which clock they are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

from hrclog.events import Event
from hrclog.log.messages.encode import FloatSignal, JointSignal

_MOST_REMARKS: Final = 100


class Clock(Enum):
    """Whose clock an instant is on."""

    LOG = "the clock of whoever logged or received the messages"
    STAMP = "the clock that the messages themselves are stamped by"


@dataclass(frozen=True, slots=True)
class Instant:
    """A time and its clock."""

    ns: int
    clock: Clock = Clock.LOG


@dataclass(frozen=True, slots=True)
class RunMark:
    """A run began, or with "" the one before ended."""

    name: str
    time_ns: int


@dataclass(frozen=True, slots=True)
class Fact:
    """An event, a sample or the mark of a run; its `run_id` is empty, and `clock` is that of its `time_ns`."""

    content: Event | FloatSignal | JointSignal | RunMark
    clock: Clock

    @property
    def time_ns(self) -> int:
        """Return when it happened."""
        return self.content.time_ns


@dataclass(slots=True)
class Notes:
    """What is to be said of the messages beside the facts.

    Attributes:
        remarks: how often something happened, by diagnostic code and sentence; the sentence holds `{}` for the count.
        sure_stamps: (log time, stamp) of messages that were logged as soon as they were stamped.
        other_stamps: the same of messages that may have waited before they were logged.
        begin_ns: log time of the first message.
        actions: the action that each goal's id was met in first; some servers count their goals, so that ids recur.
    """

    remarks: Counter[tuple[str, str]] = field(default_factory=Counter)
    sure_stamps: list[tuple[int, int]] = field(default_factory=list)
    other_stamps: list[tuple[int, int]] = field(default_factory=list)
    begin_ns: int = 0
    actions: dict[str, str] = field(default_factory=dict)

    def remark(self, code: str, sentence: str) -> None:
        """Count something that is to be told."""
        is_new = (code, sentence) not in self.remarks
        if is_new and len(self.remarks) >= _MOST_REMARKS:
            sentence = "{}: as above, of other topics or values"
        self.remarks[code, sentence] += 1

    def stamp(self, log_ns: int, stamp_ns: int, *, sure: bool) -> None:
        """Remember when a stamped message was logged."""
        (self.sure_stamps if sure else self.other_stamps).append((log_ns, stamp_ns))


Captures = Mapping[str, str]
"""What the placeholders of a topic stand for in one topic."""
