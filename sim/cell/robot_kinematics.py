"""Where a UR5 on a linear rail is, how fast its points move, and how it reaches a pose."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from hrclog.arrays import FloatArray, IntArray

JOINT_NAMES: Final = ("rail", "shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")

DH_A: Final = (0.0, -0.425, -0.39225, 0.0, 0.0, 0.0)
DH_D: Final = (0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823)
DH_ALPHA: Final = (math.pi / 2, 0.0, 0.0, math.pi / 2, -math.pi / 2, 0.0)
"""Denavit-Hartenberg parameters of the UR5 as its maker publishes them; lengths in m."""

_TWISTS: Final = tuple((math.cos(alpha), math.sin(alpha)) for alpha in DH_ALPHA)
_TWO_PI: Final = 2 * math.pi
_POSE_ERROR: Final = 1e-6
_ROUNDING: Final = 1e-9
_BRANCHES: Final = np.array([(s, w, e) for s in (1.0, -1.0) for w in (1.0, -1.0) for e in (1.0, -1.0)])
"""Signs of shoulder, wrist and elbow in the eight solutions of a pose."""


@dataclass(frozen=True)
class RailArm:
    """A UR5 on a carriage that travels along world x.

    Joints are in the order of JOINT_NAMES: the rail in m, the others in rad. The carriage's frame is the arm's base.

    Args:
        rail_y: where the rail lies, in m.
        base_z: height of the arm's base, in m.
        yaw: rotation of the arm's base about z on the carriage, in rad.
        tip_m: distance of the gripper's tip from tool0 along its z, in m.
        lower: limits of the joints; none may span more than a turn.
        upper: see `lower`.
        max_velocity: of the joints, in m/s and rad/s.
        max_acceleration: of the joints, in m/s^2 and rad/s^2.
    """

    rail_y: float = -0.32
    base_z: float = 1.02
    yaw: float = 0.0
    tip_m: float = 0.15
    lower: tuple[float, ...] = (0.0, -math.pi, -math.pi, -2.79, -math.pi, -math.pi, -math.pi)
    upper: tuple[float, ...] = (1.45, math.pi, 0.0, 2.79, math.pi, math.pi, math.pi)
    max_velocity: tuple[float, ...] = (1.0, *[3.15] * 6)
    max_acceleration: tuple[float, ...] = (2.0, *[10.0] * 6)

    def forward(self, q: FloatArray) -> FloatArray:
        """Return where the gripper's tip is; its z is the direction of approach.

        Args:
            q: joint positions, shape (..., 7).

        Returns:
            Poses in the world, shape (..., 4, 4).
        """
        pose = np.zeros((*q.shape[:-1], 4, 4))
        x, y, z, position = (pose[..., :3, column] for column in range(4))
        x[..., 0] = y[..., 1] = math.cos(self.yaw)
        x[..., 1] = math.sin(self.yaw)
        y[..., 0] = -x[..., 1]
        z[..., 2] = pose[..., 3, 3] = 1.0
        position[..., 0] = q[..., 0]
        position[..., 1:] = self.rail_y, self.base_z
        cosines, sines = np.cos(q), np.sin(q)
        for joint, (a, d, (ca, sa)) in enumerate(zip(DH_A, DH_D, _TWISTS, strict=True), start=1):
            c, s = cosines[..., joint, None], sines[..., joint, None]
            turned = c * y - s * x
            x[...] = c * x + s * y
            position += d * z + a * x
            y[...] = ca * turned + sa * z
            z[...] = ca * z - sa * turned
        position += self.tip_m * z
        return pose

    def frames(self, q: FloatArray) -> FloatArray:
        """Return the frames along the arm, quickly.

        Args:
            q: joint positions, shape (7,).

        Returns:
            Poses in the world, shape (8, 4, 4): the carriage, the Denavit-Hartenberg frames after joints 1 to 6 (z of
            each is the axis of the next joint), the tip.
        """
        rail, *angles = q.tolist()
        xx, xy, xz = math.cos(self.yaw), math.sin(self.yaw), 0.0
        yx, yy, yz = -xy, xx, 0.0
        zx, zy, zz = 0.0, 0.0, 1.0
        px, py, pz = rail, self.rail_y, self.base_z
        rows = [xx, yx, zx, px, xy, yy, zy, py, xz, yz, zz, pz, 0.0, 0.0, 0.0, 1.0]
        for angle, a, d, (ca, sa) in zip(angles, DH_A, DH_D, _TWISTS, strict=True):
            c, s = math.cos(angle), math.sin(angle)
            tx, ty, tz = c * yx - s * xx, c * yy - s * xy, c * yz - s * xz
            xx, xy, xz = c * xx + s * yx, c * xy + s * yy, c * xz + s * yz
            px, py, pz = px + d * zx + a * xx, py + d * zy + a * xy, pz + d * zz + a * xz
            yx, yy, yz = ca * tx + sa * zx, ca * ty + sa * zy, ca * tz + sa * zz
            zx, zy, zz = ca * zx - sa * tx, ca * zy - sa * ty, ca * zz - sa * tz
            rows += (xx, yx, zx, px, xy, yy, zy, py, xz, yz, zz, pz, 0.0, 0.0, 0.0, 1.0)
        tip = self.tip_m
        px, py, pz = px + tip * zx, py + tip * zy, pz + tip * zz
        rows += (xx, yx, zx, px, xy, yy, zy, py, xz, yz, zz, pz, 0.0, 0.0, 0.0, 1.0)
        return np.array(rows).reshape(8, 4, 4)

    @staticmethod
    def point_velocity(frames: FloatArray, qd: FloatArray, link: IntArray, points: FloatArray) -> FloatArray:
        """Return how fast points that are fixed on links move (the geometric Jacobian times `qd`).

        Args:
            frames: of `frames`, shape (8, 4, 4).
            qd: joint velocities, shape (7,).
            link: what each point is fixed on, shape (k,): 0 the carriage, i what joint i moves, 7 the gripper.
            points: in the world, in m, shape (k, 3).

        Returns:
            Velocities in the world, in m/s, shape (k, 3).
        """
        axes, origins = frames[:6, :3, 2], frames[:6, :3, 3]
        turns = np.zeros((8, 3))  # angular velocity of a link
        moves = np.zeros((8, 3))  # velocity of the point of a link at the world's origin
        turns[1:7] = qd[1:, None] * axes
        moves[1:7] = _cross(origins, turns[1:7])
        moves[0, 0] = qd[0]
        return moves.cumsum(axis=0)[link] + _cross(turns.cumsum(axis=0)[link], points)

    def inverse(self, poses: FloatArray, rails: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return all joint positions within the limits that bring the tip to poses.

        The eight analytic solutions of the UR5 (K. P. Hawkins, Analytic inverse kinematics for the Universal Robots
        UR-5/UR-10 arms, 2013), each checked against `forward`.

        Args:
            poses: of the tip in the world, shape (m, 4, 4).
            rails: positions of the carriage to try, in m, shape (r,).

        Returns:
            Solutions, shape (n, 7), and the index of the pose that each reaches, shape (n,); ordered by pose, rail
            position and branch. Of the infinitely many that wrist_2 = 0 allows, only those with wrist_3 = 0.
        """
        count = len(poses) * len(rails) * len(_BRANCHES)
        q = self._solve(poses, rails).reshape(count, 7)
        target = np.repeat(np.arange(len(poses)), len(rails) * len(_BRANCHES))
        within = np.clip(q, self.lower, self.upper)
        good = (np.abs(q - within) <= _ROUNDING).all(axis=1)
        q, target = within[good], target[good]
        exact = (np.abs(self.forward(q) - poses[target]) <= _POSE_ERROR).all(axis=(1, 2))
        return q[exact], target[exact]

    def _solve(self, poses: FloatArray, rails: FloatArray) -> FloatArray:
        """Return the candidates, shape (m, r, 8, 7); wrong where a pose is out of reach."""
        to_base = np.array([[math.cos(self.yaw), math.sin(self.yaw)], [-math.sin(self.yaw), math.cos(self.yaw)]])
        x, y, z, tip = (poses[:, None, None, :3, column].copy() for column in range(4))
        rail = rails[:, None]
        position = np.broadcast_to(tip - (self.tip_m + DH_D[5]) * z, (len(poses), len(rails), 1, 3)).copy()
        position -= np.stack((rail, np.full_like(rail, self.rail_y), np.full_like(rail, self.base_z)), axis=-1)
        for vector in (x, y, z, position):
            vector[..., :2] = vector[..., :2] @ to_base.T
        shoulder, wrist, elbow = _BRANCHES.T

        px, py = position[..., 0], position[..., 1]
        radius = np.maximum(np.hypot(px, py), DH_D[3])
        pan = np.arctan2(py, px) + shoulder * np.arccos(DH_D[3] / radius) + math.pi / 2
        c1, s1 = np.cos(pan), np.sin(pan)

        across_x, across_y, across_z = (s1 * axis[..., 0] - c1 * axis[..., 1] for axis in (x, y, z))
        sine = np.hypot(across_x, across_y)
        wrist_2 = wrist * np.arctan2(sine, across_z)
        wrist_3 = np.arctan2(-wrist * across_y, wrist * across_x)
        wrist_3[sine < _ROUNDING] = 0.0  # joints 4 and 6 share an axis: any angle would do

        # Back from the tool to frame 4; what is left is a two-link arm in the vertical plane of (c1, s1, 0) and z.
        c6, s6 = np.cos(wrist_3)[..., None], np.sin(wrist_3)[..., None]
        c5, s5 = np.cos(wrist_2)[..., None], np.sin(wrist_2)[..., None]
        x5 = c6 * x - s6 * y
        z4 = -s6 * x - c6 * y
        x4 = c5 * x5 - s5 * z
        bend = np.arctan2(x4[..., 2], c1 * x4[..., 0] + s1 * x4[..., 1])  # lift + elbow + wrist_1
        centre = position - DH_D[4] * z4
        u, v = c1 * centre[..., 0] + s1 * centre[..., 1], centre[..., 2] - DH_D[0]
        a2, a3 = DH_A[1], DH_A[2]
        cosine = np.clip((u**2 + v**2 - a2**2 - a3**2) / (2 * a2 * a3), -1.0, 1.0)
        q3 = elbow * np.arccos(cosine)
        lift = np.arctan2(v, u) - np.arctan2(a3 * np.sin(q3), a2 + a3 * cosine)

        shape = (len(poses), len(rails), len(_BRANCHES))
        joints = (rail, pan, lift, q3, bend - lift - q3, wrist_2, wrist_3)
        q = np.stack([np.broadcast_to(joint, shape) for joint in joints], axis=-1)
        middle = (np.array(self.lower) + np.array(self.upper)) / 2
        q[..., 1:] -= _TWO_PI * np.round((q[..., 1:] - middle[1:]) / _TWO_PI)
        return q


def top_down(position: FloatArray, yaw: float) -> FloatArray:
    """Return the pose of a gripper that points straight down.

    Args:
        position: of the tip, in m, shape (3,).
        yaw: direction of its x in the plane, in rad.

    Returns:
        The pose, shape (4, 4).
    """
    c, s = math.cos(yaw), math.sin(yaw)
    x, y, z = position
    return np.array([[c, s, 0.0, x], [s, -c, 0.0, y], [0.0, 0.0, -1.0, z], [0.0, 0.0, 0.0, 1.0]])


def _cross(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return the cross products of vectors, shape (k, 3); much quicker than `np.cross` for few."""
    lx, ly, lz = left.T
    rx, ry, rz = right.T
    return np.stack((ly * rz - lz * ry, lz * rx - lx * rz, lx * ry - ly * rx), axis=-1)
