"""How the human moves: walk to where the target is in reach, reach, grasp or let go, draw back. No path planning."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import accumulate
from typing import Final

import numpy as np

from hrclog.arrays import FloatArray
from hrclog.errors import ScenarioError
from hrclog.sim.cell.description import Cell, HumanModel, Point
from hrclog.sim.cell.human_kinematics import human_points, reach

Pose = tuple[float, float, float]
"""x and y in m, yaw in rad."""

_TURN_RAD_S: Final = 2.0
_RAMP: Final = 0.2
"""Share of a move spent on speeding up, and on slowing down again."""
_RIGHT_HAND: Final = 10
_RIGHT_SIDE: Final = "right"
_POSTURE: Final = (0.0, 0.0, 0.0, 0.15, 1.1, 0.0, 0.0, 0.15, 1.1, 0.0)
"""Torso, head and arms (10,) of somebody who walks with the forearms raised."""


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """A smooth move from joints to joints, shapes (13,)."""

    start: FloatArray
    end: FloatArray
    duration_s: float


class HumanMotion:
    """Moves one after another.

    Args:
        moves: each begins where the one before ends.
        reach_at_s: when the hand sets out for the target.
        grip_at_s: when the hand has closed or opened.
    """

    def __init__(self, moves: list[Move], reach_at_s: float = 0.0, grip_at_s: float = 0.0) -> None:
        self._moves = moves
        self._ends = list(accumulate(move.duration_s for move in moves))
        self.reach_at_s = reach_at_s
        self.grip_at_s = grip_at_s

    @property
    def duration_s(self) -> float:
        """How long all moves take."""
        return self._ends[-1] if self._ends else 0.0

    def at(self, time_s: float) -> FloatArray:
        """Return the joints (13,) at a time since the motion began."""
        for move, end_s in zip(self._moves, self._ends, strict=True):
            if time_s < end_s:
                share = progress(1.0 - (end_s - time_s) / move.duration_s)
                return move.start + share * (move.end - move.start)
        return self._moves[-1].end


def progress(share: float) -> float:
    """Return the share of the way after a share of the time: speed rises, holds and falls as a trapezoid."""
    top = 1.0 / (1.0 - _RAMP)
    if share <= 0.0:
        return 0.0
    if share < _RAMP:
        return top * share**2 / (2 * _RAMP)
    if share <= 1.0 - _RAMP:
        return top * (share - _RAMP / 2)
    return 1.0 - top * max(1.0 - share, 0.0) ** 2 / (2 * _RAMP)


def standing(pose: Pose) -> FloatArray:
    """Return the joints (13,) of a human who stands somewhere."""
    return np.array((*pose, *_POSTURE))


def stand_pose(target: Point, offset: tuple[float, float], yaw_now: float) -> Pose:
    """Return where to stand to reach a target; the yaw is the equal one that takes the least turning."""
    yaw = math.atan2(-offset[1], -offset[0])
    return target[0] + offset[0], target[1] + offset[1], yaw_now + math.remainder(yaw - yaw_now, 2 * math.pi)


def walk(model: HumanModel, start: FloatArray, pose: Pose, pace: float) -> Move:
    """Return the walk to a pose; `pace` multiplies its duration."""
    way_m = math.hypot(pose[0] - start[0], pose[1] - start[1])
    turn_s = abs(pose[2] - start[2]) / _TURN_RAD_S
    return Move(start, standing(pose), pace * max(way_m / model.walk_speed, turn_s))


def handle(
    model: HumanModel,
    start: FloatArray,
    target: Point,
    offset: tuple[float, float],
    pace: float,
    grip_s: float,
    pause_s: float,
) -> HumanMotion:
    """Return the motion that takes hold of, or lets go of, an object.

    Args:
        model: how fast the human is.
        start: joints (13,).
        target: where the hand goes, m.
        offset: where to stand, see `Stand`.
        pace: multiplies all durations but the pause.
        grip_s: time for closing or opening the hand.
        pause_s: hesitation before the hand sets out.

    Raises:
        ScenarioError: the target is out of reach.
    """
    walking = walk(model, start, stand_pose(target, offset, float(start[2])), pace)
    reached = reach_pose(walking.end, target)
    hand_s = pace * _hand_distance_m(walking.end, reached) / model.hand_speed
    moves = [
        walking,
        Move(walking.end, walking.end, pause_s),
        Move(walking.end, reached, hand_s),
        Move(reached, reached, pace * grip_s),
        Move(reached, walking.end, hand_s),
    ]
    reach_at_s = walking.duration_s + pause_s
    return HumanMotion(
        [move for move in moves if move.duration_s > 0.0], reach_at_s, reach_at_s + hand_s + pace * grip_s
    )


def reach_pose(standing_joints: FloatArray, target: Point) -> FloatArray:
    """Return the joints (13,) that hold the right hand at a target.

    Raises:
        ScenarioError: it is out of reach.
    """
    x, y, yaw = standing_joints[:3].tolist()
    reached = reach((x, y, yaw), np.asarray(target), _RIGHT_SIDE)
    if reached is None:
        at = ", ".join(f"{value:.2f}" for value in target)
        raise ScenarioError(f"cell: the human who stands at ({x:.2f}, {y:.2f}) cannot reach ({at}); change its stand")
    reached[5:9] = standing_joints[5:9]
    return reached


def hand_position(joints: FloatArray) -> FloatArray:
    """Return where the tip of the right hand is, m, shape (3,)."""
    return np.asarray(human_points(joints)[_RIGHT_HAND])


def check_reach(cell: Cell) -> None:
    """Raise if the human cannot reach something that a skill asks for.

    Raises:
        ScenarioError: names what is out of reach.
    """
    for skill in (skill for skill in cell.skills if skill.agent == cell.human.agent):
        places = [(group, *place) for group in (skill.objects, skill.slots) for place in cell.places_of(group)]
        for group, name, position in places:
            try:
                reach_pose(standing(stand_pose(position, cell.stand[group], 0.0)), position)
            except ScenarioError as error:
                raise ScenarioError(f"{skill.task!r} by {skill.agent!r}: {name!r}: {error}") from error


def _hand_distance_m(start: FloatArray, end: FloatArray) -> float:
    return float(np.linalg.norm(hand_position(end) - hand_position(start)))
