"""Record a run: tasks, pauses, safety changes, signals, as events that survive the process."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from hrclog.errors import InvalidEventError, LogWriteError
from hrclog.events import (
    AnnotationAdded,
    Cause,
    ClockSynced,
    CommandRejected,
    Heartbeat,
    Outcome,
    PlanChanged,
    Role,
    RunStarted,
    SafetyStateChanged,
    TaskDispatched,
    TaskStarted,
)
from hrclog.ids import new_id
from hrclog.log.messages.encode import DescriptionSignal, FloatSignal, JointSignal, PoseSignal, SceneSignal
from hrclog.recorders.event_recorder import EventRecorder, steady_clock
from hrclog.recorders.segments import first_segment, next_segment
from hrclog.recorders.task_handle import NOW, TaskHandle, as_details, instant
from hrclog.tags import checked_tags

__all__ = ["Recorder", "TaskHandle"]


def log_path(path: str | Path) -> Path:
    """Return a path with the ending .mcap; where it is a symbolic link, the file that it points to, there or not.

    Raises:
        LogWriteError: the link leads in a circle, or to a name of another ending.
    """
    given = Path(path)
    log = given if given.suffix == ".mcap" or _is_file_link(given) else Path(f"{given}.mcap")
    if not _is_link(log):
        return log
    target = Path(os.path.realpath(log))
    if _is_link(target):
        raise LogWriteError(log, "is a symbolic link that leads in a circle", "remove it, or choose another name")
    if target.suffix != ".mcap":
        reason = f"is a symbolic link to {target}"
        raise LogWriteError(log, reason, "let it point to a name that ends in .mcap, or choose another name")
    return target


def _is_link(path: Path) -> bool:
    try:
        return path.is_symlink()
    except OSError:  # a name that is too long
        return False


def _is_file_link(path: Path) -> bool:
    return _is_link(path) and not path.is_dir()


class Recorder(EventRecorder):
    """Record the events of one run into a log.

    While it records, events go to `PATH.partial`; `close` turns that into the finished log. When a method has returned,
    its event survives the process. Methods may be called from any thread. Instants are ns since the epoch and default
    to now.

    Args:
        path: the log to be, `NAME.mcap`; a symbolic link is the file that it points to.
        run: name of the run; default the file's.
        agents: who takes part, if known.
        plan: the plan to be followed, anything that JSON can hold.
        task_properties: a snapshot of what is known of the tasks, anything that JSON can hold.
        dispatch_mode: how tasks are handed out.
        software: names and versions worth keeping.
        seed: of whatever is random.
        tags: facts that tell runs apart, by key: the participant, the condition, the trial.
        details: anything else about the run that JSON can hold.
        time_ns: when the run began.
        resume: continue the run that is at `path`, in a further segment beside it.
        fsync: each event also survives a crash of the operating system, at 1-4 ms per event.
        clock_ns: the recorder's clock.

    Raises:
        LogExistsError: a log or journal is there already.
        LogReadError: there is no run to resume, or another recorder is writing it.
        LogWriteError: the log cannot be written.
        InvalidEventError: an argument cannot be written.
    """

    def __init__(  # noqa: PLR0913 - what is known of a run
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
        tags: Mapping[str, str | float] | None = None,
        details: Mapping[str, Any] | None = None,
        time_ns: int | None = None,
        resume: bool = False,
        fsync: bool = False,
        clock_ns: Callable[[], int] | None = None,
    ) -> None:
        check_facts(run, agents, software, seed)
        tags = checked_tags(tags)
        target = log_path(path)
        segment = next_segment(target) if resume else first_segment(target)
        started = RunStarted(
            time_ns=instant(time_ns),
            name=run or segment.name or target.stem,
            agents=tuple(agents),
            plan=plan,
            task_properties=task_properties,
            dispatch_mode=dispatch_mode,
            software=as_details(software),
            seed=seed,
            segment=segment.number,
            tags=tags,
            details=as_details(details),
        )
        super().__init__(segment, started, fsync=fsync, clock_ns=clock_ns or steady_clock())

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

    def start(  # noqa: PLR0913 - the fields of a start
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
            time_ns=instant(time_ns),
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
            details=as_details(details),
        )
        return TaskHandle(self, self.record(event))

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
            time_ns=instant(time_ns),
            agent=agent,
            task=task,
            execution_id=fields.pop("execution_id", "") or new_id(),
            planned_start_ns=planned_start_ns,
            planned_end_ns=planned_end_ns,
            **fields,
        )
        return TaskHandle(self, self.record(event))

    def end(
        self,
        execution: TaskHandle | str,
        outcome: str = Outcome.SUCCEEDED,
        reason: str = "",
        **fields: Any,  # noqa: ANN401 - see TaskHandle.end
    ) -> None:
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
        changed = SafetyStateChanged(
            time_ns=instant(time_ns), agent=agent, mode=mode, speed_scale=speed_scale, zone=zone
        )
        self.record(changed)

    def signal(self, name: str, value: float, *, time_ns: int | None = None) -> None:
        """Record a sample of a scalar signal."""
        self._sample(self._float_signal(name, value, instant(time_ns)))

    def signals(self, values: Mapping[str, float], *, time_ns: int | None = None) -> None:
        """Record samples of scalar signals by their names, at one instant: all of them, or none."""
        time = instant(time_ns)
        self._sample(*[self._float_signal(name, value, time) for name, value in values.items()])

    def _float_signal(self, name: str, value: float, time_ns: int) -> FloatSignal:
        if not isinstance(name, str) or not name.strip():
            raise InvalidEventError(f"{self.path}: found {name!r} as the name of a signal, expected a text")
        return FloatSignal(self.run_id, name, time_ns, _number(value))

    def joints(
        self, agent: str, names: Sequence[str], positions: Sequence[float], *, time_ns: int | None = None
    ) -> None:
        """Record an agent's joint positions, rad or m."""
        self._sample(JointSignal(self.run_id, agent, instant(time_ns), tuple(names), tuple(map(_number, positions))))

    def describe(self, agent: str, urdf: str, *, time_ns: int | None = None) -> None:
        """Record what an agent looks like: the text of a URDF, once per run, with the joints' names of `joints`."""
        self._sample(DescriptionSignal(self.run_id, agent, instant(time_ns), urdf))

    def scene(self, scene: Mapping[str, Any], *, time_ns: int | None = None) -> None:
        """Record what stands in the cell, once per run; what it may hold is in docs/log-format.md."""
        self._sample(SceneSignal(self.run_id, instant(time_ns), scene))

    def pose(
        self,
        name: str,
        position: Sequence[float],
        quaternion: Sequence[float] = (0.0, 0.0, 0.0, 1.0),
        *,
        time_ns: int | None = None,
    ) -> None:
        """Record where an object of the scene is; only while it moves.

        Args:
            name: of the object.
            position: of its centre in the world, m, shape (3,).
            quaternion: its rotation, x, y, z, w, shape (4,).
            time_ns: when.

        Raises:
            InvalidEventError: a field cannot be written.
            LogWriteError: the disk did not take it.
        """
        x, y, z = _numbers("position", position, 3)
        qx, qy, qz, qw = _numbers("quaternion", quaternion, 4)
        self._sample(PoseSignal(self.run_id, name, instant(time_ns), (x, y, z), (qx, qy, qz, qw)))

    def annotate(self, text: str, execution: TaskHandle | str = "") -> None:
        """Record a remark on the run, or on one execution; a correction is a remark too, nothing is ever edited."""
        remark = AnnotationAdded(time_ns=NOW, reason=text)
        if execution:
            fact = self.handle(execution).fact
            remark = replace(remark, execution_id=fact.execution_id, agent=fact.agent, task=fact.task)
        self.record(remark)

    def reject(self, command_id: str, reason: str, *, agent: str = "", task: str = "", execution_id: str = "") -> None:
        """Record that a command was refused."""
        rejected = CommandRejected(
            time_ns=NOW, command_id=command_id, reason=reason, agent=agent, task=task, execution_id=execution_id
        )
        self.record(rejected)

    def sync_clock(self, agent: str, agent_time_ns: int) -> None:
        """Record what an agent's clock reads now."""
        self.record(ClockSynced(time_ns=NOW, agent=agent, agent_time_ns=agent_time_ns))

    def change_plan(self, plan: Any, reason: str = "") -> None:  # noqa: ANN401 - anything that JSON can hold
        """Record that another plan is followed from now on."""
        self.record(PlanChanged(time_ns=NOW, plan=plan, reason=reason))

    def heartbeat(self, agent: str = "") -> None:
        """Record that an agent, or the recorder itself, is alive."""
        self.record(Heartbeat(time_ns=NOW, agent=agent))


