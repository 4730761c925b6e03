"""One execution that is being recorded."""

from __future__ import annotations

import operator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Self, TypeVar

from hrclog.errors import InvalidEventError
from hrclog.events import Cause, Outcome, TaskEnded, TaskFact, TaskPaused, TaskResumed, TaskStarted
from hrclog.log.message import UNSET_INT

if TYPE_CHECKING:
    from collections.abc import Mapping

    from hrclog.recorders.event_recorder import EventRecorder
    from hrclog.state import Phase

NOW: Final = UNSET_INT
"""Stands for the instant at which the recorder takes an event."""

Fact = TypeVar("Fact", bound=TaskFact)


@dataclass(frozen=True, slots=True)
class TaskHandle:
    """One execution being recorded."""

    recorder: EventRecorder
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
        self.recorder.record(_of(TaskStarted, self.fact, time_ns))
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
                _of(TaskEnded, self.fact, time_ns),
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
        self.recorder.record(replace(_of(TaskPaused, self.fact, time_ns), cause=str(cause), reason=reason))

    def resume(self, *, time_ns: int | None = None) -> None:
        """Record that the execution went on."""
        self.recorder.record(_of(TaskResumed, self.fact, time_ns))


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


def _of(kind: type[Fact], fact: TaskFact, time_ns: int | None) -> Fact:
    """Return an event of another kind on the same execution."""
    return kind(
        time_ns=instant(time_ns),
        agent=fact.agent,
        task=fact.task,
        execution_id=fact.execution_id,
        task_type=fact.task_type,
        role=fact.role,
        attempt=fact.attempt,
        item_id=fact.item_id,
        command_id=fact.command_id,
        parent_execution_id=fact.parent_execution_id,
    )
