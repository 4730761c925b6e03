"""Messages of ROS 1 actions (actionlib) as evidence of goals: goal, status and result."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from hrclog.ids import derived_id
from hrclog.recorders.mapping.executions import SOURCE
from hrclog.recorders.mapping.facts import Captures, Clock, Fact, Instant, Notes
from hrclog.recorders.mapping.fields import field_of, stamp_ns, word
from hrclog.recorders.mapping.goals import OUTCOMES_ROS1, End, Goal, goals_of, rejection
from hrclog.recorders.mapping.received import Received
from hrclog.recorders.mapping.values import Value, header_instant
from hrclog.units import NS_PER_S

SUFFIXES: Final = {"/status": "status", "/goal": "goal", "/result": "result"}
"""What the ends of an action's topics carry."""

_PENDING, _REJECTED, _RECALLING, _RECALLED = 0, 5, 7, 8
_REFUSED: Final = {_REJECTED: "the action server refused the goal", _RECALLED: "recalled before it began"}
_LATE_NS: Final = NS_PER_S


class Ros1Goals:
    """One ROS 1 action; see `Ros2Goals` for its arguments."""

    def __init__(self, name: str, captures: Captures, agent: Value, task: Value, reason: Value) -> None:
        self._captures, self._agent, self._task, self._reason = captures, agent, task, reason
        self._goals = goals_of(name, agent, task, waits_for_reason=True)
        self._n_arrays = 0

    def take(self, part: str, received: Received, notes: Notes) -> Iterator[Fact]:
        """Return what a message says; `part` is one of `SUFFIXES`."""
        at = header_instant(received)
        if part == "goal":
            goal = self._goal(word(field_of(received.content, "goal_id.id")))
            goal.agent = goal.agent or self._agent.of(received.content, self._captures)
            goal.task = goal.task or self._task.of(received.content, self._captures)
            yield from self._goals.settled(goal)
            return
        if at.clock is Clock.STAMP:
            notes.stamp(received.time_ns, at.ns, sure=True)
        if part == "status":
            self._n_arrays += 1
            for entry in field_of(received.content, "status_list"):
                yield from self._take_status(entry, at, notes)
        else:
            entry = field_of(received.content, "status")
            goal, status, text = self._state(entry)
            if status in OUTCOMES_ROS1:
                goal.end = goal.end or End(OUTCOMES_ROS1[status], at)
                goal.reason = self._reason.of(received.content, self._captures) or text
                yield from self._goals.settled(goal)
            elif status in _REFUSED and goal.rejected is None:
                yield rejection(goal, at, text or _REFUSED[status])

    def finish(self, notes: Notes) -> Iterator[Fact]:
        """Return the rest."""
        yield from self._goals.finish(notes)

    def _goal(self, key: str) -> Goal:
        def new() -> Goal:
            goal = Goal(derived_id(SOURCE, "action", self._goals.name, key))
            if self._agent.path is None:
                goal.agent = self._agent.of(None, self._captures)
            if self._task.path is None:
                goal.task = self._task.of(None, self._captures)
            return goal

        return self._goals.goal(key, new)

    def _state(self, entry: object) -> tuple[Goal, int, str]:
        goal = self._goal(word(field_of(entry, "goal_id.id")))
        return goal, int(field_of(entry, "status")), word(field_of(entry, "text"))

    def _take_status(self, entry: object, at: Instant, notes: Notes) -> Iterator[Fact]:
        goal, status, text = self._state(entry)
        if status in goal.seen:
            return
        is_new = not goal.seen
        goal.seen.add(status)
        if status in OUTCOMES_ROS1:
            stamp = stamp_ns(field_of(entry, "goal_id.stamp"))
            if is_new and goal.started is None and goal.accepted is None and stamp:
                if self._n_arrays == 1 and stamp < notes.begin_ns - _LATE_NS and goal.end is None:
                    self._goals.leave_out(goal, notes)
                    return
                goal.accepted = Instant(stamp, Clock.STAMP)
            goal.likely_end = goal.likely_end or End(OUTCOMES_ROS1[status], at, text)
        elif status in _REFUSED:
            if goal.rejected is None:
                yield rejection(goal, at, text or _REFUSED[status])
        elif status == _PENDING:
            goal.accepted = goal.accepted or (at if goal.started is None else None)
        elif status != _RECALLING and goal.started is None:
            goal.started = at
            yield from self._goals.settled(goal)
