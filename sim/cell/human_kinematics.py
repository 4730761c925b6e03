"""Where the points of a person's body are, and how a hand reaches a point."""

from __future__ import annotations

import math
from typing import Final, Literal

import numpy as np

from hrclog.arrays import FloatArray

Side = Literal["left", "right"]

HUMAN_JOINT_NAMES: Final = (
    "base_x",
    "base_y",
    "base_yaw",
    "torso_bend",
    "head_nod",
    *(
        f"{side}_{joint}"
        for side in ("left", "right")
        for joint in ("shoulder_yaw", "shoulder_pitch", "elbow_pitch", "wrist_pitch")
    ),
)
"""At zero a person stands upright at the origin, looks along +x, and the arms hang. A positive bend or nod leans
forward; a positive pitch of the shoulder, elbow or wrist raises what it moves forward and up."""

BODY_POINTS: Final = (
    "head",
    "neck",
    "pelvis",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
    "left_hand",
    "right_hand",
)

HIP_HEIGHT_M: Final = 0.95
SHOULDER_RISE_M: Final = 0.47
"""Height of the shoulders over the hips."""
NECK_RISE_M: Final = 0.53
HEAD_RISE_M: Final = 0.16
"""Height of the middle of the head over the neck, where it nods."""
SHOULDER_HALF_WIDTH_M: Final = 0.20
UPPER_ARM_M: Final = 0.31
FOREARM_M: Final = 0.27
HAND_M: Final = 0.12

HUMAN_LOWER: Final = (-100.0, -100.0, -math.inf, 0.0, -0.8, *(-1.2, -1.0, 0.0, -1.4), *(-2.2, -1.0, 0.0, -1.4))
HUMAN_UPPER: Final = (100.0, 100.0, math.inf, 0.6, 0.8, *(2.2, 3.0, 2.6, 1.4), *(1.2, 3.0, 2.6, 1.4))
"""Limits of the joints in m and rad; a person may turn on the spot without end."""

_BISECTIONS: Final = 30


def human_points(q: FloatArray) -> FloatArray:
    """Return where the points of the body are, quickly.

    Args:
        q: joint positions, shape (13,).

    Returns:
        Points in the world, in m, shape (11, 3), in the order of BODY_POINTS.
    """
    x, y, yaw, bend, nod, *arms = q.tolist()
    c, s = math.cos(yaw), math.sin(yaw)
    cb, sb = math.cos(bend), math.sin(bend)
    neck = (NECK_RISE_M * sb, 0.0, NECK_RISE_M * cb)
    head = (neck[0] + HEAD_RISE_M * math.sin(bend + nod), 0.0, neck[2] + HEAD_RISE_M * math.cos(bend + nod))
    left = _arm(SHOULDER_HALF_WIDTH_M, cb, sb, arms[:4])
    right = _arm(-SHOULDER_HALF_WIDTH_M, cb, sb, arms[4:])
    points = [head, neck, (0.0, 0.0, 0.0)]
    for pair in zip(left, right, strict=True):
        points += pair
    return np.array([(x + c * px - s * py, y + s * px + c * py, HIP_HEIGHT_M + pz) for px, py, pz in points])


def reach(base: tuple[float, float, float], target: FloatArray, side: Side) -> FloatArray | None:
    """Return how a person who stands somewhere holds the tip of a hand at a point, or None if it is out of reach.

    The arm lies in the plane through the shoulder, the target and the torso's axis, the hand is level in it, and the
    torso bends no more than it has to. The other arm hangs.

    Args:
        base: x and y in m, yaw in rad.
        target: in the world, in m, shape (3,).
        side: which hand.

    Returns:
        Joint positions within HUMAN_LOWER and HUMAN_UPPER, shape (13,), or None.
    """
    x, y, yaw = base
    c, s = math.cos(yaw), math.sin(yaw)
    dx, dy, dz = float(target[0]) - x, float(target[1]) - y, float(target[2]) - HIP_HEIGHT_M
    offset = SHOULDER_HALF_WIDTH_M if side == "left" else -SHOULDER_HALF_WIDTH_M
    goal = (c * dx + s * dy, c * dy - s * dx - offset, dz)
    low, bend = 0.0, 0.0
    arm = _arm_to(goal, bend)
    if arm is None:
        bend = HUMAN_UPPER[3]
        arm = _arm_to(goal, bend)
    if arm is None:
        return None
    if bend:
        for _ in range(_BISECTIONS):
            middle = (low + bend) / 2
            bent_arm = _arm_to(goal, middle)
            if bent_arm is None:
                low = middle
            else:
                bend, arm = middle, bent_arm
    q = np.array(
        (x, y, yaw, bend, 0.0, *(arm if side == "left" else (0.0,) * 4), *(arm if side == "right" else (0.0,) * 4))
    )
    return q if ((q >= HUMAN_LOWER) & (q <= HUMAN_UPPER)).all() else None


Point = tuple[float, float, float]


def _arm(offset: float, cb: float, sb: float, angles: list[float]) -> list[Point]:
    """Return the shoulder, elbow, wrist and tip of the hand from the hips, before the body turns."""
    swing, shoulder, elbow, wrist = angles
    cs, ss = math.cos(swing), math.sin(swing)
    along, rise = 0.0, SHOULDER_RISE_M
    points = [(rise * sb, offset, rise * cb)]
    raised = 0.0
    for length, angle in ((UPPER_ARM_M, shoulder), (FOREARM_M, elbow), (HAND_M, wrist)):
        raised += angle
        along += length * math.sin(raised)
        rise -= length * math.cos(raised)
        points.append((cb * along * cs + sb * rise, offset + along * ss, cb * rise - sb * along * cs))
    return points


def _arm_to(goal: Point, bend: float) -> tuple[float, float, float, float] | None:
    """Return the angles of an arm whose hand is level at a point seen from the hips, beside them as the shoulder is."""
    cb, sb = math.cos(bend), math.sin(bend)
    forward, aside, up = cb * goal[0] - sb * goal[2], goal[1], sb * goal[0] + cb * goal[2] - SHOULDER_RISE_M
    swing = math.atan2(aside, forward)
    level = math.atan2(sb * math.cos(swing), cb)  # the angle of the horizontal in the arm's plane
    along, rise = math.hypot(forward, aside) - HAND_M * math.cos(level), up - HAND_M * math.sin(level)
    cosine = (along**2 + rise**2 - UPPER_ARM_M**2 - FOREARM_M**2) / (2 * UPPER_ARM_M * FOREARM_M)
    if not -1.0 <= cosine <= 1.0:
        return None
    elbow = math.acos(cosine)
    inner = math.atan2(FOREARM_M * math.sin(elbow), UPPER_ARM_M + FOREARM_M * cosine)
    shoulder = math.atan2(along, -rise) - inner
    return swing, shoulder, elbow, math.pi / 2 + level - shoulder - elbow
