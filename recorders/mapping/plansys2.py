"""Reports of PlanSys2's executor: every action of the plan, repeated each second."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, Final

from hrclog.events import Outcome
from hrclog.recorders.mapping.executions import Executions
from hrclog.recorders.mapping.facts import Clock, Fact, Instant, Notes
from hrclog.recorders.mapping.fields import AbsentFieldError, FieldPath, field_of, has_field, stamp_ns, word
from hrclog.recorders.mapping.meaning import Meaning
from hrclog.recorders.mapping.received import Received
from hrclog.recorders.mapping.table import Table
from hrclog.recorders.mapping.values import Value
from hrclog.units import NS_PER_S

_NOT_EXECUTED, _EXECUTING = 1, 2
_OUTCOMES: Final = {3: Outcome.FAILED, 4: Outcome.SUCCEEDED, 5: Outcome.CANCELED}
_LISTS: Final = ("feedback", "result")
_PLANNED: Final = re.compile(r":(\d{1,15})$")
_NS_PER_MS: Final = NS_PER_S // 1000


class PlanSys2(Meaning):
    """The topic `/action_execution_info`, or feedback of the action `/execute_plan`."""

    kind = "plansys2"
    summary = "PlanSys2's action_execution_info: each action of a plan, by the times that it tells"
    topic = "/action_execution_info"

    def __init__(self, table: Table) -> None:
        super().__init__(table)
        names = self.pattern.names
        self._agent = table.value("agent", Value("", FieldPath("arguments[0]")), captures=names)
        self._task = table.value("task", Value("", FieldPath("action")), captures=names)
        self._executions = Executions(self.kind)
        self._ended: set[tuple[str, int]] = set()
        self._plan_start: dict[str, int] = {}
        self._status: dict[str, int] = {}

    def take(self, received: Received, notes: Notes) -> Iterator[Fact]:
        """Return what a message says."""
        content = received.content
        outer = next((name for name in _LISTS if has_field(content, name)), None)
        if outer is None:
            yield from self._take_action(content, received, notes)
            return
        for action in field_of(content, f"{outer}.action_execution_status"):
            yield from self._take_action(action, received, notes)

    def _take_action(self, action: Any, received: Received, notes: Notes) -> Iterator[Fact]:  # noqa: ANN401 - a decoded message
        name, status = word(field_of(action, "action_full_name")), int(field_of(action, "status"))
        start, changed = _stamp(action, "start_stamp"), _stamp(action, "status_stamp")
        if status == _NOT_EXECUTED:
            self._plan_start[name] = start
        key = (name, start)
        if self._status.get(name) not in (None, status) and status in _OUTCOMES:
            notes.stamp(received.time_ns, changed, sure=True)
        self._status[name] = status
        if status < _EXECUTING or key in self._ended:
            return
        captures = self._captures(received)
        agent, task = self._agent.of(action, captures), self._task.of(action, captures)
        if not agent or not task:
            raise AbsentFieldError(f"no {'task' if agent else 'agent'}: {name!r} has no such argument")
        planned = _PLANNED.search(name)
        planned_start = (
            self._plan_start[name] + int(planned[1]) * _NS_PER_MS if planned and name in self._plan_start else None
        )
        duration = stamp_ns(field_of(action, "duration")) or 0
        planned_end = planned_start + duration if planned_start is not None and duration else None
        plan = {"planned_start_ns": planned_start, "planned_end_ns": planned_end}
        yield from self._executions.start(key, agent, task, Instant(start, Clock.STAMP), **plan)
        if status in _OUTCOMES:
            self._ended.add(key)
            reason = "" if status == 4 else word(field_of(action, "message_status"))
            facts = {"reason": reason, "planned_duration_s": duration / NS_PER_S if duration else None}
            yield from self._executions.end(key, Instant(changed, Clock.STAMP), _OUTCOMES[status], **facts)


def _stamp(action: Any, name: str) -> int:  # noqa: ANN401 - a decoded message
    stamp = stamp_ns(FieldPath(name).of(action))
    if stamp is None:
        raise ValueError(f"{name} is no time")
    return stamp
