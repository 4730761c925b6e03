"""Distances between bodies made of capsules, in numpy alone: an oracle for what PyBullet says.

Forward kinematics come from the URDF's XML; all samples of a run are taken at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import numpy as np
import numpy.typing as npt

from hrclog.arrays import FloatArray

_HALVINGS = 60


@dataclass(frozen=True, eq=False)
class _Joint:
    name: str
    kind: str
    parent: str
    child: str
    origin: FloatArray  # (4, 4)
    axis: FloatArray  # (3,)


class Body:
    """A body described by URDF, whose collision shapes are capsules.

    Args:
        urdf: the text.
        stands: where its root link is, m.
    """

    def __init__(self, urdf: str, stands: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        root = ET.fromstring(urdf)  # noqa: S314 - a file of this package
        self._root = _transform(stands, (0.0, 0.0, 0.0))
        self._joints = [_joint(element) for element in root.findall("joint")]
        self.joint_names = tuple(joint.name for joint in self._joints if joint.kind != "fixed")
        self.links: list[str] = []
        """Link of each capsule."""
        radii, ends = [], []
        for link in root.findall("link"):
            for shape in link.findall("collision"):
                capsule = shape.find("geometry/capsule")
                assert capsule is not None, "a collision shape that is no capsule"
                half = float(capsule.attrib["length"]) / 2
                frame = _origin(shape)
                self.links.append(link.attrib["name"])
                radii.append(float(capsule.attrib["radius"]))
                ends.append([frame @ (0.0, 0.0, -half, 1.0), frame @ (0.0, 0.0, half, 1.0)])
        self.radii: FloatArray = np.array(radii)
        self._ends: FloatArray = np.array(ends)  # (k, 2, 4)

    def neighbours(self) -> set[frozenset[str]]:
        """Return the pairs of links that share a joint."""
        return {frozenset((joint.parent, joint.child)) for joint in self._joints}

    def frames(self, q: FloatArray) -> dict[str, FloatArray]:
        """Return the frames of all links, (n, 4, 4) each, at joints (n, count)."""
        children = {joint.child for joint in self._joints}
        roots = {joint.parent for joint in self._joints} - children
        assert len(roots) == 1
        found = {roots.pop(): np.broadcast_to(self._root, (len(q), 4, 4))}
        column = {name: number for number, name in enumerate(self.joint_names)}
        left = list(self._joints)
        while left:
            joint = next(joint for joint in left if joint.parent in found)
            left.remove(joint)
            frame = found[joint.parent] @ joint.origin
            if joint.kind != "fixed":
                frame = frame @ _moved(joint, q[:, column[joint.name]])
            found[joint.child] = frame
        return found

    def segments(self, q: FloatArray) -> FloatArray:
        """Return the capsules' segments, shape (n, k, 2, 3), at joints (n, count)."""
        frames = self.frames(q)
        return np.stack(
            [
                np.einsum("nij,ej->nei", frames[link], ends)[..., :3]
                for link, ends in zip(self.links, self._ends, strict=True)
            ],
            axis=1,
        )


def capsule_distances(one: Body, q_one: FloatArray, other: Body, q_other: FloatArray) -> FloatArray:
    """Return the distances between all capsules of two bodies, shape (n, k, m); below 0 they are inside each other."""
    a, b = one.segments(q_one)[:, :, None], other.segments(q_other)[:, None]
    radii = one.radii[:, None] + other.radii[None]
    return segment_distances(a[..., 0, :], a[..., 1, :], b[..., 0, :], b[..., 1, :]) - radii


def least_distances(one: Body, q_one: FloatArray, other: Body, q_other: FloatArray) -> FloatArray:
    """Return the smallest distance between two bodies, shape (n,), sooner than by all of `capsule_distances`.

    Capsules farther apart than the middles of others cannot be the nearest.
    """
    a, b = one.segments(q_one)[:, :, None], other.segments(q_other)[:, None]
    radii = one.radii[:, None] + other.radii[None]
    middles = np.linalg.norm((a[..., 0, :] + a[..., 1, :] - b[..., 0, :] - b[..., 1, :]) / 2, axis=-1)
    halves = [np.linalg.norm(ends[..., 1, :] - ends[..., 0, :], axis=-1) / 2 for ends in (a, b)]
    most = (middles - radii).min(axis=(1, 2))
    row, i, j = np.nonzero(middles - halves[0] - halves[1] - radii <= most[:, None, None])
    left, right = a[row, i, 0], b[row, 0, j]
    found = segment_distances(left[:, 0], left[:, 1], right[:, 0], right[:, 1]) - radii[i, j]
    least = np.full(len(q_one), math.inf)
    np.minimum.at(least, row, found)
    return least


