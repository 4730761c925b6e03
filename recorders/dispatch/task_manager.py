"""Manage each command between dispatcher and executor: check it, hand it over, follow it, limit its time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, Final

from hrclog.errors import IllegalEventError, InvalidEventError, LogWriteError
from hrclog.events import (
    AnnotationAdded,
    ClockSynced,
    CommandRejected,
    Event,
    Heartbeat,
    Outcome,
    SafetyStateChanged,
    TaskDispatched,
    TaskEnded,
    TaskFact,
    TaskStarted,
    event_on,
    identity,
)
from hrclog.planning.problem import Problem
from hrclog.recorders.clock import Clock
from hrclog.recorders.dispatch.policy import DispatchPolicy
from hrclog.recorders.executors.protocol import Command, Emit, Executor, rejection
from hrclog.state import PLANNED, ExecutionState, Phase, apply
from hrclog.units import NS_PER_S

AFTER_ALL: Final = 9
"""Priority of actions that run after all other actions of the same instant."""

OnEnd = Callable[[Command, TaskEnded, bool], None]
"""Told of every end: the command, its last event, and whether another attempt makes sense."""

_PASSED_ON: Final = (SafetyStateChanged, Heartbeat, ClockSynced, AnnotationAdded)
_TIMED_OUT_IF: Final = (Outcome.CANCELED, Outcome.FAILED)


@dataclass(slots=True)
class _Execution:
    """A command that was handed out, and its state."""

    command: Command
    executor: Executor | None
    timeout_s: float | None
    state: ExecutionState = PLANNED
    last_ns: int = 0
    limit: str = ""  # the limit that it exceeded
    canceled: bool = False

    def over(self) -> bool:
        """Return whether it has ended."""
        return self.state.phase is Phase.ENDED


class TaskManager:
    """Hand commands to the executors of their agents, and accept only events that the state machine allows.

    An event of an executor never raises here and is never lost: an event that is not accepted becomes an annotation.

    Args:
        problem: the tasks there are, and who can do them.
        executors: by agent.
        clock: on whose thread everything happens.
        policy: for limits and patience.
        emit: takes every event.
        on_end: told of every end.
    """

    def __init__(
        self,
        problem: Problem,
        executors: Mapping[str, Executor],
        clock: Clock,
        policy: DispatchPolicy,
        emit: Emit,
        on_end: OnEnd,
    ) -> None:
        self.active: dict[str, str] = {}
        """Execution under way, by agent."""
        self.lost: dict[str, str] = {}
        """Why an agent gets nothing more, by agent."""
        self._tasks = {task.name: task for task in problem.tasks}
        self._executors = executors
        self._clock = clock
        self._policy = policy
        self._emit = emit
        self._on_end = on_end
        self._executions: dict[str, _Execution] = {}
        self._steps: dict[str, ExecutionState] = {}
        for executor in {id(executor): executor for executor in executors.values()}.values():
            executor.connect(partial(self._receive, executor))

    def give(self, command: Command, timeout_s: float | None = None) -> None:
        """Hand a command to its agent's executor, or refuse it.

        Args:
            command: what is to be done.
            timeout_s: how long it may take; None for the policy's limit.
        """
        limit_s = self._policy.timeout_s if timeout_s is None else timeout_s
        execution = _Execution(command, self._executors.get(command.agent), limit_s)
        self._executions[command.execution_id] = execution
        self.active[command.agent] = command.execution_id
        self._emit_fact(
            execution,
            TaskDispatched,
            planned_start_ns=command.planned_start_ns,
            planned_end_ns=command.planned_end_ns,
        )
        refusal = self._refusal(command)
        if execution.executor is None or refusal:
            self._refuse(execution, refusal)
            return
        start_s = self._policy.start_timeout_s if self._policy.start_timeout_s is not None else limit_s
        self._schedule_limit(execution, Phase.DISPATCHED, start_s, "did not start within")
        try:
            execution.executor.start(command)
        except LogWriteError:  # of the log itself
            raise
        except Exception as error:  # noqa: BLE001 - an executor is foreign code: its failure is the attempt's
            self._end(execution, Outcome.FAILED, f"executor: {_error_text(error)}")

    def cancel(self, execution_id: str, reason: str) -> None:
        """Ask for the end of an execution; without an answer within the policy's grace it is ended here."""
        execution = self._executions[execution_id]
        if execution.canceled or execution.over() or execution.executor is None:
            return
        execution.canceled = True
        try:
            execution.executor.cancel(execution_id, reason)
        except LogWriteError:
            raise
        except Exception as error:  # noqa: BLE001 - as in `give`
            self._annotate(f"executor of {execution.command.agent!r} could not cancel: {_error_text(error)}", {})
        if not execution.over():
            self._schedule_after(self._policy.grace_s, partial(self._end_unanswered, execution, reason))

    def _refusal(self, command: Command) -> str:
        """Return why a command cannot be handed out, "" if it can."""
        task = self._tasks.get(command.task)
        if task is None:
            return f"task {command.task!r} is unknown, the tasks are {', '.join(self._tasks)}"
        if command.agent not in task.agents:
            return f"{command.agent!r} cannot do {command.task!r}, only {', '.join(task.agents)} can"
        if command.agent not in self._executors:
            return f"no executor acts for {command.agent!r}, only for {', '.join(self._executors) or 'nobody'}"
        return ""

    def _receive(self, executor: Executor, event: Event) -> None:
        self._clock.submit(partial(self._handle_event, executor, event))

    def _handle_event(self, executor: Executor, event: Event) -> None:
        """Accept an executor's event, or keep it as an annotation."""
        if isinstance(event, TaskFact) and event.parent_execution_id:
            self._handle_step(executor, event)
        elif isinstance(event, TaskFact | CommandRejected):
            execution = self._executions.get(str(event.execution_id))
            if execution is None or execution.executor is not executor:
                owner = "unknown" if execution is None else "another executor's"
                self._drop(executor, event, f"execution {event.execution_id!r} is {owner}")
            elif isinstance(event, CommandRejected):
                self._handle_rejection(execution, event)
            else:
                self._handle_fact(execution, event)
        elif isinstance(event, _PASSED_ON):
            self._try_emit(executor, event)
        else:
            self._drop(executor, event, "it is not an executor's to say")

    def _handle_step(self, executor: Executor, event: TaskFact) -> None:
        """Accept a step of a running execution. Its executor chooses the ids of its steps."""
        parent = self._executions.get(str(event.parent_execution_id))
        if parent is None or parent.executor is not executor or parent.over() or event.execution_id in self._executions:
            self._drop(executor, event, f"execution {event.parent_execution_id!r} is none that it can be a step of")
            return
        command = parent.command
        step = replace(event, run_id=command.run_id, item_id=command.item_id, attempt=command.attempt)
        state, problem = apply(self._steps.get(step.execution_id, PLANNED), step)
        if problem is not None:
            self._drop(executor, event, f"{problem} ({state.phase})")
        elif self._try_emit(executor, step):
            self._steps[step.execution_id] = state

    def _handle_rejection(self, execution: _Execution, event: CommandRejected) -> None:
        if execution.over():
            self._drop(execution.executor, event, "the execution has ended")
        else:
            self._refuse(execution, _safe_text(event.reason) or "the executor rejected the command")

    def _handle_fact(self, execution: _Execution, event: TaskFact) -> None:
        if not _is_instant(event.time_ns):
            self._drop(execution.executor, event, f"its instant is {event.time_ns!r}")
            return
        fact = _with_timeout_outcome(execution, _with_command_ids(execution, event))
        state, problem = apply(execution.state, fact)
        if problem is None and self._try_emit(execution.executor, fact):
            self._advance(execution, fact, state)
            return
        if problem is not None:
            self._drop(execution.executor, event, f"{problem} ({execution.state.phase})")
        if isinstance(fact, TaskEnded) and not execution.over() and problem != "identity_changed":
            reason = (
                f"the executor said {_safe_text(fact.outcome)!r}, which is not possible ({problem or 'invalid event'})"
            )
            self._end(execution, Outcome.FAILED, reason)

    def _advance(self, execution: _Execution, fact: TaskFact, state: ExecutionState, *, may_retry: bool = True) -> None:
        """Store the new state of an execution, and act on it."""
        execution.state, execution.last_ns = state, fact.time_ns
        if isinstance(fact, TaskStarted):
            self._schedule_limit(execution, Phase.STARTED, execution.timeout_s, "took longer than")
        elif isinstance(fact, TaskEnded):
            del self.active[fact.agent]
            self._on_end(execution.command, fact, may_retry)

    def _schedule_limit(self, execution: _Execution, phase: Phase, limit_s: float | None, text: str) -> None:
        if limit_s is not None:
            self._schedule_after(limit_s, partial(self._cancel_if_overdue, execution, phase, f"{text} {limit_s:g} s"))

    def _cancel_if_overdue(self, execution: _Execution, phase: Phase, limit: str) -> None:
        """Cancel an execution that has not left a phase in time."""
        current_phase = execution.state.phase
        if (
            current_phase is Phase.ENDED
            or execution.canceled
            or (phase is Phase.DISPATCHED and current_phase is not Phase.DISPATCHED)
        ):
            return
        execution.limit = limit
        self.cancel(execution.command.execution_id, limit)

    def _end_unanswered(self, execution: _Execution, reason: str) -> None:
        """End an execution whose executor did not answer a cancel, and give that agent nothing more."""
        if execution.over():
            return
        agent = execution.command.agent
        self.lost[agent] = f"executor of {agent!r} does not answer"
        silence = f"the executor did not answer the cancel within {self._policy.grace_s:g} s"
        self._end(execution, Outcome.TIMED_OUT, f"{reason}; {silence}", may_retry=False)

    def _refuse(self, execution: _Execution, reason: str) -> None:
        self._emit(rejection(execution.command, time_ns=self._now_ns(execution), reason=reason))
        self._end(execution, Outcome.FAILED, reason, may_retry=False)

    def _end(self, execution: _Execution, outcome: Outcome, reason: str, *, may_retry: bool = True) -> None:
        """End an execution in place of its executor."""
        if execution.over():
            self._annotate(f"executor of {execution.command.agent!r}, after its end: {reason}", {})
            return
        self._emit_fact(execution, TaskEnded, may_retry=may_retry, outcome=outcome, reason=reason)

    def _emit_fact(
        self,
        execution: _Execution,
        kind: type[TaskFact],
        *,
        may_retry: bool = True,
        **facts: Any,  # noqa: ANN401 - fields of `kind`
    ) -> None:
        fact = event_on(kind, execution.command, time_ns=self._now_ns(execution), **facts)
        self._emit(fact)
        self._advance(execution, fact, apply(execution.state, fact)[0], may_retry=may_retry)

    def _try_emit(self, executor: Executor | None, event: Event) -> bool:
        """Return whether an event could be written."""
        try:
            self._emit(event)
        except (InvalidEventError, IllegalEventError) as error:
            self._drop(executor, event, str(error))
            return False
        return True

    def _drop(self, executor: Executor | None, event: object, reason: str) -> None:
        """Keep an executor's event that was not accepted, as an annotation."""
        agents = ", ".join(repr(agent) for agent, owner in self._executors.items() if owner is executor)
        kind = event.kind if isinstance(event, Event) else type(event).__name__
        self._annotate(f"executor of {agents} said {kind}, not taken: {reason}", {"not_taken": _event_fields(event)})

    def _annotate(self, text: str, details: dict[str, Any]) -> None:
        self._emit(AnnotationAdded(time_ns=self._clock.now_ns, reason=_safe_text(text), details=details))

    def _schedule_after(self, seconds: float, action: Callable[[], None]) -> None:
        self._clock.schedule(self._clock.now_ns + round(seconds * NS_PER_S), action, AFTER_ALL)

    def _now_ns(self, execution: _Execution) -> int:
        """Return the current instant, never before the last event of an execution."""
        return max(self._clock.now_ns, execution.last_ns)


