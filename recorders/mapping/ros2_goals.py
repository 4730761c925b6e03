"""Messages of ROS 2 actions as evidence of goals: status, and where they were recorded goal, result and feedback."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from typing import Any, Final

from hrclog.ids import derived_id
from hrclog.recorders.mapping.executions import SOURCE
from hrclog.recorders.mapping.facts import Captures, Clock, Fact, Instant, Notes
from hrclog.recorders.mapping.fields import field_of, stamp_ns, uuid_bytes
from hrclog.recorders.mapping.goals import OUTCOMES_ROS2, End, Goal, goals_of, rejection
from hrclog.recorders.mapping.received import Received
from hrclog.recorders.mapping.values import Value
from hrclog.units import NS_PER_S

SUFFIXES: Final = {
    "/_action/status": "status",
    "/_action/feedback": "feedback",
    "/_action/send_goal/_service_event": "send_goal",
    "/_action/get_result/_service_event": "get_result",
}
"""What the ends of an action's topics carry."""

_ACCEPTED, _EXECUTING = 1, 2
_REQUEST, _RESPONSE = (0, 1), (2, 3)
_LATE_NS: Final = NS_PER_S
"""A goal that ran for longer than this when the recording began counts from its acceptance."""


class Ros2Goals:
    """One ROS 2 action.

    Args:
        name: of the action.
        captures: what the placeholders of its topic stand for.
        agent: who carries it out.
        task: what it is called; `goal` is the goal.
        reason: why it ended; `result` is the result.
    """

    def __init__(self, name: str, captures: Captures, agent: Value, task: Value, reason: Value) -> None:
        self._captures, self._agent, self._task, self._reason = captures, agent, task, reason
        self._goals = goals_of(name, agent, task, waits_for_reason=reason.path is not None)
        self._requests: dict[tuple[str, int], Goal] = {}
        self._n_arrays = 0
        self._retired: set[tuple[str, int | None]] = set()

    def take(self, part: str, received: Received, notes: Notes) -> Iterator[Fact]:
        """Return what a message says; `part` is one of `SUFFIXES`."""
        if part == "status":
            yield from self._take_status(received, notes)
        elif part == "feedback":
            goal = self._goal(_key(field_of(received.content, "goal_id")), notes)
            goal.likely_start = goal.likely_start or Instant(received.time_ns)
        else:
            yield from self._take_service(part, received, notes)

    def finish(self, notes: Notes) -> Iterator[Fact]:
        """Return the rest."""
        yield from self._goals.finish(notes)

    def _goal(self, key: str, notes: Notes) -> Goal:
        return self._goals.goal(key, lambda: self._new_goal(key, notes))

    def _new_goal(self, key: str, notes: Notes) -> Goal:
        """Return a goal whose execution has its UUID, unless another goal of the recording has it too."""
        name = self._goals.name
        is_first = notes.actions.setdefault(key, name) == name and not self._goals.n_former
        goal = Goal(key if is_first else derived_id(SOURCE, "action", name, key, str(self._goals.n_former)))
        if self._agent.path is None:
            goal.agent = self._agent.of(None, self._captures)
        if self._task.path is None:
            goal.task = self._task.of(None, self._captures)
        return goal

    def _take_status(self, received: Received, notes: Notes) -> Iterator[Fact]:
        self._n_arrays += 1
        for entry in field_of(received.content, "status_list"):
            status = int(field_of(entry, "status"))
            info = field_of(entry, "goal_info")
            stamp = stamp_ns(field_of(info, "stamp")) or None
            key = _key(field_of(info, "goal_id"))
            goal = self._goal(key, notes)
            if goal.end is not None and stamp not in (None, goal.stamp_ns):
                goal = self._renewed(key, goal, notes)
            if status in goal.seen or status < _ACCEPTED or (key, stamp) in self._retired:
                continue
            goal.stamp_ns = goal.stamp_ns or stamp
            self._take_state(goal, status, received.time_ns, stamp, notes)
            goal.seen.add(status)
            yield from self._goals.settled(goal)

    def _take_state(self, goal: Goal, status: int, log_ns: int, stamp: int | None, notes: Notes) -> None:
        now, is_first_array = Instant(log_ns), self._n_arrays == 1
        if not goal.seen and stamp is not None:
            notes.stamp(log_ns, stamp, sure=status == _ACCEPTED or (status == _EXECUTING and not is_first_array))
        waited = stamp is not None and log_ns - stamp > _LATE_NS
        if status == _ACCEPTED:
            goal.accepted = goal.accepted or (now if goal.started is None else None)
        elif status not in OUTCOMES_ROS2 and goal.started is None and goal.end is None:
            is_late = is_first_array and waited and not goal.seen
            goal.started = Instant(stamp, Clock.STAMP) if stamp is not None and is_late else now
        elif status in OUTCOMES_ROS2 and goal.end is None:
            if goal.started is None and not goal.seen and stamp is not None:
                if is_first_array and stamp < notes.begin_ns - _LATE_NS:
                    self._goals.leave_out(goal, notes)
                    return
                goal.accepted = Instant(stamp, Clock.STAMP)
            goal.end = End(OUTCOMES_ROS2[status], now)

    def _renewed(self, key: str, ended: Goal, notes: Notes) -> Goal:
        """Return a new goal under the key of one that has ended; states of that one may still be repeated."""
        self._retired.add((key, ended.stamp_ns))
        self._goals.retire(key)
        return self._goal(key, notes)

    def _take_service(self, part: str, received: Received, notes: Notes) -> Iterator[Fact]:
        info = field_of(received.content, "info")
        kind = int(field_of(info, "event_type"))
        client = field_of(info, "client_gid")
        call = (part + bytes(int(number) for number in client).hex(), int(field_of(info, "sequence_number")))
        if kind in _REQUEST:
            for request in field_of(received.content, "request"):
                key = _key(field_of(request, "goal_id"))
                goal = self._goal(key, notes)
                if part == "send_goal" and goal.end is not None and goal.stamp_ns is not None:
                    goal = self._renewed(key, goal, notes)
                self._requests[call] = goal
                if part == "send_goal":
                    if isinstance(request, dict) and set(request) == {"goal_id"}:  # the head, all that can be read
                        self._goals.undefined = received.type_name
                    self._name(goal, request)
                yield from self._goals.settled(goal)
        elif kind in _RESPONSE and call in self._requests:
            goal = self._requests[call]
            for response in field_of(received.content, "response"):
                yield from self._take_response(part, goal, response, received)

    def _name(self, goal: Goal, request: Any) -> None:  # noqa: ANN401 - a decoded message
        goal.agent = goal.agent or self._agent.of(request, self._captures)
        goal.task = goal.task or self._task.of(request, self._captures)

    def _take_response(self, part: str, goal: Goal, response: Any, received: Received) -> Iterator[Fact]:  # noqa: ANN401 - a decoded message
        now = Instant(received.time_ns)
        if part == "send_goal":
            if field_of(response, "accepted"):
                goal.likely_start = goal.likely_start or now
            elif goal.rejected is None:
                yield rejection(goal, now, "the action server refused the goal")
            return
        status = int(field_of(response, "status"))
        if status in OUTCOMES_ROS2:
            goal.likely_end = goal.likely_end or End(OUTCOMES_ROS2[status], now)
            goal.reason = self._reason.of(response, self._captures)
            yield from self._goals.settled(goal)


def _key(goal_id: Any) -> str:  # noqa: ANN401 - a decoded message
    raw = uuid_bytes(goal_id)
    if raw is None:
        raise ValueError("found a goal without a UUID")
    return str(uuid.UUID(bytes=raw))
