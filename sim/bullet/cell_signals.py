"""What the stepped cell samples: joints, distance, speed scale, moving objects; nothing twice that did not change."""

from __future__ import annotations

import math
from typing import Final

from hrclog.arrays import FloatArray
from hrclog.log.messages.encode import DescriptionSignal, FloatSignal, JointSignal, PoseSignal, SceneSignal, Signal
from hrclog.sim.bullet.world import robot_urdf
from hrclog.sim.cell.description import Cell, Point
from hrclog.sim.cell.human_kinematics import HUMAN_JOINT_NAMES
from hrclog.sim.cell.robot_kinematics import JOINT_NAMES
from hrclog.sim.cell.scene import scene_of
from hrclog.sim.models import HUMAN_URDF

_UPRIGHT: Final = (0.0, 0.0, 0.0, 1.0)


class CellSignals:
    """Collect the samples of a run.

    Args:
        cell: whose.
    """

    def __init__(self, cell: Cell) -> None:
        self.samples: list[Signal] = []
        self._cell = cell
        self._last_values: dict[str, object] = {}

    def scene(self, time_ns: int) -> None:
        """Sample what stands in the cell and what the agents look like."""
        robot, human = self._cell.robot.agent, self._cell.human.agent
        self.samples += [
            SceneSignal("", time_ns, scene_of(self._cell)),
            DescriptionSignal("", robot, time_ns, robot_urdf(self._cell.robot)),
            DescriptionSignal("", human, time_ns, HUMAN_URDF.read_text(encoding="utf-8")),
        ]

    def joints(self, time_ns: int, robot: FloatArray, human: FloatArray) -> None:
        """Sample where the joints are."""
        for agent, names, values in (
            (self._cell.robot.agent, JOINT_NAMES, robot),
            (self._cell.human.agent, HUMAN_JOINT_NAMES, human),
        ):
            positions = tuple(values.tolist())
            if self._last_values.get(agent) != positions:
                self._last_values[agent] = positions
                self.samples.append(JointSignal("", agent, time_ns, names, positions))

    def number(self, time_ns: int, name: str, value: float) -> None:
        """Sample a number."""
        if self._last_values.get(name) != value:
            self._last_values[name] = value
            self.samples.append(FloatSignal("", name, time_ns, value))

    def pose(self, time_ns: int, name: str, position: Point, yaw: float = 0.0) -> None:
        """Sample where an object is."""
        key = f"object {name}"
        if self._last_values.get(key) != (position, yaw):
            self._last_values[key] = position, yaw
            quaternion = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)) if yaw else _UPRIGHT
            self.samples.append(PoseSignal("", name, time_ns, position, quaternion))