def check_facts(run: object, agents: object, software: object, seed: object) -> None:
    """Raise if what is known of a run has the wrong type: these come from users' files too.

    Raises:
        InvalidEventError: says which fact is wrong.
    """
    is_list = isinstance(agents, list | tuple) and all(isinstance(agent, str) and agent.strip() for agent in agents)
    is_map = isinstance(software, Mapping) and all(isinstance(text, str) for text in (*software, *software.values()))
    checks = {
        f"run is {run!r}, expected a name": isinstance(run, str),
        f"agents are {agents!r}, expected a list of names": is_list,
        f"software is {software!r}, expected versions by name": software is None or is_map,
        f"seed is {seed!r}, expected a whole number": seed is None or isinstance(seed, int),
    }
    for text, holds in checks.items():
        if not holds:
            raise InvalidEventError(f"run_started: {text}")


def _number(value: float) -> float:
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidEventError(f"found {value!r}, expected a number") from error


def _numbers(name: str, values: Sequence[float], count: int) -> tuple[float, ...]:
    if len(values) != count:
        raise InvalidEventError(f"pose: found a {name} of {len(values)} numbers, expected {count}")
    return tuple(map(_number, values))


def _outcome_of(error: BaseException | None) -> tuple[str, str]:
    if error is None:
        return Outcome.SUCCEEDED, ""
    outcome = Outcome.FAILED if isinstance(error, Exception) else Outcome.CANCELED
    reason = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return outcome, reason.encode(errors="backslashreplace").decode()
