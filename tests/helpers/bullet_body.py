"""A body in a PyBullet world of its own, as an oracle of kinematics."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hrclog.arrays import FloatArray


class BulletBody:
    """A body, loaded at a position."""

    def __init__(self, bullet: Any, client: int, body: int) -> None:  # noqa: ANN401 - PyBullet ships no types
        self.bullet = bullet
        self.client = client
        self.body = body

    def set(self, q: FloatArray) -> None:
        """Put the first joints where they shall be."""
        values = [[value] for value in q.tolist()]
        self.bullet.resetJointStatesMultiDof(self.body, range(len(values)), values, physicsClientId=self.client)

    def pose(self, link: int) -> FloatArray:
        """Return the frame of a link in the world, shape (4, 4)."""
        state = self.bullet.getLinkState(self.body, link, computeForwardKinematics=True, physicsClientId=self.client)
        return _pose(self.bullet, state[4], state[5])

    def capsules(self, link: int) -> list[tuple[float, FloatArray, FloatArray]]:
        """Return radius and ends in the link's frame of its collision shapes, which must be capsules."""
        found = []
        inertial = self.bullet.getLinkState(self.body, link, physicsClientId=self.client)[2:4]
        for shape in self.bullet.getCollisionShapeData(self.body, link, physicsClientId=self.client):
            assert shape[2] == self.bullet.GEOM_CAPSULE
            length, radius = shape[3][:2]
            pose = _pose(self.bullet, *inertial) @ _pose(self.bullet, shape[5], shape[6])
            half = pose[:3, 2] * length / 2
            found.append((radius, pose[:3, 3] - half, pose[:3, 3] + half))
        return found


@contextmanager
def bullet_body(path: Path, position: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Iterator[BulletBody]:
    """Load a body with its base fixed; skip the test without PyBullet."""
    bullet = pytest.importorskip("pybullet")
    client = bullet.connect(bullet.DIRECT)
    try:
        body = bullet.loadURDF(str(path), position, useFixedBase=True, physicsClientId=client)
        yield BulletBody(bullet, client, body)
    finally:
        bullet.disconnect(physicsClientId=client)


def _pose(bullet: Any, position: tuple[float, ...], turn: tuple[float, ...]) -> FloatArray:  # noqa: ANN401 - see above
    pose = np.eye(4)
    pose[:3, :3] = np.reshape(bullet.getMatrixFromQuaternion(turn), (3, 3))
    pose[:3, 3] = position
    return pose
