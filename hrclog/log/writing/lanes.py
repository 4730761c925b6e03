"""Which task each agent is at, for the lanes that log viewers draw."""

from __future__ import annotations

from hrclog.events import Event, TaskEnded, TaskFact, TaskStarted
from hrclog.log.messages import channels
from hrclog.log.messages.encode import Message


class Lanes:
    """The active task per agent, "" when idle; an agent at several is shown at the one it began last."""

    def __init__(self) -> None:
        self._active: dict[str, dict[str, str]] = {}

    def begin(self, fact: TaskFact) -> None:
        """Take in an execution that goes on."""
        self._active.setdefault(fact.agent, {})[fact.execution_id] = fact.task

    def after(self, event: Event, log_time: int) -> list[Message]:
        """Return the lane messages that an event causes."""
        if not isinstance(event, TaskFact):
            return []
        label = self.label_after(event.kind, event.agent, event.task, event.execution_id)
        if label is None:
            return []
        text = channels.encode_string(label)
        return [Message(channels.lane(event.agent), max(log_time, 0), max(event.time_ns, 0), text)]

    def label_after(self, kind: str, agent: str, task: str, execution_id: str) -> str | None:
        """Return what the agent's lane shows after an event of an execution, None where it stays as it was."""
        active = self._active.setdefault(agent, {})
        if kind == TaskStarted.kind:
            active[execution_id] = task
        elif kind != TaskEnded.kind or active.pop(execution_id, None) is None:
            return None
        return next(reversed(active.values()), "")
