"""Samples: any number of a message, and the joints of an agent."""

from __future__ import annotations

from collections.abc import Iterator

from hrclog.log.messages.encode import FloatSignal, JointSignal
from hrclog.recorders.mapping.facts import Fact, Notes
from hrclog.recorders.mapping.fields import number
from hrclog.recorders.mapping.meaning import Meaning
from hrclog.recorders.mapping.only import Only
from hrclog.recorders.mapping.received import Received
from hrclog.recorders.mapping.table import Table
from hrclog.recorders.mapping.values import Value


class Signal(Meaning):
    """A number of a message, sampled."""

    kind = "signal"
    summary = "any number of a message, as a signal: a distance, a force, a heart rate"

    def __init__(self, table: Table) -> None:
        super().__init__(table)
        self._name = table.value("name", captures=self.pattern.names)
        self._field = table.path("field", "data")
        self._factor = table.number("factor", 1.0, above=float("-inf"))
        self._time = table.time()
        self._only = Only(table)

    def take(self, received: Received, notes: Notes) -> Iterator[Fact]:  # noqa: ARG002 - for those that need them
        """Return the sample that a message holds."""
        content = received.content
        if not self._only.holds(content):
            return
        value = number(self._field.of(content))
        at, name = self._time.of(received), self._name.of(content, self._captures(received))
        yield Fact(FloatSignal("", name, at.ns, float(value) * self._factor), at.clock)


class Joints(Meaning):
    """The joints of an agent, sensor_msgs/JointState or a message with such fields."""

    kind = "joints"
    summary = "the joints of an agent: names and positions, as in sensor_msgs/JointState"
    topic = "/joint_states"

    def __init__(self, table: Table) -> None:
        super().__init__(table)
        self._agent = table.value("agent", Value("robot"), captures=self.pattern.names)
        self._names = table.path("name", "name")
        self._positions = table.path("position", "position")
        self._time = table.time()
        self._only = Only(table)

    def take(self, received: Received, notes: Notes) -> Iterator[Fact]:  # noqa: ARG002 - for those that need them
        """Return the sample that a message holds."""
        content = received.content
        if not self._only.holds(content):
            return
        names = tuple(str(name) for name in self._names.of(content))
        positions = tuple(float(position) for position in self._positions.of(content))
        if len(names) != len(positions):
            raise ValueError(f"found {len(names)} names and {len(positions)} positions of joints, expected as many")
        at, agent = self._time.of(received), self._agent.of(content, self._captures(received))
        yield Fact(JointSignal("", agent, at.ns, names, positions), at.clock)
