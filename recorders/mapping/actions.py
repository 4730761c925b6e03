"""Actions of ROS 2 and ROS 1: each goal is an execution."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from hrclog.recorders.mapping import ros1_goals, ros2_goals
from hrclog.recorders.mapping.facts import Captures, Fact, Notes
from hrclog.recorders.mapping.meaning import Meaning
from hrclog.recorders.mapping.received import Received
from hrclog.recorders.mapping.ros1_goals import Ros1Goals
from hrclog.recorders.mapping.ros2_goals import Ros2Goals
from hrclog.recorders.mapping.table import Table
from hrclog.recorders.mapping.values import Value

ROS1_TYPES: Final = {"status": "actionlib_msgs/msg/GoalStatusArray", "goal": "ActionGoal", "result": "ActionResult"}
"""How the types of a ROS 1 action's topics end."""


class Action(Meaning):
    """An action, by its name."""

    kind = "action"
    summary = "an action of ROS 2 or ROS 1; `topic` is its name, each goal an execution"

    def __init__(self, table: Table) -> None:
        super().__init__(table)
        self._agent = table.value("agent", captures=self.pattern.names)
        self._task = table.value("task", captures=self.pattern.names)
        self._reason = table.value("reason", default=Value(""))
        self._actions: dict[str, Ros2Goals | Ros1Goals] = {}

    def wants(self, topic: str, type_name: str) -> bool:
        """Return whether a topic is one of an action that it is about."""
        return self._part(topic, type_name) is not None

    def take(self, received: Received, notes: Notes) -> Iterable[Fact]:
        """Return what a message says."""
        part = self._part(received.topic, received.type_name)
        if part is None:
            return ()
        name, kind, captures, is_ros2 = part
        if name not in self._actions:
            dialect = Ros2Goals if is_ros2 else Ros1Goals
            self._actions[name] = dialect(name, captures, self._agent, self._task, self._reason)
        return self._actions[name].take(kind, received, notes)

    def finish(self, notes: Notes) -> Iterator[Fact]:
        """Return the rest."""
        for action in self._actions.values():
            yield from action.finish(notes)

    def _part(self, topic: str, type_name: str) -> tuple[str, str, Captures, bool] | None:
        """Return name of the action, what the topic carries, placeholders, and whether it is of ROS 2."""
        for suffixes in (ros2_goals.SUFFIXES, ros1_goals.SUFFIXES):
            is_ros2 = suffixes is ros2_goals.SUFFIXES
            for suffix, kind in suffixes.items():
                if topic.endswith(suffix) and (is_ros2 or type_name.endswith(ROS1_TYPES[kind])):
                    name = topic.removesuffix(suffix)
                    captures = self.pattern.captures(name)
                    if captures is not None:
                        return name, kind, captures, is_ros2
        return None
