"""The discrete-event cell: each agent works at a rate that depends on what the others do.

Work W of an execution is drawn once; while it runs it is done at the product over the other agents of 1 / s, so that
the integral of that rate over the execution is W: an accelerated failure time model with time-varying concurrency.
Instants are whole nanoseconds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final

from hrclog.events import (
    Cause,
    Event,
    Outcome,
    SafetyStateChanged,
    TaskEnded,
    TaskPaused,
    TaskResumed,
    TaskStarted,
    event_on,
)
from hrclog.recorders.clock import Clock
from hrclog.recorders.executors.protocol import Command, Emit, Executor
from hrclog.sim.scenario import AgentTask, Scenario
from hrclog.sim.stream import Stream
from hrclog.sim.truth import ExecutionTruth, PairTruth
from hrclog.units import NS_PER_S

if TYPE_CHECKING:
    from hrclog.log.messages.encode import Signal

_END, _BEGIN = 0, 1  # what ends at an instant ends before anything begins there: touching intervals do not overlap


@dataclass(slots=True)
class _Execution:
    """An execution under way; work and what remains of it are in ns at rate 1."""

    command: Command
    key: AgentTask
    outcome: Outcome
    reason: str
    work_ns: float
    planning_time_s: float | None
    path_length: float | None
    target: str
    remaining_ns: float = 0.0
    rate: float = -1.0
    since_ns: int = 0
    version: int = 0
    paused: bool = False


class DiscreteCell:
    """An executor for all agents of a scenario, in simulated time.

    Args:
        scenario: how the agents behave.
        clock: what is going to happen; simulated, or real for a cell that people watch.
        streams: random numbers of each agent; what one agent draws does not depend on the others' timing.
    """

    name: Final = "events"
    pairs: tuple[PairTruth, ...] = ()
    contacts: int | None = None

    prompt: Final = True

    def __init__(self, scenario: Scenario, clock: Clock, streams: Mapping[str, Stream]) -> None:
        self.truth: list[ExecutionTruth] = []
        self.signals: list[Signal] = []
        self._scenario = scenario
        self._clock = clock
        self._streams = streams
        self._emit: Emit = lambda _: None
        self._open_executions: dict[str, _Execution] = {}  # by execution id: accepted and not ended
        self._running: dict[str, _Execution] = {}  # by agent
        self._safety_states: dict[str, tuple[str, float]] = {}
        self._targets = {task.name: list(task.targets) for task in scenario.problem.tasks}
        self._chosen_targets: dict[str, str] = {}  # by item

    @property
    def agents(self) -> tuple[str, ...]:
        """The agents of the scenario."""
        return self._scenario.problem.agents

    def connect(self, emit: Emit) -> None:
        """Send all events to `emit` from now on."""
        self._emit = emit

    @property
    def executors(self) -> dict[str, Executor]:
        """The cell itself, for each agent."""
        return dict.fromkeys(self.agents, self)

    def watch(self) -> None:
        """Say the first safety state of each agent that is watched."""
        for agent in self._scenario.safety.agents:
            self._emit_safety_state(agent, 1.0)

    def stop(self) -> None:
        """Do nothing: without work, nothing happens here."""

    def start(self, command: Command) -> None:
        """Begin a command after the agent's gap."""
        execution, gap_ns = self._draw_execution(command)
        self._open_executions[command.execution_id] = execution
        self._clock.schedule(self._clock.now_ns + gap_ns, partial(self._begin, execution), _BEGIN)

    def cancel(self, execution_id: str, reason: str) -> None:
        """End an execution as canceled, now."""
        execution = self._open_executions.get(execution_id)
        if execution is None:
            return
        execution.outcome, execution.reason = Outcome.CANCELED, reason
        if self._running.get(execution.key[0]) is execution:
            self._advance(execution)
            done_ns = execution.work_ns - execution.remaining_ns
            if execution.path_length is not None:
                execution.path_length *= done_ns / execution.work_ns
            execution.work_ns = done_ns
            self._finish(execution)
        else:
            execution.path_length = execution.planning_time_s = None
            execution.target = ""
            del self._open_executions[execution_id]
            self._emit(self._end_event(execution))

    def _draw_execution(self, command: Command) -> tuple[_Execution, int]:
        """Draw all random numbers of an attempt, always the same number of them, and the gap before it in ns."""
        key = (command.agent, command.task)
        work, stream = self._scenario.work[key], self._streams[command.agent]
        gap = self._scenario.gap.get(command.agent)
        gap_s = stream.lognormal(gap.mu, gap.sigma) if gap else 0.0
        work_ns = stream.lognormal(work.time.mu, work.time.sigma) * NS_PER_S
        path_length = work.path_length * work_ns / NS_PER_S / work.time.median_s
        fails = stream.uniform() < work.failure_probability
        share = 0.05 + 0.9 * stream.uniform()
        planning = work.planning
        execution = _Execution(
            command,
            key,
            outcome=Outcome.FAILED if fails else Outcome.SUCCEEDED,
            reason=work.failure_reason if fails else "",
            work_ns=work_ns * share if fails else work_ns,
            planning_time_s=stream.lognormal(planning.mu, planning.sigma) if planning else None,
            path_length=path_length * (share if fails else 1.0) or None,
            target=self._choose_target(command, stream.uniform()),
        )
        return execution, round(gap_s * NS_PER_S)

    def _choose_target(self, command: Command, chance: float) -> str:
        """Return one of the remaining objects. A retry keeps its object."""
        targets = self._targets[command.task]
        if command.item_id not in self._chosen_targets and targets:
            self._chosen_targets[command.item_id] = targets.pop(int(chance * len(targets)))
        return self._chosen_targets.get(command.item_id, "")

    def _begin(self, execution: _Execution) -> None:
        command = execution.command
        if command.execution_id not in self._open_executions:
            return
        execution.since_ns = self._clock.now_ns
        execution.remaining_ns = execution.work_ns
        self._running[command.agent] = execution
        self._emit(
            event_on(
                TaskStarted,
                command,
                time_ns=self._clock.now_ns,
                planned_start_ns=command.planned_start_ns,
                planned_end_ns=command.planned_end_ns,
            )
        )
        self._update_rates()

    def _end(self, execution: _Execution, version: int) -> None:
        if execution.version == version:
            self._finish(execution)

    def _finish(self, execution: _Execution) -> None:
        command = execution.command
        execution.version += 1
        del self._running[command.agent]
        del self._open_executions[command.execution_id]
        self.truth.append(
            ExecutionTruth(
                command.execution_id,
                command.item_id,
                command.agent,
                command.task,
                command.attempt,
                execution.outcome,
                execution.work_ns / NS_PER_S,
            )
        )
        self._emit(self._end_event(execution))
        self._update_rates()

    def _end_event(self, execution: _Execution) -> TaskEnded:
        command = execution.command
        planned = command.planned_end_ns is not None and command.planned_start_ns is not None
        return event_on(
            TaskEnded,
            command,
            time_ns=self._clock.now_ns,
            outcome=execution.outcome,
            reason=execution.reason,
            planned_duration_s=self._scenario.durations_s[execution.key] if planned else None,
            planning_time_s=execution.planning_time_s,
            path_length=execution.path_length,
            target=execution.target,
        )

    def _update_rates(self) -> None:
        """Set every rate from the running executions, and reschedule their ends."""
        for execution in self._running.values():
            rate = self._rate(execution)
            if rate != execution.rate:
                self._advance(execution)
                execution.rate = rate
                execution.version += 1
                self._schedule_end(execution)
        for agent in self._scenario.safety.agents:
            running = self._running.get(agent)
            self._emit_safety_state(agent, min(running.rate, 1.0) if running else 1.0)

    def _rate(self, execution: _Execution) -> float:
        row = self._scenario.rates[execution.key]
        rate = 1.0
        for other in self._running.values():
            rate *= row.get(other.key, 1.0)
        return rate

    def _advance(self, execution: _Execution) -> None:
        now_ns = self._clock.now_ns
        execution.remaining_ns -= (now_ns - execution.since_ns) * max(execution.rate, 0.0)
        execution.since_ns = now_ns

    def _schedule_end(self, execution: _Execution) -> None:
        if execution.rate > 0.0:
            end_ns = execution.since_ns + round(execution.remaining_ns / execution.rate)
            self._clock.schedule(end_ns, partial(self._end, execution, execution.version), _END)

    def _emit_safety_state(self, agent: str, scale: float) -> None:
        mode = "stopped" if scale == 0.0 else "reduced" if scale < 1.0 else "normal"
        if self._safety_states.get(agent) != (mode, scale):
            self._safety_states[agent] = (mode, scale)
            self._emit(
                SafetyStateChanged(
                    time_ns=self._clock.now_ns,
                    agent=agent,
                    mode=mode,
                    speed_scale=scale,
                    zone=self._scenario.safety.zone if scale < 1.0 else "",
                )
            )
        execution = self._running.get(agent)
        if execution is not None and execution.paused != (scale == 0.0):
            execution.paused = not execution.paused
            self._emit(self._pause_event(execution))

    def _pause_event(self, execution: _Execution) -> Event:
        command = execution.command
        kind: type[TaskPaused | TaskResumed] = TaskPaused if execution.paused else TaskResumed
        return event_on(
            kind,
            command,
            time_ns=self._clock.now_ns,
            cause=Cause.SAFETY,
        )


def discrete_cell(scenario: Scenario, clock: Clock, seed: int, index: int) -> DiscreteCell:
    """Return a new cell for one run.

    Args:
        scenario: what the cell is like.
        clock: stands at the start of the run.
        seed: of the campaign.
        index: number of the run in the campaign.
    """
    return DiscreteCell(
        scenario, clock, {agent: Stream(seed, index, "agent", agent) for agent in scenario.problem.agents}
    )
