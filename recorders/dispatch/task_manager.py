"""Manage each command between dispatcher and executor: check it, hand it over, follow it, limit its time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any, Final

from hrclog.errors import IllegalEventError, InvalidEventError
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
    TaskPaused,
    TaskStarted,
    event_on,
    identity,
)
from hrclog.planning.problem import Problem
from hrclog.recorders.clock import Clock
from hrclog.recorders.dispatch.calls import Call, Caller
from hrclog.recorders.dispatch.limits import Limits, limits_of
from hrclog.recorders.dispatch.policy import DispatchPolicy
from hrclog.recorders.executors.protocol import Command, Emit, Executor, rejection
from hrclog.state import PLANNED, ExecutionState, Phase, apply
from hrclog.units import NS_PER_S

AFTER_ALL: Final = 9
"""Priority of actions that run after all other actions of the same instant."""

OnEnd = Callable[[Command, TaskEnded, bool], None]
"""Told of every end: the command, its last event, and whether another attempt makes sense."""

_LOOK_AGAIN_S: Final = 0.1  # at least, at an execution that pauses
_PASSED_ON: Final = (SafetyStateChanged, Heartbeat, ClockSynced, AnnotationAdded)
_TIMED_OUT_IF: Final = (Outcome.CANCELED, Outcome.FAILED)


@dataclass(slots=True)
class _Execution:
    """A command that was handed out, and its state."""

    command: Command
    executor: Executor | None
    limits: Limits
    call: Call = field(default_factory=Call)
    state: ExecutionState = PLANNED
    last_ns: int = 0
    limit: str = ""  # the limit that it exceeded
    canceled: bool = False
    started_ns: int = 0
    paused_ns: int = 0  # in pauses that are over
    pause_began_ns: int | None = None  # of the pause that goes on

    def over(self) -> bool:
        """Return whether it has ended."""
        return self.state.phase is Phase.ENDED

    def note_pause(self, fact: TaskFact, now_ns: int) -> None:
        """Note when it starts, and when it pauses and goes on."""
        if isinstance(fact, TaskStarted):
            self.started_ns = now_ns
        if self.pause_began_ns is not None:
            self.paused_ns += now_ns - self.pause_began_ns
        self.pause_began_ns = now_ns if isinstance(fact, TaskPaused) else None

    def worked_s(self, now_ns: int) -> float:
        """Return how long it has been under way, pauses not counted."""
        until_ns = now_ns if self.pause_began_ns is None else self.pause_began_ns
        return (until_ns - self.started_ns - self.paused_ns) / NS_PER_S


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
        self._caller = Caller(clock, policy.grace_s)
        self._closed = False
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
        task = self._tasks.get(command.task)
        limits = limits_of(command, timeout_s, self._policy, task, real_time=self._clock.real_time)
        execution = _Execution(command, self._executors.get(command.agent), limits)
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
        self._schedule_limit(execution, Phase.DISPATCHED, limits.start_s, "did not start within")
        if limits.call_s is not None:
            self._schedule_after(limits.call_s, partial(self._cancel_if_mute, execution, limits.call_s))
        self._caller.start(execution.executor, command, execution.call, partial(self._fail_start, execution))

    def close(self) -> None:
        """Let go of the executors: what they say from here on is not heard."""
        self._closed = True
        self._caller.close()

    def cancel(self, execution_id: str, reason: str) -> None:
        """Ask for the end of an execution; without an answer within the policy's grace it is ended here."""
        execution = self._executions[execution_id]
        if execution.canceled or execution.over() or execution.executor is None:
            return
        execution.canceled = True
        ask = partial(execution.executor.cancel, execution_id, reason)
        self._caller.cancel(execution.executor, ask, execution.call, partial(self._tell_failed_cancel, execution))
        if not execution.over():
            self._schedule_after(self._policy.grace_s, partial(self._end_unanswered, execution, reason))

    def _fail_start(self, execution: _Execution, error: BaseException) -> None:
        if not self._closed:
            self._end(execution, Outcome.FAILED, f"executor: {_error_text(error)}")

    def _tell_failed_cancel(self, execution: _Execution, error: BaseException) -> None:
        if not self._closed:
            self._annotate(f"executor of {execution.command.agent!r} could not cancel: {_error_text(error)}", {})

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
        if self._closed:
            return
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
        execution.note_pause(fact, self._clock.now_ns)
        if isinstance(fact, TaskStarted):
            self._schedule_limit(execution, Phase.STARTED, execution.limits.work_s, "took longer than")
        elif isinstance(fact, TaskEnded):
            del self.active[fact.agent]
            self._on_end(execution.command, fact, may_retry)

    def _schedule_limit(self, execution: _Execution, phase: Phase, limit_s: float | None, text: str) -> None:
        if limit_s is not None:
            self._schedule_after(limit_s, partial(self._cancel_if_overdue, execution, phase, limit_s, text))

    def _cancel_if_overdue(self, execution: _Execution, phase: Phase, limit_s: float, text: str) -> None:
        """Cancel an execution that has not left a phase in time."""
        current_phase = execution.state.phase
        if (
            current_phase is Phase.ENDED
            or execution.canceled
            or (phase is Phase.DISPATCHED and current_phase is not Phase.DISPATCHED)
        ):
            return
        if phase is Phase.STARTED and execution.limits.expected:
            left_s = limit_s - execution.worked_s(self._clock.now_ns)
            if left_s > 0.0:  # it paused
                again = partial(self._cancel_if_overdue, execution, phase, limit_s, text)
                self._schedule_after(max(left_s, _LOOK_AGAIN_S), again)
                return
        self._cancel_over_limit(execution, f"{text} {limit_s:g} s")

    def _cancel_if_mute(self, execution: _Execution, limit_s: float) -> None:
        """Cancel an execution whose executor has said nothing so far and is still in `start`."""
        open_text = execution.call.open_text()
        if execution.state.phase is Phase.DISPATCHED and open_text and not execution.canceled:
            self._cancel_over_limit(execution, f"did not start within {limit_s:g} s")

    def _cancel_over_limit(self, execution: _Execution, limit: str) -> None:
        execution.limit = limit
        self.cancel(execution.command.execution_id, limit)

    def _end_unanswered(self, execution: _Execution, reason: str) -> None:
        """End an execution whose executor did not answer a cancel, and give that agent nothing more."""
        if execution.over():
            return
        agent = execution.command.agent
        open_call = execution.call.open_text()
        self.lost[agent] = f"executor of {agent!r} does not answer" + (f" ({open_call})" if open_call else "")
        silence = f"the executor did not answer the cancel within {self._policy.grace_s:g} s"
        reasons = "; ".join(filter(None, (reason, silence, open_call)))
        self._end(execution, Outcome.TIMED_OUT, reasons, may_retry=False)

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
    for name in (entry.name for entry in fields(event)):
        value = getattr(event, name)
        with suppress(TypeError, ValueError):  # values that cannot even be compared
            if value not in ("", None, {}, ()):
                field_values[name] = value if isinstance(value, int) else _safe_text(value)
    return field_values


def _error_text(error: BaseException) -> str:
    return _safe_text(f"{type(error).__name__}: {error}" if str(error) else type(error).__name__)


def _safe_text(value: object) -> str:
    """Return a text that every log can hold."""
    return str(value).encode(errors="backslashreplace").decode()
