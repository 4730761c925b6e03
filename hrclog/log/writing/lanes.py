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
        if isinstance(event, TaskStarted):
            self.begin(event)
        elif not isinstance(event, TaskEnded) or not self._finish(event):
            return []
        label = next(reversed(self._active[event.agent].values()), "")
        text = channels.encode_string(label)
        return [Message(channels.lane(event.agent), max(log_time, 0), max(event.time_ns, 0), text)]

    def _finish(self, event: TaskEnded) -> bool:
        return self._active.get(event.agent, {}).pop(event.execution_id, None) is not None