def own_distances(body: Body, q: FloatArray) -> FloatArray:
    """Return the smallest distance between parts of one body that share no joint, shape (n,)."""
    segments, joined = body.segments(q), body.neighbours()
    found = [
        segment_distances(*segments[:, a].swapaxes(0, 1), *segments[:, b].swapaxes(0, 1))
        - body.radii[a]
        - body.radii[b]
        for b, two in enumerate(body.links)
        for a, one in enumerate(body.links[:b])
        if one != two and frozenset((one, two)) not in joined
    ]
    return np.asarray(np.min(found, axis=0))


def segment_distances(a0: FloatArray, a1: FloatArray, b0: FloatArray, b1: FloatArray) -> FloatArray:
    """Return the distances between segments a and b; shapes (..., 3), broadcast.

    The nearest points are an end and its foot on the other segment, or inner points of both.
    """
    ends = [
        point_distances(a0, b0, b1),
        point_distances(a1, b0, b1),
        point_distances(b0, a0, a1),
        point_distances(b1, a0, a1),
    ]
    u, v, w = a1 - a0, b1 - b0, a0 - b0
    uu, uv, vv = (u * u).sum(-1), (u * v).sum(-1), (v * v).sum(-1)
    uw, vw = (u * w).sum(-1), (v * w).sum(-1)
    area = uu * vv - uv * uv
    across = np.where(area > 1e-18, area, 1.0)
    s, t = (uv * vw - vv * uw) / across, (uu * vw - uv * uw) / across
    within = (area > 1e-18) & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    inner = np.linalg.norm(w + s[..., None] * u - t[..., None] * v, axis=-1)
    return np.asarray(np.minimum(np.minimum.reduce(ends), np.where(within, inner, math.inf)))


def point_distances(point: FloatArray, b0: FloatArray, b1: FloatArray) -> FloatArray:
    """Return the distances of points from segments; shapes (..., 3), broadcast."""
    along = b1 - b0
    length = (along * along).sum(-1)
    share = ((point - b0) * along).sum(-1) / np.where(length > 0.0, length, 1.0)
    foot = b0 + np.clip(share, 0.0, 1.0)[..., None] * along
    return np.asarray(np.linalg.norm(point - foot, axis=-1))


def box_distances(
    body: Body, q: FloatArray, size: tuple[float, float, float], position: tuple[float, float, float]
) -> FloatArray:
    """Return the distances of a body's capsules from a box along the axes, shape (n, k); at most 0 where they touch.

    The distance from a box is convex along a segment, so that thirds close in on the nearest point.
    """
    segments = body.segments(q)
    start, way = segments[..., 0, :], segments[..., 1, :] - segments[..., 0, :]
    low, high = np.subtract(position, np.divide(size, 2)), np.add(position, np.divide(size, 2))

    def away(share: FloatArray) -> FloatArray:
        point = start + share[..., None] * way
        return np.asarray(np.linalg.norm(point - np.clip(point, low, high), axis=-1))

    left, right = np.zeros(start.shape[:-1]), np.ones(start.shape[:-1])
    for _ in range(_HALVINGS):
        third = (right - left) / 3
        nearer = away(left + third) <= away(right - third)
        left, right = np.where(nearer, left, left + third), np.where(nearer, right - third, right)
    return away((left + right) / 2) - body.radii


def _joint(element: ET.Element) -> _Joint:
    axis = element.find("axis")
    parent, child = element.find("parent"), element.find("child")
    assert parent is not None
    assert child is not None
    turn = np.array([1.0, 0.0, 0.0]) if axis is None else _numbers(axis.attrib["xyz"])
    return _Joint(
        element.attrib["name"],
        element.attrib["type"],
        parent.attrib["link"],
        child.attrib["link"],
        _origin(element),
        turn,
    )


def _origin(element: ET.Element) -> FloatArray:
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    return _transform(_numbers(origin.get("xyz", "0 0 0")), _numbers(origin.get("rpy", "0 0 0")))


def _transform(xyz: npt.ArrayLike, rpy: npt.ArrayLike) -> FloatArray:
    """Return the frame of an origin: roll, pitch and yaw about fixed axes, in this order."""
    frame = np.eye(4)
    for angle, axis in zip(np.asarray(rpy), np.eye(3), strict=True):
        frame[:3, :3] = _rotations(axis, np.array([angle]))[0] @ frame[:3, :3]
    frame[:3, 3] = xyz
    return frame


def _moved(joint: _Joint, values: FloatArray) -> FloatArray:
    """Return what a joint does to its child, (n, 4, 4)."""
    frames = np.tile(np.eye(4), (len(values), 1, 1))
    if joint.kind == "prismatic":
        frames[:, :3, 3] = values[:, None] * joint.axis
    else:
        assert joint.kind in ("revolute", "continuous")
        frames[:, :3, :3] = _rotations(joint.axis, values)
    return frames


def _rotations(axis: FloatArray, angles: FloatArray) -> FloatArray:
    """Return rotations about a unit axis, (n, 3, 3); O. Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sines, cosines = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.asarray(np.eye(3) + sines * cross + (1.0 - cosines) * (cross @ cross))


def _numbers(text: str) -> FloatArray:
    return np.array([float(number) for number in text.split()])
