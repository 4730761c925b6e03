"""Play prepared courses of events: the common part of scripts and replays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

from hrclog.events import Outcome, TaskEnded, TaskFact, event_on
from hrclog.recorders.clock import Clock
from hrclog.recorders.executors.protocol import Command, Emit

_END, _BEGIN = 0, 1  # what ends at an instant ends before anything begins there


@dataclass(frozen=True, slots=True)
class Course:
    """The events of one command in order, each as (ns after the command, event). A deaf course ignores cancels."""

    steps: tuple[tuple[int, TaskFact], ...]
    deaf: bool = False


class Player:
    """Emit each event of a course at its instant, until the course ends or is cancelled.

    Args:
        clock: simulated or real.
    """

    def __init__(self, clock: Clock) -> None:
        self.emit: Emit = lambda _: None
        self._clock = clock
        self._playing: dict[str, tuple[Command, Course]] = {}

    def play(self, command: Command, course: Course) -> None:
        """Begin a course."""
        self._playing[command.execution_id] = (command, course)
        self._schedule(command, course.steps, self._clock.now_ns)

    def cancel(self, execution_id: str, reason: str) -> None:
        """End a course as canceled, now. A course that is over or deaf is not changed."""
        command, course = self._playing.get(execution_id, (None, None))
        if command is not None and course is not None and not course.deaf:
            del self._playing[execution_id]
            now_ns = self._clock.now_ns
            self.emit(event_on(TaskEnded, command, time_ns=now_ns, outcome=Outcome.CANCELED, reason=reason))

    def _schedule(self, command: Command, steps: Sequence[tuple[int, TaskFact]], origin_ns: int) -> None:
        if not steps:
            return
        offset_ns, event = steps[0]
        priority = _END if isinstance(event, TaskEnded) else _BEGIN
        self._clock.schedule(origin_ns + offset_ns, partial(self._emit_next, command, steps, origin_ns), priority)

    def _emit_next(self, command: Command, steps: Sequence[tuple[int, TaskFact]], origin_ns: int) -> None:
        if command.execution_id not in self._playing:
            return
        if len(steps) == 1:
            del self._playing[command.execution_id]
        self._schedule(command, steps[1:], origin_ns)
        self.emit(replace(steps[0][1], time_ns=self._clock.now_ns))
