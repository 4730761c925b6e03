"""How the robot does a symbolic task: candidate targets, inverse kinematics over the rail, a path that is free."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hrclog.arrays import FloatArray
from hrclog.errors import ScenarioError
from hrclog.sim.bullet.motion import Dwell, Path, path_through, trapezoid
from hrclog.sim.bullet.rrt_connect import edge_free, rrt_connect
from hrclog.sim.cell.description import Cell, Point, RobotModel
from hrclog.sim.cell.robot_kinematics import RailArm, top_down
from hrclog.sim.stream import Stream

Free = Callable[[FloatArray], bool]

_YAWS: Final = (0.0, math.pi / 2)
_RAIL_STEPS: Final = 30
_CANDIDATES: Final = 60
_STEP: Final = 0.06
"""Joint distance (rad or m) between two points of a path that are looked at."""
_FALLBACKS: Final = 3
_BRANCH: Final = 1.0
"""Above and at a target the joints differ by less than this, or the arm would swing round between the two."""


@dataclass(frozen=True, slots=True)
class Target:
    """Something to go to: an object, or a slot."""

    name: str
    position: Point


@dataclass(frozen=True, slots=True, eq=False)
class RobotMotion:
    """A planned motion; the gripper, turned by `yaw`, has closed or opened at `grip_at_s` (inf: it does neither)."""

    path: Path
    target: str = ""
    position: Point = (0.0, 0.0, 0.0)
    grip_at_s: float = math.inf
    yaw: float | None = None

    @property
    def duration_s(self) -> float:
        """How long it takes at full speed."""
        return self.path.duration_s


def make_arm(model: RobotModel) -> RailArm:
    """Return the arm of a cell."""
    return RailArm(rail_y=model.rail_y, base_z=model.base_z)


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    """A way to hold the gripper at a target: pose (4, 4) and joints (7,)."""

    target: Target
    yaw: float
    pose: FloatArray
    joints: FloatArray


class RobotPlanner:
    """Plan motions among fixtures.

    Args:
        model: how the robot moves.
        arm: its kinematics.
        free: whether joints (7,) are free of collisions.
        stream: random numbers of the fallback planner.
    """

    def __init__(self, model: RobotModel, arm: RailArm, free: Free, stream: Stream) -> None:
        self._model = model
        self._arm = arm
        self._free = free
        self._stream = stream
        self._velocity = np.array(arm.max_velocity) * model.speed
        self._acceleration = np.array(arm.max_acceleration) * model.acceleration
        self._rails = np.linspace(arm.lower[0], arm.upper[0], _RAIL_STEPS)

    def handle(
        self, start: FloatArray, targets: Sequence[Target], grip_s: float, turned_from: float | None = None
    ) -> RobotMotion | None:
        """Return the motion that takes hold of, or lets go of, an object at the target that is reached soonest.

        It goes above the target, down, closes or opens the gripper, and up again.

        Args:
            start: joints (7,).
            targets: to choose from.
            grip_s: time the gripper takes.
            turned_from: the yaw that was tried before; the gripper is turned from it.

        Returns:
            The motion, or None where no target can be reached without a collision.
        """
        yaws = [yaw for yaw in _YAWS if yaw != turned_from]
        grasps = [(target, yaw) for target in targets for yaw in yaws]
        if not grasps:
            return None
        poses = np.array([top_down(np.asarray(target.position), yaw) for target, yaw in grasps])
        solutions, pose_indices = self._arm.inverse(poses, self._rails)
        order = np.argsort(self._travel_times(solutions - start), kind="stable")[:_CANDIDATES]
        candidates = []
        for number, joints in zip(pose_indices[order].tolist(), solutions[order], strict=True):
            target, yaw = grasps[number]
            candidates.append(_Candidate(target, yaw, poses[number], joints))
        chosen = self._first_reachable(start, candidates, self._straight_way) or self._first_reachable(
            start, candidates, self._way_around, _FALLBACKS
        )
        return self._grasp_motion(*chosen, grip_s) if chosen else None

    def go_to(self, start: FloatArray, end: FloatArray) -> RobotMotion | None:
        """Return the motion to joints (7,), an empty one where they are reached, None where there is no way."""
        if np.allclose(start, end, atol=1e-9):
            return RobotMotion(Path([Dwell(end, 0.0)]))
        way = self._straight_way(start, end) or self._way_around(start, end)
        return RobotMotion(self._path(way)) if way else None

    def length_m(self, motion: RobotMotion) -> float:
        """Return how far the gripper's tip travels in a motion, m."""
        return motion.path.length_m(self._arm)

    def reachable(self, target: Target) -> bool:
        """Return whether the gripper can be at and above a target without touching anything."""
        poses = np.array([top_down(np.asarray(target.position), yaw) for yaw in _YAWS])
        solutions, pose_indices = self._arm.inverse(poses, self._rails)
        return any(
            self._free(solution) and self._joints_above(poses[index], solution) is not None
            for solution, index in zip(solutions, pose_indices, strict=True)
        )

    def _first_reachable(
        self,
        start: FloatArray,
        candidates: Sequence[_Candidate],
        way_to: Callable[[FloatArray, FloatArray], list[FloatArray] | None],
        tries: int = _CANDIDATES,
    ) -> tuple[list[FloatArray], FloatArray, _Candidate] | None:
        """Return the way to above the first candidate that can be reached, the joints above it, and it."""
        for candidate in candidates:
            above = self._joints_above(candidate.pose, candidate.joints)
            if above is None or self._straight_way(above, candidate.joints) is None:
                continue
            tries -= 1
            way = way_to(start, above)
            if way is not None:
                return way, above, candidate
            if not tries:
                return None
        return None

    def _grasp_motion(
        self, way: list[FloatArray], above: FloatArray, candidate: _Candidate, grip_s: float
    ) -> RobotMotion:
        grasp, target = candidate.joints, candidate.target
        slow = self._velocity * self._model.approach
        approach = [*self._path(way).parts, trapezoid(above, grasp, slow, self._acceleration)]
        grip = Dwell(grasp, grip_s)
        path = Path([*approach, grip, trapezoid(grasp, above, slow, self._acceleration)])
        grip_at_s = sum(leg.duration_s for leg in approach) + grip_s
        return RobotMotion(path, target.name, target.position, grip_at_s, candidate.yaw)

    def _path(self, way: Sequence[FloatArray]) -> Path:
        return path_through(way, self._velocity.tolist(), self._acceleration.tolist())

    def _joints_above(self, pose: FloatArray, grasp: FloatArray) -> FloatArray | None:
        """Return the joints above a grasp, carriage where it is, that are nearest to it."""
        raised = pose.copy()
        raised[2, 3] += self._model.approach_m
        solutions, _ = self._arm.inverse(raised[None], grasp[:1])
        if not len(solutions):
            return None
        distances = np.abs(solutions - grasp).max(axis=1)
        best = int(distances.argmin())
        return solutions[best] if distances[best] < _BRANCH else None

    def _travel_times(self, way: FloatArray) -> FloatArray:
        """Return how long straight ways (n, 7) take, s."""
        distance, v, a = np.abs(way), self._velocity, self._acceleration
        ramps = 2 * np.sqrt(distance / a)
        return np.asarray(np.where(distance > v**2 / a, distance / v + v / a, ramps).max(axis=1))

    def _straight_way(self, start: FloatArray, end: FloatArray) -> list[FloatArray] | None:
        middle = (start + end) / 2  # the likeliest point to be blocked
        if self._free(end) and self._free(middle) and edge_free(start, end, self._free, _STEP):
            return [start, end]
        return None

    def _way_around(self, start: FloatArray, end: FloatArray) -> list[FloatArray] | None:
        return rrt_connect(start, end, self._arm.lower, self._arm.upper, self._free, self._stream.source)


def check_reach(cell: Cell, planner: RobotPlanner) -> None:
    """Raise if the robot cannot reach something that a skill asks for.

    Raises:
        ScenarioError: names what is out of reach.
    """
    for skill in (skill for skill in cell.skills if skill.agent == cell.robot.agent):
        places = cell.places_of(skill.objects) + cell.places_of(skill.slots)
        for target in (Target(*place) for place in places):
            if not planner.reachable(target):
                at = ", ".join(f"{value:.2f}" for value in target.position)
                raise ScenarioError(
                    f"{skill.task!r} by {skill.agent!r}: {target.name!r} at ({at}) is out of the robot's reach, or a"
                    " fixture is in the way; move it"
                )
