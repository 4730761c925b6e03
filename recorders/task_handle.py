"""One execution that is being recorded."""

from __future__ import annotations

import operator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Protocol, Self

from hrclog.errors import InvalidEventError
from hrclog.events import (
    Cause,
    Event,
    Fact,
    Outcome,
    TaskEnded,
    TaskFact,
    TaskPaused,
    TaskResumed,
    TaskStarted,
    event_on,
)
from hrclog.log.messages.message import UNSET_INT

if TYPE_CHECKING:
    from collections.abc import Mapping

    from hrclog.state import ExecutionState, Phase

NOW: Final = UNSET_INT
"""Stands for the instant at which the recorder takes an event."""


class ExecutionRecorder(Protocol):
    """What a handle needs of the recorder that it belongs to."""

    def record(self, event: Event) -> Event:
        """Record an event."""
        ...

    def state(self, execution_id: str) -> ExecutionState:
        """Return the state of an execution."""
        ...


@dataclass(frozen=True, slots=True)
class TaskHandle:
    """One execution being recorded."""

    recorder: ExecutionRecorder
    fact: TaskFact

    @property
    def execution_id(self) -> str:
        """Return the execution's id."""
        return self.fact.execution_id

    @property
    def phase(self) -> Phase:
        """Return where the execution stands."""
        return self.recorder.state(self.execution_id).phase

    def start(self, *, time_ns: int | None = None) -> Self:
        """Record that a dispatched execution began."""
        self.recorder.record(self._new_event(TaskStarted, time_ns))
        return self

    def end(
        self,
        outcome: str = Outcome.SUCCEEDED,
        reason: str = "",
        *,
        time_ns: int | None = None,
        planned_duration_s: float | None = None,
        planning_time_s: float | None = None,
        path_length: float | None = None,
        target: str = "",
        details: Mapping[str, Any] | None = None,
    ) -> None:
        """Record how the execution ended."""
        self.recorder.record(
            replace(
                self._new_event(TaskEnded, time_ns),
                outcome=str(outcome),
                reason=reason,
                planned_duration_s=planned_duration_s,
                planning_time_s=planning_time_s,
                path_length=path_length,
                target=target,
                details=as_details(details),
            )
        )

    def pause(self, cause: str = Cause.OPERATOR, reason: str = "", *, time_ns: int | None = None) -> None:
        """Record that the execution was halted."""
        self.recorder.record(replace(self._new_event(TaskPaused, time_ns), cause=str(cause), reason=reason))

    def resume(self, *, time_ns: int | None = None) -> None:
        """Record that the execution went on."""
        self.recorder.record(self._new_event(TaskResumed, time_ns))

    def _new_event(self, kind: type[Fact], time_ns: int | None) -> Fact:
        return event_on(kind, self.fact, time_ns=instant(time_ns))


def as_details(details: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return the details of an event as a dictionary.

    Raises:
        InvalidEventError: they are something else.
    """
    try:
        return dict(details or {})
    except (TypeError, ValueError) as error:
        raise InvalidEventError(f"details are {details!r}, expected a mapping of names to values") from error


def instant(time_ns: int | None) -> int:
    """Return an instant that the caller may leave to the recorder.

    Raises:
        InvalidEventError: it is no whole number.
    """
    try:
        return NOW if time_ns is None else operator.index(time_ns)
    except TypeError as error:
        raise InvalidEventError(f"time_ns is {time_ns!r}, expected whole nanoseconds since 1970") from error
