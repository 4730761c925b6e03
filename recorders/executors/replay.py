"""An executor that replays the executions of a log."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Final

from hrclog.errors import DispatchError
from hrclog.event_rows import from_row
from hrclog.events import Event, Outcome, TaskDispatched, TaskEnded, TaskFact, TaskStarted, event_on
from hrclog.recorders.clock import Clock
from hrclog.recorders.executors.player import Course, Player
from hrclog.recorders.executors.protocol import Command, Emit


class ReplayExecutor:
    """Answer the n-th command of an (agent, task) with its n-th execution in a log: delays, pauses, end and reason.

    A command beyond the log's last execution fails at once.

    Args:
        events: of one run.
        clock: simulated or real.
        agents: to act for; default all of the log.

    Raises:
        DispatchError: an agent has no execution in the log, or there are several runs.
    """

    prompt: Final = True

    def __init__(self, events: Iterable[Event], clock: Clock, agents: Iterable[str] | None = None) -> None:
        recorded = list(events)
        n_runs = len({event.run_id for event in recorded})
        if n_runs > 1:
            raise DispatchError(f"replay: found {n_runs} runs, expected one; give the log of a single run")
        self._recorded = _executions_by_task(recorded)
        recorded_agents = tuple(dict.fromkeys(agent for agent, _ in self._recorded))
        self._agents = recorded_agents if agents is None else tuple(agents)
        for agent in self._agents:
            if agent not in recorded_agents:
                problem = f"the log has no execution of {agent!r}, only of {', '.join(recorded_agents) or 'nobody'}"
                raise DispatchError(f"replay: {problem}; choose another log")
        self._last_ns = max((event.time_ns for event in recorded), default=0)
        self._clock = clock
        self._player = Player(clock)

    @property
    def agents(self) -> tuple[str, ...]:
        """The agents it acts for."""
        return self._agents

    def connect(self, emit: Emit) -> None:
        """Send all events to `emit` from now on."""
        self._player.emit = emit

    def start(self, command: Command) -> None:
        """Replay the next recorded execution of this agent and task."""
        recorded = self._recorded.get((command.agent, command.task), [])
        if recorded:
            self._player.play(command, _course(command, recorded.pop(0), self._last_ns))
            return
        reason = f"the log has no further execution of {command.agent!r}, {command.task!r}"
        now_ns = self._clock.now_ns
        self._player.emit(event_on(TaskEnded, command, time_ns=now_ns, outcome=Outcome.FAILED, reason=reason))

    def cancel(self, execution_id: str, reason: str) -> None:
        """End an execution as canceled, now."""
        self._player.cancel(execution_id, reason)


def read_recorded(path: Path) -> list[Event]:
    """Return the events of a log, in order.

    Raises:
        LogReadError: it cannot be read.
    """
    from hrclog.log.reader import read_events

    return [from_row(row) for row in read_events(path).iter_rows(named=True)]


def _executions_by_task(events: Iterable[Event]) -> dict[tuple[str, str], list[list[TaskFact]]]:
    """Return the facts of every execution that was given to its agent, by (agent, task), in order of time."""
    facts_by_execution: dict[str, list[TaskFact]] = {}
    for event in sorted(events, key=lambda event: (event.time_ns, event.seq)):
        if isinstance(event, TaskFact):
            facts_by_execution.setdefault(event.execution_id, []).append(event)
    executions_by_task: dict[tuple[str, str], list[list[TaskFact]]] = {}
    for facts in facts_by_execution.values():
        if isinstance(facts[0], TaskDispatched | TaskStarted):
            executions_by_task.setdefault((facts[0].agent, facts[0].task), []).append(facts)
    return executions_by_task


def _course(command: Command, facts: list[TaskFact], last_ns: int) -> Course:
    """Return an execution's events as those of another command."""
    origin_ns = facts[0].time_ns
    steps = [
        (fact.time_ns - origin_ns, _fact_of_command(command, fact))
        for fact in facts
        if not isinstance(fact, TaskDispatched)
    ]
    if not isinstance(facts[-1], TaskEnded):
        reason = "the log does not say how it ended"
        end = event_on(TaskEnded, command, time_ns=0, outcome=Outcome.FAILED, reason=reason)
        steps.append((last_ns - origin_ns, end))
    return Course(tuple(steps))


def _fact_of_command(command: Command, fact: TaskFact) -> TaskFact:
    copied = replace(
        fact,
        run_id=command.run_id,
        seq=0,
        agent_time_ns=None,
        execution_id=command.execution_id,
        parent_execution_id="",
    )
    if not isinstance(copied, TaskStarted):
        return copied
    return replace(copied, planned_start_ns=command.planned_start_ns, planned_end_ns=command.planned_end_ns)