def _is_instant(value: object) -> bool:
    return isinstance(value, int)


def _with_command_ids(execution: _Execution, event: TaskFact) -> TaskFact:
    """Return an event with all ids of its command, and no earlier than the previous event of the execution."""
    # a wrong agent or task is reported, not corrected
    ids = identity(execution.command) | {
        "agent": event.agent,
        "task": event.task,
    }
    return replace(event, time_ns=max(event.time_ns, execution.last_ns), **ids)


def _with_timeout_outcome(execution: _Execution, fact: TaskFact) -> TaskFact:
    """Return an end as timed out if a limit caused it. Work that succeeded in spite of the limit stays succeeded."""
    if isinstance(fact, TaskEnded) and execution.limit and fact.outcome in _TIMED_OUT_IF:
        executor_reason = f" ({fact.reason})" if fact.reason not in ("", execution.limit) else ""
        return replace(fact, outcome=Outcome.TIMED_OUT, reason=execution.limit + executor_reason)
    return fact


def _event_fields(event: object) -> dict[str, Any]:
    """Return the fields of an event as JSON values, without unset fields."""
    if not isinstance(event, Event):
        return {"value": _safe_text(repr(event))}
    field_values: dict[str, Any] = {"kind": event.kind}
    for field in fields(event):
        value = getattr(event, field.name)
        with suppress(TypeError, ValueError):  # values that cannot even be compared
            if value not in ("", None, {}, ()):
                field_values[field.name] = value if isinstance(value, int) else _safe_text(value)
    return field_values


def _error_text(error: Exception) -> str:
    return _safe_text(f"{type(error).__name__}: {error}" if str(error) else type(error).__name__)


def _safe_text(value: object) -> str:
    """Return a text that every log can hold."""
    return str(value).encode(errors="backslashreplace").decode()
