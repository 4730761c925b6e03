"""Record a run: tasks, pauses, safety changes, signals, as events that survive the process."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

from hrclog.errors import IllegalEventError
from hrclog.events import (
    AnnotationAdded,
    Cause,
    ClockSynced,
    CommandRejected,
    Event,
    Heartbeat,
    Outcome,
    PlanChanged,
    Role,
    RunEnded,
    RunStarted,
    SafetyStateChanged,
    TaskDispatched,
    TaskEnded,
    TaskFact,
    TaskPaused,
    TaskResumed,
    TaskStarted,
)
from hrclog.ids import new_id
from hrclog.log.recover import recover
from hrclog.log.writer import (
    PARTIAL_SUFFIX,
    RUN_METADATA,
    FloatSignal,
    JointSignal,
    Journal,
    Lanes,
    event_message,
    run_metadata,
    signal_message,
)
from hrclog.recorders.segments import first_segment, next_segment
from hrclog.state import PLANNED, ExecutionState, Phase, apply


TaskEvent = TypeVar("TaskEvent", bound=TaskFact)


def steady_clock() -> Callable[[], int]:
    """Return a clock of ns since the epoch that never runs backwards, whatever is done to the system's clock."""
    offset = time.time_ns() - time.monotonic_ns()
    return lambda: offset + time.monotonic_ns()


@dataclass(frozen=True, slots=True)
class TaskHandle:
    """One execution being recorded."""

    recorder: Recorder
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
        self.recorder.record(_of(TaskStarted, self, time_ns))
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
        ended = _of(TaskEnded, self, time_ns)
        self.recorder.record(
            replace(
                ended,
                outcome=str(outcome),
                reason=reason,
                planned_duration_s=planned_duration_s,
                planning_time_s=planning_time_s,
                path_length=path_length,
                target=target,
                details=dict(details or {}),
            )
        )

    def pause(self, cause: str = Cause.OPERATOR, reason: str = "", *, time_ns: int | None = None) -> None:
        """Record that the execution was halted."""
        self.recorder.record(replace(_of(TaskPaused, self, time_ns), cause=str(cause), reason=reason))

    def resume(self, *, time_ns: int | None = None) -> None:
        """Record that the execution went on."""
        self.recorder.record(_of(TaskResumed, self, time_ns))


