"""The life of one execution as a pure function: planned -> (dispatched ->) started <-> paused -> ended.

Dispatcher, operator page, simulator and reader share it. A step it does not allow changes nothing and is named.
An execution that never started may still be closed: by `skipped` or `canceled` at any time, and, once
dispatched, by any outcome but `succeeded`. An end with an outcome outside the vocabulary still ends its execution, as
`unknown`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

from hrclog.events import (
    UNKNOWN_OUTCOME,
    Outcome,
    TaskDispatched,
    TaskEnded,
    TaskFact,
    TaskPaused,
    TaskResumed,
    TaskStarted,
)


class Phase(StrEnum):
    """Where an execution stands."""

    PLANNED = "planned"
    DISPATCHED = "dispatched"
    STARTED = "started"
    PAUSED = "paused"
    ENDED = "ended"


@dataclass(frozen=True, slots=True)
class ExecutionState:
    """All that later events of an execution depend on; instants in ns on the recorder's clock."""

    phase: Phase = Phase.PLANNED
    agent: str = ""
    task: str = ""
    start_ns: int | None = None
    end_ns: int | None = None
    outcome: str = ""
    paused_ns: int = 0
    paused_since_ns: int | None = None


PLANNED: Final = ExecutionState()

_UNSTARTED: Final = (Phase.PLANNED, Phase.DISPATCHED)
_CLOSES_UNDISPATCHED: Final = (Outcome.SKIPPED, Outcome.CANCELED)
_OUTCOMES: Final = frozenset(Outcome)


def apply(state: ExecutionState, event: TaskFact) -> tuple[ExecutionState, str | None]:  # noqa: PLR0911 - one return a step
    """Return the state after an event, and None or the diagnostic code of why the event is not allowed.

    Args:
        state: the execution so far; `PLANNED` before its first event.
        event: the next event of that execution, in order of (time, seq).
    """
    problem = _violation(state, event)
    if problem:
        return state, problem
    match event:
        case TaskDispatched():
            return replace(state, phase=Phase.DISPATCHED, agent=event.agent, task=event.task), None
        case TaskStarted():
            return replace(state, phase=Phase.STARTED, agent=event.agent, task=event.task, start_ns=event.time_ns), None
        case TaskPaused():
            return replace(state, phase=Phase.PAUSED, paused_since_ns=event.time_ns), None
        case TaskResumed():
            return _close_pause(replace(state, phase=Phase.STARTED), event.time_ns), None
        case TaskEnded():
            is_valid = event.outcome in _OUTCOMES or not event.outcome  # an end may tell none
            ended = replace(
                _close_pause(state, event.time_ns),
                phase=Phase.ENDED,
                agent=event.agent,
                task=event.task,
                end_ns=event.time_ns,
                outcome=event.outcome if is_valid else UNKNOWN_OUTCOME,
            )
            return ended, None if is_valid else "invalid_outcome"
    return state, None


def _violation(state: ExecutionState, event: TaskFact) -> str | None:  # noqa: PLR0911 - one return a rule
    if not (event.agent and event.task and event.execution_id):
        return "missing_identity"
    phase = state.phase
    if isinstance(event, TaskStarted) and phase not in _UNSTARTED:
        return "duplicate_start"
    if phase is Phase.ENDED:
        return "event_after_end"
    if phase is not Phase.PLANNED and (event.agent, event.task) != (state.agent, state.task):
        return "identity_changed"
    match event:
        case TaskDispatched():
            return None if phase is Phase.PLANNED else "dispatch_after_start"
        case TaskPaused() | TaskResumed() if phase in _UNSTARTED:
            return "pause_without_start"
        case TaskPaused():
            return "pause_while_paused" if phase is Phase.PAUSED else None
        case TaskResumed():
            return None if phase is Phase.PAUSED else "resume_without_pause"
        case TaskEnded() if phase in _UNSTARTED:
            return None if _may_close_unstarted(phase, event.outcome) else "end_without_start"
    return None


def _may_close_unstarted(phase: Phase, outcome: str) -> bool:
    if phase is Phase.PLANNED:
        return outcome in _CLOSES_UNDISPATCHED
    return outcome in _OUTCOMES and outcome != Outcome.SUCCEEDED


def _close_pause(state: ExecutionState, now_ns: int) -> ExecutionState:
    if state.paused_since_ns is None:
        return state
    return replace(state, paused_ns=state.paused_ns + now_ns - state.paused_since_ns, paused_since_ns=None)
