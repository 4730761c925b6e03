"""The cell in PyBullet: what touches what, and how near the robot and the human are. Nothing here moves by itself."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np

from hrclog.arrays import FloatArray
from hrclog.errors import ScenarioError
from hrclog.sim.cell.description import Box, Cell, RobotModel
from hrclog.sim.models import HUMAN_URDF, ROBOT_URDF

FAR_M: Final = 10.0
_MARGIN_M: Final = 0.005
"""A path keeps this distance from the fixtures and between the robot's own links."""


class Separation:
    """How near robot and human are, per pair of body parts; shapes (n,) and (n, 3)."""

    def __init__(self, found: Sequence[Sequence[Any]]) -> None:
        self.robot_links = np.array([pair[3] for pair in found], np.int64)
        self.on_robot = np.array([pair[5] for pair in found], np.float64).reshape(-1, 3)
        self.on_human = np.array([pair[6] for pair in found], np.float64).reshape(-1, 3)
        self.distances = np.array([pair[8] for pair in found], np.float64)
        self.least_m = float(self.distances.min()) if len(found) else FAR_M


class World:
    """One PyBullet world with the robot, the human and the fixtures of a cell.

    Args:
        cell: what stands where.

    Raises:
        ScenarioError: PyBullet is not installed.
    """

    def __init__(self, cell: Cell) -> None:
        self._bullet = load_pybullet()
        self._client = self._bullet.connect(self._bullet.DIRECT)
        robot = cell.robot
        turn = self._bullet.getQuaternionFromEuler([0.0, 0.0, 0.0])
        with silent():
            self.robot = self._load(ROBOT_URDF, [0.0, robot.rail_y, robot.base_z], turn)
            self.human = self._load(HUMAN_URDF, [0.0, 0.0, 0.0], turn)
        self._fixtures = [self._add_fixture(box) for box in cell.fixtures]
        self._robot_joints = self._movable_joints(self.robot)
        self._human_joints = self._movable_joints(self.human)
        self._checked_link_pairs = self._link_pairs()

    def close(self) -> None:
        """Free the world."""
        self._bullet.disconnect(physicsClientId=self._client)

    def set_robot(self, joints: FloatArray) -> None:
        """Put the robot's joints (7,) where they shall be."""
        self._set_joints(self.robot, self._robot_joints, joints)

    def set_human(self, joints: FloatArray) -> None:
        """Put the human's joints (13,) where they shall be."""
        self._set_joints(self.human, self._human_joints, joints)

    def separation(self, within_m: float = FAR_M) -> Separation:
        """Return how near robot and human are, for all pairs of body parts nearer than a distance."""
        return Separation(self._bullet.getClosestPoints(self.robot, self.human, within_m, physicsClientId=self._client))

    def free(self, joints: FloatArray) -> bool:
        """Return whether the robot at joints (7,) touches neither a fixture nor itself."""
        self.set_robot(joints)
        closest_points, client = self._bullet.getClosestPoints, self._client
        if any(closest_points(self.robot, box, _MARGIN_M, physicsClientId=client) for box in self._fixtures):
            return False
        return not any(
            closest_points(self.robot, self.robot, 0.0, linkIndexA=a, linkIndexB=b, physicsClientId=client)
            for a, b in self._checked_link_pairs
        )

    def _load(self, path: Path, position: list[float], orientation: Sequence[float]) -> int:
        return int(
            self._bullet.loadURDF(str(path), position, orientation, useFixedBase=True, physicsClientId=self._client)
        )

    def _add_fixture(self, box: Box) -> int:
        half = [side / 2 for side in box.size]
        shape = self._bullet.createCollisionShape(self._bullet.GEOM_BOX, halfExtents=half, physicsClientId=self._client)
        return int(self._bullet.createMultiBody(0, shape, -1, box.position, physicsClientId=self._client))

    def _movable_joints(self, body: int) -> list[int]:
        count = self._bullet.getNumJoints(body, physicsClientId=self._client)
        kinds = [self._bullet.getJointInfo(body, joint, physicsClientId=self._client)[2] for joint in range(count)]
        return [joint for joint, kind in enumerate(kinds) if kind != self._bullet.JOINT_FIXED]

    def _set_joints(self, body: int, indices: list[int], joints: FloatArray) -> None:
        values = [(value,) for value in joints.tolist()]
        self._bullet.resetJointStatesMultiDof(body, indices, values, physicsClientId=self._client)

    def _link_pairs(self) -> list[tuple[int, int]]:
        """Return the pairs of the robot's links that may touch: those that do not share a joint and do not always."""
        count = self._bullet.getNumJoints(self.robot, physicsClientId=self._client)
        parents = [
            self._bullet.getJointInfo(self.robot, link, physicsClientId=self._client)[16] for link in range(count)
        ]
        self.set_robot(_SPREAD)
        pairs = []
        for a in range(count):
            for b in range(a + 1, count):
                touching = self._bullet.getClosestPoints(
                    self.robot, self.robot, 0.0, linkIndexA=a, linkIndexB=b, physicsClientId=self._client
                )
                if parents[b] != a and not touching:
                    pairs.append((a, b))
        return pairs


_SPREAD: Final = np.array([0.0, 0.0, -1.2, 0.9, -1.2, -1.57, 0.0])


def robot_urdf(robot: RobotModel) -> str:
    """Return the robot's description, standing where its cell has it."""
    text = ROBOT_URDF.read_text(encoding="utf-8")
    stand = (
        '<link name="cell" /><joint name="stand" type="fixed"><parent link="cell" /><child link="rail_beam" />'
        f'<origin xyz="0 {robot.rail_y} {robot.base_z}" rpy="0 0 0" /></joint>'
    )
    return text.replace('<robot name="robot">', f'<robot name="robot">{stand}', 1)


def load_pybullet() -> Any:  # noqa: ANN401 - PyBullet ships no types
    """Return the module.

    Raises:
        ScenarioError: it is not installed.
    """
    try:
        with silent():
            import pybullet
    except ImportError as error:
        version = f"{sys.version_info.major}.{sys.version_info.minor}"
        raise ScenarioError(
            f"the engine 'bullet' needs PyBullet, which this Python {version} does not have; on Linux x86-64 with"
            " Python 3.11 install it with pip install 'hrclog[sim]', anywhere else choose --engine events"
        ) from error
    return pybullet


@contextmanager
def silent() -> Iterator[None]:
    """Keep what C code prints out of a command's results and messages: PyBullet greets whoever imports it."""
    streams = (sys.stdout, sys.stderr)
    for stream in streams:
        stream.flush()
    saved_descriptors = [os.dup(number) for number in (1, 2)]
    try:
        with open(os.devnull, "w", encoding="utf-8") as null:  # noqa: PTH123 - os.devnull is a name, not a path
            for number in (1, 2):
                os.dup2(null.fileno(), number)
            yield
    finally:
        for stream in streams:
            stream.flush()
        ctypes.CDLL(None).fflush(None)  # what C code printed waits in its own buffer
        for number, saved in zip((1, 2), saved_descriptors, strict=True):
            os.dup2(saved, number)
            os.close(saved)