class Recorder:
    """Record the events of one run into a log.

    While it records, events go to `PATH.partial`; `close` turns that into the finished log. When a method has returned,
    its event survives the process. Methods may be called from any thread. Instants are ns since the epoch and default
    to now.

    Args:
        path: the log to be, `NAME.mcap`.
        run: name of the run; default the file's.
        agents: who takes part, if known.
        plan: the plan to be followed, anything that JSON can hold.
        task_properties: a snapshot of what is known of the tasks, anything that JSON can hold.
        dispatch_mode: how tasks are handed out.
        software: names and versions worth keeping.
        seed: of whatever is random.
        resume: continue the run that is at `path`, in a further segment beside it.
        fsync: each event also survives a crash of the operating system, at 1-4 ms per event.
        clock_ns: the recorder's clock.

    Raises:
        LogExistsError: a log or journal is there already.
        LogWriteError: the log cannot be written.
    """

    def __init__(
        self,
        path: str | Path,
        run: str = "",
        *,
        agents: Sequence[str] = (),
        plan: Any = None,  # noqa: ANN401 - anything that JSON can hold
        task_properties: Any = None,  # noqa: ANN401 - anything that JSON can hold
        dispatch_mode: str = "",
        software: Mapping[str, str] | None = None,
        seed: int | None = None,
        resume: bool = False,
        fsync: bool = False,
        clock_ns: Callable[[], int] | None = None,
    ) -> None:
        target = Path(path) if Path(path).suffix == ".mcap" else Path(f"{path}.mcap")
        segment = next_segment(target) if resume else first_segment(target)
        self.path = segment.path
        self.run_id = segment.run_id
        self._clock_ns = clock_ns or steady_clock()
        self._lock = threading.RLock()
        self._seq = segment.next_seq
        self._states: dict[str, ExecutionState] = dict(segment.states)
        self._facts: dict[str, TaskFact] = dict(segment.facts)
        self._lanes = Lanes()
        self._ended = False
        self._journal: Journal | None = Journal(self.path.with_name(self.path.name + PARTIAL_SUFFIX), fsync=fsync)
        started = RunStarted(
            time_ns=self._clock_ns(),
            name=run or segment.name or target.stem,
            agents=tuple(agents),
            plan=plan,
            task_properties=task_properties,
            dispatch_mode=dispatch_mode,
            software=dict(software or {}),
            seed=seed,
            segment=segment.number,
        )
        recorded = self.record(started)
        assert isinstance(recorded, RunStarted)  # noqa: S101 - record keeps the type
        self._journal.metadata(RUN_METADATA, run_metadata(recorded))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        outcome, reason = _outcome_of(error)
        self.close(outcome, reason)

    @contextmanager
    def task(self, agent: str, task: str, **fields: Any) -> Iterator[TaskHandle]:  # noqa: ANN401 - see start
        """Record a task from here to the end of the block.

        An exception ends it as `failed` with its reason and goes on; an interrupt as `canceled`. A block that has ended
        the task itself has the last word. Arguments as for `start`.
        """
        handle = self.start(agent, task, **fields)
        try:
            yield handle
        except BaseException as error:
            outcome, reason = _outcome_of(error)
            self._end_if_open(handle, outcome, reason)
            raise
        self._end_if_open(handle, Outcome.SUCCEEDED, "")

    def start(
        self,
        agent: str,
        task: str,
        *,
        time_ns: int | None = None,
        agent_time_ns: int | None = None,
        execution_id: str = "",
        task_type: str = "",
        role: str = Role.PRIMARY,
        attempt: int = 1,
        item_id: str = "",
        parent_execution_id: str = "",
        planned_start_ns: int | None = None,
        planned_end_ns: int | None = None,
        details: Mapping[str, Any] | None = None,
    ) -> TaskHandle:
        """Record that an agent began a task.

        Args:
            agent: who.
            task: what.
            time_ns: when it happened.
            agent_time_ns: the same instant on the agent's own clock.
            execution_id: default a new one.
            task_type: for example pick or place.
            role: auxiliary ones count in timelines only.
            attempt: 2 for the first retry.
            item_id: plan item, shared by its attempts.
            parent_execution_id: of the sequence that this is a step of.
            planned_start_ns: on the recorder's clock.
            planned_end_ns: on the recorder's clock.
            details: anything else that JSON can hold.

        Raises:
            InvalidEventError: a field is not of the form the vocabulary asks for.
            IllegalEventError: the execution has started before, or the recorder is closed.
            LogWriteError: the disk did not take it.
        """
        event = TaskStarted(
            time_ns=self._now(time_ns),
            agent_time_ns=agent_time_ns,
            agent=agent,
            task=task,
            execution_id=execution_id or new_id(),
            task_type=task_type,
            role=str(role),
            attempt=attempt,
            item_id=item_id,
            parent_execution_id=parent_execution_id,
            planned_start_ns=planned_start_ns,
            planned_end_ns=planned_end_ns,
            details=dict(details or {}),
        )
        self.record(event)
        return TaskHandle(self, event)

    def dispatch(
        self,
        agent: str,
        task: str,
        *,
        planned_start_ns: int | None = None,
        planned_end_ns: int | None = None,
        time_ns: int | None = None,
        **fields: Any,  # noqa: ANN401 - further fields of TaskDispatched
    ) -> TaskHandle:
        """Record that a task was handed to its agent; start it with the handle's `start`."""
        event = TaskDispatched(
            time_ns=self._now(time_ns),
            agent=agent,
            task=task,
            execution_id=fields.pop("execution_id", "") or new_id(),
            planned_start_ns=planned_start_ns,
            planned_end_ns=planned_end_ns,
            **fields,
        )
        self.record(event)
        return TaskHandle(self, event)

    def end(self, execution: TaskHandle | str, outcome: str = Outcome.SUCCEEDED, reason: str = "", **fields: Any) -> None:  # noqa: ANN401 - see TaskHandle.end
        """Record how an execution ended, by its handle or id."""
        self.handle(execution).end(outcome, reason, **fields)

    def pause(self, execution: TaskHandle | str, cause: str = Cause.OPERATOR, reason: str = "") -> None:
        """Record that an execution was halted."""
        self.handle(execution).pause(cause, reason)

    def resume(self, execution: TaskHandle | str) -> None:
        """Record that an execution went on."""
        self.handle(execution).resume()

    def safety(
        self, agent: str, mode: str, speed_scale: float | None = None, zone: str = "", *, time_ns: int | None = None
    ) -> None:
        """Record that the safety function changed an agent's mode or speed scale (0 stopped .. 1 full speed)."""
        self.record(
            SafetyStateChanged(
                time_ns=self._now(time_ns), agent=agent, mode=mode, speed_scale=speed_scale, zone=zone
            )
        )

    def signal(self, name: str, value: float, *, time_ns: int | None = None) -> None:
        """Record a sample of a scalar signal."""
        with self._lock:
            now = self._clock_ns()
            sample = FloatSignal(self.run_id, name, now if time_ns is None else time_ns, float(value))
            self._open_journal().append(signal_message(sample, now))

    def joints(
        self, agent: str, names: Sequence[str], positions: Sequence[float], *, time_ns: int | None = None
    ) -> None:
        """Record an agent's joint positions, rad or m."""
        with self._lock:
            now = self._clock_ns()
            at = now if time_ns is None else time_ns
            sample = JointSignal(self.run_id, agent, at, tuple(names), tuple(map(float, positions)))
            self._open_journal().append(signal_message(sample, now))

    def annotate(self, text: str, execution: TaskHandle | str = "") -> None:
        """Record a remark on the run, or on one execution; a correction is a remark too, nothing is ever edited."""
        fact = self.handle(execution).fact if execution else None
        about = {} if fact is None else {"execution_id": fact.execution_id, "agent": fact.agent, "task": fact.task}
        self.record(AnnotationAdded(time_ns=self._clock_ns(), reason=text, **about))

    def reject(self, command_id: str, reason: str, *, agent: str = "", task: str = "", execution_id: str = "") -> None:
        """Record that a command was refused."""
        self.record(
            CommandRejected(
                time_ns=self._clock_ns(), command_id=command_id, reason=reason, agent=agent, task=task,
                execution_id=execution_id,
            )
        )

    def sync_clock(self, agent: str, agent_time_ns: int) -> None:
        """Record what an agent's clock reads now."""
        self.record(ClockSynced(time_ns=self._clock_ns(), agent=agent, agent_time_ns=agent_time_ns))

    def change_plan(self, plan: Any, reason: str = "") -> None:  # noqa: ANN401 - anything that JSON can hold
        """Record that another plan is followed from now on."""
        self.record(PlanChanged(time_ns=self._clock_ns(), plan=plan, reason=reason))

    def heartbeat(self, agent: str = "") -> None:
        """Record that an agent, or the recorder itself, is alive."""
        self.record(Heartbeat(time_ns=self._clock_ns(), agent=agent))

    def record(self, event: Event) -> Event:
        """Record any event; its run_id and seq are set here. Returns the event as it was written.

        Raises:
            InvalidEventError: a field is not of the form the vocabulary asks for.
            IllegalEventError: the state machine does not allow it, or the recorder is closed; nothing was written.
            LogWriteError: the disk did not take it.
        """
        with self._lock:
            journal = self._open_journal()
            if self._ended:
                raise IllegalEventError(f"{self.path}: found {event.kind} after run_ended, expected nothing more")
            numbered = replace(event, run_id=self.run_id, seq=self._seq)
            state = self._next_state(numbered)
            now = self._clock_ns()
            message = event_message(numbered, now)
            journal.append(message, *self._lanes.after(numbered, now))
            self._seq += 1
            self._ended = isinstance(numbered, RunEnded)
            if isinstance(numbered, TaskFact) and state is not None:
                self._states[numbered.execution_id] = state
                self._facts.setdefault(numbered.execution_id, numbered)
            return numbered

    def handle(self, execution: TaskHandle | str) -> TaskHandle:
        """Return the handle of an execution by its id.

        Raises:
            IllegalEventError: no execution of this run has that id.
        """
        if isinstance(execution, TaskHandle):
            return execution
        with self._lock:
            if execution not in self._facts:
                raise IllegalEventError(f"{self.path}: found execution {execution!r}, expected one that was started here")
            return TaskHandle(self, self._facts[execution])

    def state(self, execution_id: str) -> ExecutionState:
        """Return the state of an execution; planned if it is not known."""
        with self._lock:
            return self._states.get(execution_id, PLANNED)

    def open_executions(self) -> list[TaskHandle]:
        """Return the executions that have begun and not ended, in order of their start."""
        with self._lock:
            return [
                TaskHandle(self, self._facts[execution_id])
                for execution_id, state in self._states.items()
                if state.phase in (Phase.STARTED, Phase.PAUSED)
            ]

    def close(self, outcome: str = Outcome.SUCCEEDED, reason: str = "") -> None:
        """End the run and finish the log; tasks still open stay open. Closing twice does nothing.

        Raises:
            LogWriteError: the finished log could not be written; the journal holds everything, see `hrclog recover`.
        """
        with self._lock:
            if self._journal is None:
                return
            if not self._ended:
                self.record(RunEnded(time_ns=self._clock_ns(), outcome=str(outcome), reason=reason))
            journal, self._journal = self._journal, None
            journal.close()
            recover(journal.path, self.path)

    def _next_state(self, event: Event) -> ExecutionState | None:
        if not isinstance(event, TaskFact):
            return None
        state, problem = apply(self._states.get(event.execution_id, PLANNED), event)
        if problem and problem not in ("missing_identity", "invalid_outcome"):  # those two have clearer errors below
            raise IllegalEventError(
                f"{self.path}: {event.kind} of {event.agent!r}, {event.task!r} is not allowed ({problem}); "
                f"the execution is {self.state(event.execution_id).phase}"
            )
        return state

    def _open_journal(self) -> Journal:
        if self._journal is None:
            raise IllegalEventError(f"{self.path}: the recorder is closed; continue the run with resume=True")
        return self._journal

    def _end_if_open(self, handle: TaskHandle, outcome: str, reason: str) -> None:
        if handle.phase is not Phase.ENDED:
            handle.end(outcome, reason)

    def _now(self, time_ns: int | None) -> int:
        return self._clock_ns() if time_ns is None else time_ns

    def now_ns(self) -> int:
        """Return the recorder's clock."""
        return self._clock_ns()


def _of(kind: type[TaskEvent], handle: TaskHandle, time_ns: int | None) -> TaskEvent:
    """Return an event of another kind on the same execution."""
    fact = handle.fact
    return kind(
        time_ns=handle.recorder.now_ns() if time_ns is None else time_ns,
        agent=fact.agent,
        task=fact.task,
        execution_id=fact.execution_id,
        task_type=fact.task_type,
        role=fact.role,
        attempt=fact.attempt,
        item_id=fact.item_id,
        parent_execution_id=fact.parent_execution_id,
    )


def _outcome_of(error: BaseException | None) -> tuple[str, str]:
    if error is None:
        return Outcome.SUCCEEDED, ""
    outcome = Outcome.FAILED if isinstance(error, Exception) else Outcome.CANCELED
    return outcome, f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
