"""The common part of the stepped executors: a command from its gap to its end, in ticks.

A task is one skill or a sequence of them. Each skill is planned, moved through, and ends; only time is scaled, so that

    duration of a motion = work (its duration at full speed) + time lost

holds for every execution, to the tick.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final, Protocol

from hrclog.events import Cause, Outcome, Role, TaskEnded, TaskPaused, TaskResumed, TaskStarted, event_on
from hrclog.recorders.clock import Clock
from hrclog.recorders.executors.protocol import Command, Emit
from hrclog.sim.bullet.stock import Stock
from hrclog.sim.cell.description import PICK, PICK_PLACE, PLACE, SEQUENCE, Cell, Point, Skill
from hrclog.sim.scenario import Scenario
from hrclog.sim.stream import Stream
from hrclog.sim.truth import ExecutionTruth
from hrclog.units import NS_PER_S

TICK_NS: Final = 10_000_000
TICK_S: Final = TICK_NS / NS_PER_S

TICK, BEGIN = 0, 1  # what moves up to an instant has moved before anything begins there

_CLOSE: Final = 1e-6


class Motion(Protocol):
    """A motion along a fixed path, by the time it takes at full speed."""

    @property
    def duration_s(self) -> float:
        """How long it takes."""
        ...

    @property
    def grip_at_s(self) -> float:
        """When the gripper or the hand has closed or opened; inf where it does neither."""
        ...


@dataclass(frozen=True, slots=True)
class Step:
    """A planned skill: what it goes to, how, and how long planning takes."""

    skill: Skill
    motion: Motion
    target: str = ""
    position: Point = (0.0, 0.0, 0.0)
    planning_s: float = 0.0
    path_length: float = 0.0


class CannotError(Exception):
    """A skill cannot be begun; the text says why."""


@dataclass(slots=True)
class Execution:
    """A command under way; times in s."""

    command: Command
    skills: deque[Skill]
    fails: bool
    reason: str
    begun_ns: int = 0
    step: Step | None = None
    step_command: Command | None = None
    planning_left: int = 0
    ticks: int = 0
    work_ticks: int = 0
    done_s: float = 0.0
    gripped: bool = False
    planning_s: float = 0.0
    work_s: float = 0.0
    lost_s: float = 0.0
    path_length: float = 0.0
    targets: list[str] = field(default_factory=list)
    paused: bool = False


@dataclass(frozen=True, slots=True)
class Shared:
    """What the executors of a cell have in common.

    Args:
        scenario: gaps and expected durations.
        cell: skills and faults.
        clock: simulated.
        stock: objects and slots.
        new_id: makes ids of sub-steps.
        wake: called when there is something to do.
        truth: takes the truth about each execution that ends.
    """

    scenario: Scenario
    cell: Cell
    clock: Clock
    stock: Stock
    new_id: Callable[[], str]
    wake: Callable[[], None]
    truth: list[ExecutionTruth]


class SteppedExecutor(ABC):
    """Carries out the tasks of one agent, one at a time.

    Args:
        agent: whose.
        shared: with the other executors of the cell.
        stream: random numbers of this agent.
    """

    def __init__(self, agent: str, shared: Shared, stream: Stream) -> None:
        self.agents: tuple[str, ...] = (agent,)
        self.running: Execution | None = None
        self._agent = agent
        self._scenario = shared.scenario
        self._cell = shared.cell
        self._clock = shared.clock
        self._start_ns = shared.clock.now_ns
        self._stock = shared.stock
        self._stream = stream
        self._new_id = shared.new_id
        self._wake = shared.wake
        self._truth = shared.truth
        self._waiting: dict[str, Execution] = {}  # given and not begun
        self._chosen_targets: dict[tuple[str, str, str], str] = {}  # target by item and skill: a retry keeps its own
        self._emit: Emit = lambda _: None

    def connect(self, emit: Emit) -> None:
        """Send all events to `emit` from now on."""
        self._emit = emit

    @property
    def busy(self) -> bool:
        """Whether a command is given that has not ended."""
        return self.running is not None or bool(self._waiting)

    @property
    def moving(self) -> bool:
        """Whether a motion is under way: not so while planning or without a command."""
        return self.running is not None and self.running.step is not None and not self.running.planning_left

    def start(self, command: Command) -> None:
        """Begin a command after the agent's gap."""
        key = (command.agent, command.task)
        gap, fault = self._scenario.gap.get(command.agent), self._cell.fault.get(key)
        gap_s = self._stream.lognormal(gap.mu, gap.sigma) if gap else 0.0
        fails = self._stream.uniform() < (fault.probability if fault else 0.0)
        skill = self._cell.skill[key]
        names = skill.steps if skill.kind == SEQUENCE else (command.task,)
        skills = deque(part for name in names for part in _single_target_skills(self._cell.skill[command.agent, name]))
        execution = Execution(command, skills, fails, fault.reason if fault else "")
        self._waiting[command.execution_id] = execution
        # commands may come between two ticks, but an execution begins at a tick
        begin_ns = self._clock.now_ns - self._start_ns + math.ceil(gap_s / TICK_S) * TICK_NS
        begin_ns = self._start_ns - (-begin_ns // TICK_NS) * TICK_NS
        self._clock.schedule(begin_ns, partial(self._begin, execution), BEGIN)
        self._wake()

    def cancel(self, execution_id: str, reason: str) -> None:
        """End an execution as canceled, now; its motion stops where it is."""
        waiting = self._waiting.pop(execution_id, None)
        if waiting is not None:
            self._emit(
                event_on(
                    TaskEnded, waiting.command, time_ns=self._clock.now_ns, outcome=Outcome.CANCELED, reason=reason
                )
            )
        elif self.running is not None and self.running.command.execution_id == execution_id:
            self._end(self.running, Outcome.CANCELED, reason)

    def step(self, scale: float) -> None:
        """Advance by one tick.

        Args:
            scale: share of full speed that motions go on at.
        """
        execution = self.running
        if execution is None:
            return
        if execution.planning_left:
            execution.planning_left -= 1
            return
        step = execution.step
        if step is None:
            return
        self._update_pause(execution, scale)
        whole_s = execution.work_ticks * TICK_S
        progress_s = min(scale * TICK_S, whole_s - execution.done_s)
        execution.done_s += progress_s
        execution.ticks += 1
        execution.work_s += progress_s
        execution.lost_s += TICK_S - progress_s
        if not execution.gripped and execution.done_s >= step.motion.grip_at_s:
            execution.gripped = True
            self._grip(execution, step)
        if execution.done_s >= whole_s - _CLOSE * TICK_S:
            self._finish_step(execution, step)

    def where(self) -> tuple[Motion, float] | None:
        """Return the motion under way and the time done of it; None while nothing moves."""
        execution = self.running
        if execution is None or execution.step is None or execution.planning_left:
            return None
        return execution.step.motion, execution.done_s

    @abstractmethod
    def plan(self, skill: Skill, execution: Execution) -> Step:
        """Return how a skill is done from where the agent is.

        Raises:
            CannotError: it cannot be done.
        """

    @abstractmethod
    def rest(self, step: Step, done_s: float) -> None:
        """Stay where a motion has come to."""

    def chosen(self, execution: Execution, skill: Skill) -> str:
        """Return what an earlier attempt at the same item chose, "" if none did."""
        return self._chosen_targets.get((execution.command.item_id, skill.task, skill.kind), "")

    def _begin(self, execution: Execution) -> None:
        command = execution.command
        if self._waiting.pop(command.execution_id, None) is None:
            return
        execution.begun_ns = self._clock.now_ns
        self.running = execution
        self._emit(
            event_on(
                TaskStarted,
                command,
                time_ns=self._clock.now_ns,
                planned_start_ns=command.planned_start_ns,
                planned_end_ns=command.planned_end_ns,
            )
        )
        if self.running is execution:
            self._next_step(execution)

    def _next_step(self, execution: Execution) -> None:
        """Plan the next skill, or end."""
        if not execution.skills:
            self._end(execution, Outcome.SUCCEEDED, "")
            return
        skill = execution.skills.popleft()
        self._begin_sub_step(execution, skill)
        try:
            step = self.plan(skill, execution)
        except CannotError as error:
            self._end(execution, Outcome.FAILED, str(error))
            return
        if step.target:
            self._stock.claim(step.target, self._agent)
            self._chosen_targets[execution.command.item_id, skill.task, skill.kind] = step.target
            execution.targets.append(step.target)
        execution.step = step
        execution.planning_left = math.ceil(step.planning_s / TICK_S)
        execution.planning_s += execution.planning_left * TICK_S
        execution.work_ticks = math.ceil(step.motion.duration_s / TICK_S - _CLOSE)
        execution.done_s, execution.gripped = 0.0, False
        execution.path_length += step.path_length
        if not execution.planning_left and not execution.work_ticks:
            self._finish_step(execution, step)

    def _grip(self, execution: Execution, step: Step) -> None:
        if execution.fails:
            execution.skills.clear()
        elif step.skill.kind == PICK:
            self._stock.take(step.target)
        elif step.skill.kind == PLACE:
            held_item = self._stock.held_by(self._agent)
            if held_item is not None:
                self._stock.put(held_item, step.target)

    def _finish_step(self, execution: Execution, step: Step) -> None:
        self.rest(step, execution.work_ticks * TICK_S)
        execution.step = None
        failed = execution.fails and (execution.gripped or math.isinf(step.motion.grip_at_s))
        self._end_sub_step(execution, Outcome.FAILED if failed else Outcome.SUCCEEDED)
        if failed:
            self._stock.give_up(step.target)
            self._end(execution, Outcome.FAILED, execution.reason)
        else:
            self._next_step(execution)

    def _end(self, execution: Execution, outcome: Outcome, reason: str) -> None:
        command = execution.command
        if execution.step is not None:  # cut short
            self.rest(execution.step, execution.done_s)
            self._stock.give_up(execution.step.target)
            whole_s = execution.work_ticks * TICK_S
            unused = 1.0 - execution.done_s / whole_s if whole_s else 0.0
            execution.path_length -= execution.step.path_length * unused
            execution.planning_s -= execution.planning_left * TICK_S
            execution.step = None
        self._end_sub_step(execution, outcome)
        self.running = None
        duration_s = (self._clock.now_ns - execution.begun_ns) / NS_PER_S
        accounted_s = execution.planning_s + execution.work_s + execution.lost_s
        if outcome is Outcome.CANCELED and abs(duration_s - accounted_s) <= TICK_S:
            execution.lost_s += duration_s - accounted_s  # cut short between two ticks
            accounted_s = duration_s
        if abs(duration_s - accounted_s) > _CLOSE:
            raise RuntimeError(f"{command.task} took {duration_s} s, its planning, work and losses {accounted_s} s")
        self._truth.append(
            ExecutionTruth(
                command.execution_id,
                command.item_id,
                command.agent,
                command.task,
                command.attempt,
                str(outcome),
                execution.planning_s + execution.work_s,
                execution.planning_s,
                execution.lost_s,
            )
        )
        planned_s = self._scenario.durations_s.get((command.agent, command.task))
        no_op = outcome is Outcome.SUCCEEDED and duration_s == 0.0
        self._emit(
            event_on(
                TaskEnded,
                command,
                time_ns=self._clock.now_ns,
                outcome=outcome,
                reason=reason,
                planned_duration_s=planned_s,
                planning_time_s=execution.planning_s or None,
                path_length=execution.path_length or None,
                target=execution.targets[-1] if execution.targets else "",
                details={"no_op": True} if no_op else {},
            )
        )

    def _begin_sub_step(self, execution: Execution, skill: Skill) -> None:
        command = execution.command
        if skill.task == command.task:
            return
        execution.step_command = replace(
            command,
            task=skill.task,
            execution_id=self._new_id(),
            command_id="",
            parent_execution_id=command.execution_id,
            role=Role.AUXILIARY,
            task_type=skill.kind,
        )
        self._emit(event_on(TaskStarted, execution.step_command, time_ns=self._clock.now_ns))

    def _end_sub_step(self, execution: Execution, outcome: Outcome) -> None:
        if execution.step_command is None:
            return
        command, execution.step_command = execution.step_command, None
        self._emit(event_on(TaskEnded, command, time_ns=self._clock.now_ns, outcome=outcome))

    def _update_pause(self, execution: Execution, scale: float) -> None:
        if execution.paused != (scale == 0.0):
            execution.paused = not execution.paused
            kind: type[TaskPaused | TaskResumed] = TaskPaused if execution.paused else TaskResumed
            self._emit(event_on(kind, execution.command, time_ns=self._clock.now_ns, cause=self.pause_cause))

    pause_cause: Cause = Cause.SAFETY


def _single_target_skills(skill: Skill) -> list[Skill]:
    """Return a skill as skills that each go to one target."""
    if skill.kind != PICK_PLACE:
        return [skill]
    return [replace(skill, kind=PICK), replace(skill, kind=PLACE)]
