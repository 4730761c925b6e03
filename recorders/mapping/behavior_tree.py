"""Nav2's log of behaviour trees: each node that runs is an execution."""

from __future__ import annotations

from collections.abc import Iterator
from fnmatch import fnmatchcase
from typing import Final

from hrclog.events import Outcome
from hrclog.recorders.mapping.executions import Executions
from hrclog.recorders.mapping.facts import Clock, Fact, Instant, Notes
from hrclog.recorders.mapping.fields import FieldPath, field_of, has_field, stamp_ns, word
from hrclog.recorders.mapping.meaning import Meaning
from hrclog.recorders.mapping.received import Received
from hrclog.recorders.mapping.table import Table
from hrclog.recorders.mapping.values import Value

_OUTCOMES: Final = {"SUCCESS": Outcome.SUCCEEDED, "FAILURE": Outcome.FAILED, "IDLE": Outcome.CANCELED}


class BehaviorTree(Meaning):
    """The topic `/behavior_tree_log`: a node runs from RUNNING to SUCCESS, FAILURE or, where it was halted, IDLE."""

    kind = "behavior_tree"
    summary = "Nav2's behavior_tree_log: each run of a node is an execution"
    topic = "/behavior_tree_log"

    def __init__(self, table: Table) -> None:
        super().__init__(table)
        names = self.pattern.names
        self._agent = table.value("agent", captures=names)
        self._task = table.value("task", Value("", FieldPath("node_name")), captures=names)
        self._nodes = table.words("nodes", ("*",))
        self._executions = Executions(self.kind)

    def take(self, received: Received, notes: Notes) -> Iterator[Fact]:
        """Return what a message says; the times of the changes count, not that of the message."""
        captures = self._captures(received)
        for change in field_of(received.content, "event_log"):
            name = word(field_of(change, "node_name"))
            if not any(fnmatchcase(name, pattern) for pattern in self._nodes):
                continue
            stamp = stamp_ns(field_of(change, "timestamp")) or 0
            at = Instant(stamp, Clock.STAMP) if stamp else Instant(received.time_ns)
            if stamp:
                notes.stamp(received.time_ns, stamp, sure=True)
            uid = word(field_of(change, "uid")) if has_field(change, "uid") else ""
            key, state = (name, uid), word(field_of(change, "current_status"))
            if state == "RUNNING":
                # idle transitions may be hidden: then a halt shows only when the node runs again
                before = word(field_of(change, "previous_status"))
                if before != "RUNNING":
                    yield from self._executions.end(key, at, "")
                agent, task = self._agent.of(change, captures), self._task.of(change, captures)
                yield from self._executions.start(key, agent, task, at)
            elif state in _OUTCOMES:
                yield from self._executions.end(key, at, _OUTCOMES[state])
