"""An executor that follows a script, misbehaviour included. Use it to try out plans and dispatchers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Final

from hrclog.errors import ScenarioError
from hrclog.events import Outcome, TaskEnded, TaskFact, TaskStarted, event_on
from hrclog.json_record import JsonRecord, read_json
from hrclog.recorders.clock import Clock
from hrclog.recorders.executors.player import Course, Player
from hrclog.recorders.executors.protocol import Command, Emit, rejection
from hrclog.units import NS_PER_S

SCRIPT_VERSION: Final = 1

_STEP_FIELDS: Final = ("agent", "task", "delay_s", "duration_s", "outcome", "reason", "misbehaviour")


class Misbehaviour(StrEnum):
    """How an executor breaks its promises.

    REJECTS: refuses the command. RAISES: fails in `start`. NEVER_STARTS: says nothing, but answers a cancel.
    NEVER_ANSWERS: starts, and says nothing more, even when cancelled. ENDS_TWICE: says the same end again.
    ENDS_UNSTARTED: ends without having started. WRONG_EXECUTION: ends an execution that nobody knows.
    """

    REJECTS = "rejects"
    RAISES = "raises"
    NEVER_STARTS = "never_starts"
    NEVER_ANSWERS = "never_answers"
    ENDS_TWICE = "ends_twice"
    ENDS_UNSTARTED = "ends_unstarted"
    WRONG_EXECUTION = "wrong_execution"


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptStep:
    """How one command of (agent, task) is carried out."""

    agent: str
    task: str
    delay_s: float = 0.0
    duration_s: float = 1.0
    outcome: str = Outcome.SUCCEEDED
    reason: str = ""
    misbehaviour: str = ""


class ScriptedExecutor:
    """Carry out the n-th command of an (agent, task) by its n-th step. The last step also holds for all later commands.

    A command of an (agent, task) without steps is rejected.

    Args:
        steps: in order.
        clock: simulated or real.
    """

    prompt: Final = True

    def __init__(self, steps: Iterable[ScriptStep], clock: Clock) -> None:
        self._steps: dict[tuple[str, str], list[ScriptStep]] = {}
        for step in steps:
            self._steps.setdefault((step.agent, step.task), []).append(step)
        self._clock = clock
        self._player = Player(clock)
        self._used: Counter[tuple[str, str]] = Counter()

    @property
    def agents(self) -> tuple[str, ...]:
        """The agents that have steps."""
        return tuple(dict.fromkeys(agent for agent, _ in self._steps))

    def connect(self, emit: Emit) -> None:
        """Send all events to `emit` from now on."""
        self._player.emit = emit

    def start(self, command: Command) -> None:
        """Do what the script says.

        Raises:
            RuntimeError: the script wants it.
        """
        key = (command.agent, command.task)
        steps = self._steps.get(key, [])
        if not steps:
            self._reject(command, f"the script has no step of {command.agent!r}, {command.task!r}")
            return
        step = steps[min(self._used[key], len(steps) - 1)]
        self._used[key] += 1
        if step.misbehaviour == Misbehaviour.RAISES:
            raise RuntimeError(step.reason or "the script says so")
        if step.misbehaviour == Misbehaviour.REJECTS:
            self._reject(command, step.reason or "the script says so")
            return
        self._player.play(command, _course(command, step))

    def cancel(self, execution_id: str, reason: str) -> None:
        """End an execution as canceled, now, unless its step never answers."""
        self._player.cancel(execution_id, reason)

    def _reject(self, command: Command, reason: str) -> None:
        self._player.emit(rejection(command, time_ns=self._clock.now_ns, reason=reason))


def read_script(path: Path) -> list[ScriptStep]:
    """Return the steps of a JSON file.

    Raises:
        ScenarioError: the file cannot be read, or is no script.
    """
    record = JsonRecord(read_json(path, "a script"), str(path), ("schema_version", "steps"))
    version = record.integer("schema_version", SCRIPT_VERSION)
    if version > SCRIPT_VERSION:
        raise record.error("schema_version", f"at most {SCRIPT_VERSION} (a newer hrclog wrote it)")
    steps = [_step(entry) for entry in record.records("steps", _STEP_FIELDS)]
    if not steps:
        raise ScenarioError(f"{path}: found no steps, expected at least one; add it")
    return steps


def _step(entry: JsonRecord) -> ScriptStep:
    step = ScriptStep(
        agent=entry.text("agent"),
        task=entry.text("task"),
        delay_s=entry.number("delay_s", 0.0),
        duration_s=entry.number("duration_s", 1.0),
        outcome=entry.text("outcome", Outcome.SUCCEEDED),
        reason=entry.text("reason", ""),
        misbehaviour=entry.text("misbehaviour", ""),
    )
    for name, allowed in (("outcome", tuple(Outcome)), ("misbehaviour", ("", *Misbehaviour))):
        if getattr(step, name) not in allowed:
            raise entry.error(name, f"one of {', '.join(filter(None, allowed))}")
    return step


def _course(command: Command, step: ScriptStep) -> Course:
    begin_ns = round(step.delay_s * NS_PER_S)
    end_ns = begin_ns + round(step.duration_s * NS_PER_S)
    planned = {"planned_start_ns": command.planned_start_ns, "planned_end_ns": command.planned_end_ns}
    start: tuple[int, TaskFact] = (begin_ns, event_on(TaskStarted, command, time_ns=0, **planned))
    ended = event_on(TaskEnded, command, time_ns=0, outcome=step.outcome, reason=step.reason)
    end: tuple[int, TaskFact] = (end_ns, ended)
    match step.misbehaviour:
        case Misbehaviour.NEVER_STARTS:
            return Course(())
        case Misbehaviour.NEVER_ANSWERS:
            return Course((start,), deaf=True)
        case Misbehaviour.ENDS_TWICE:
            return Course((start, end, end))
        case Misbehaviour.ENDS_UNSTARTED:
            return Course((end,))
        case Misbehaviour.WRONG_EXECUTION:
            return Course((start, (end_ns, replace(ended, execution_id=f"not-{command.execution_id}"))))
    return Course((start, end))
