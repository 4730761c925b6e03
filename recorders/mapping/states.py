"""Any message that tells the state of a task, or which task an agent carries out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from hrclog.events import Cause, Outcome
from hrclog.recorders.mapping.executions import Executions
from hrclog.recorders.mapping.facts import Fact, Instant, Notes
from hrclog.recorders.mapping.meaning import Meaning
from hrclog.recorders.mapping.only import Only
from hrclog.recorders.mapping.received import Received
from hrclog.recorders.mapping.table import Table
from hrclog.recorders.mapping.values import Value

_OUTCOMES: Final = {
    "succeeded": Outcome.SUCCEEDED,
    "failed": Outcome.FAILED,
    "canceled": Outcome.CANCELED,
    "skipped": Outcome.SKIPPED,
    "timed_out": Outcome.TIMED_OUT,
    "ended": "",
}
_STATES: Final = ("started", *_OUTCOMES, "paused", "resumed", "ignored")


class States(Meaning):
    """A message of any type: fields for agent, task and state, and lists of what the values of the state mean.

    Without a state the task is what the agent does from this message on, until another one or an idle word comes.
    """

    kind = "task"
    summary = "any message: fields for agent, task, state and reason, and what the values of the state mean"

    def __init__(self, table: Table) -> None:
        super().__init__(table)
        names = self.pattern.names
        self._agent = table.value("agent", captures=names)
        self._task = table.value("task", captures=names)
        self._state = table.value("state", Value(""), captures=names)
        self._execution = table.value("execution", Value(""), captures=names)
        self._reason = table.value("reason", Value(""), captures=names)
        self._time = table.time()
        self._only = Only(table)
        self._cause = table.choice("cause", tuple(cause.value for cause in Cause), Cause.OPERATOR)
        self._idle = table.words("idle", ("",))
        self._meanings: dict[str, str] = {}
        for state in _STATES:
            for value in table.words(state):
                if value in self._meanings:
                    table.problem(f"{state}: found {value!r}, which is {self._meanings[value]} too")
                self._meanings[value] = state
        if "state" in table and "started" not in self._meanings.values():
            table.problem("found a state without values that mean started, expected started = [...]")
        self._executions = Executions(self.kind)
        self._current: dict[str, tuple[str, str, str]] = {}
        self._ended: set[tuple[str, str, str]] = set()

    def take(self, received: Received, notes: Notes) -> Iterator[Fact]:
        """Return what a message says."""
        content, captures = received.content, self._captures(received)
        if not self._only.holds(content):
            return
        agent, at = self._agent.of(content, captures), self._time.of(received)
        if at.ns != received.time_ns:
            notes.stamp(received.time_ns, at.ns, sure=True)
        task = self._task.of(content, captures)
        if self._state.path is None:
            yield from self._take_activity(received.topic, agent, task, at)
            return
        state = self._state.of(content, captures)
        meaning = self._meanings.get(state)
        if meaning is None:
            notes.remark(
                "unmapped_value", f"{{}} of {received.topic}: the state {state!r} is in no list of {self.where}"
            )
        elif meaning != "ignored":
            if not agent or not task:
                raise ValueError(f"no {'task' if agent else 'agent'} beside the state {state!r}")
            key = (agent, task, self._execution.of(content, captures))
            reason = self._reason.of(content, captures)
            yield from self._take_state(meaning, key, at, reason, notes, received.topic)

    def _take_activity(self, topic: str, agent: str, task: str, at: Instant) -> Iterator[Fact]:
        """Take in what an agent does from now on."""
        current = self._current.get(agent)
        if current is not None and current[1] != task:
            yield from self._executions.end(current, at, "")
            current = None
        if current is None and task not in self._idle and agent:
            self._current[agent] = (agent, task, topic)
            yield from self._executions.start(self._current[agent], agent, task, at)
        elif current is None:
            self._current.pop(agent, None)

    def _take_state(
        self, meaning: str, key: tuple[str, str, str], at: Instant, reason: str, notes: Notes, topic: str
    ) -> Iterator[Fact]:
        if meaning == "started":
            yield from self._executions.resume(key, at)
            if not (key[2] and key in self._ended):  # an execution that is named begins once
                self._ended.discard(key)
                yield from self._executions.start(key, key[0], key[1], at)
        elif meaning == "paused":
            yield from self._executions.pause(key, at, cause=self._cause, reason=reason)
        elif meaning == "resumed":
            yield from self._executions.resume(key, at)
        elif self._executions.is_open(key):
            yield from self._executions.end(key, at, _OUTCOMES[meaning], reason=reason)
            self._ended.add(key)
        elif key not in self._ended:
            self._ended.add(key)
            notes.remark("end_unseen_start", f"{{}} of {topic}: the end of a task whose start is not in the recording")
