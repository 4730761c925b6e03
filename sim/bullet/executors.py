"""The executors of the stepped cell: the robot, which plans, and the human, who does not."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from hrclog.arrays import FloatArray
from hrclog.events import Cause
from hrclog.sim.bullet.human import HumanMotion, handle, standing, walk
from hrclog.sim.bullet.robot import RobotMotion, RobotPlanner, Target
from hrclog.sim.bullet.stepped import TICK_S, CannotError, Execution, Shared, Step, SteppedExecutor
from hrclog.sim.cell.description import GO_TO, PICK, Point, Skill
from hrclog.sim.stream import Stream

_IDLE_S: Final = 2.0
"""A human without work goes home after this time, so that the robot need not wait for ever."""


class RobotExecutor(SteppedExecutor):
    """The robot: chooses among targets, plans a path, and follows it as fast as safety allows.

    Args:
        planner: of its motions.
        shared: with the human.
        stream: random numbers of the robot.
    """

    def __init__(self, planner: RobotPlanner, shared: Shared, stream: Stream) -> None:
        super().__init__(shared.cell.robot.agent, shared, stream)
        self._planner = planner
        self._joints: FloatArray = np.array(shared.cell.robot.home.joints)
        self._last_yaws: dict[
            tuple[str, str, str], float | None
        ] = {}  # gripper's yaw by item and skill: a retry turns it

    def joints(self) -> FloatArray:
        """Return where the joints (7,) are."""
        where = self.where()
        if where is None:
            return self._joints
        motion, done_s = where
        return motion.path.at(done_s) if isinstance(motion, RobotMotion) else self._joints

    def velocity(self) -> FloatArray | None:
        """Return the joints' velocities (7,) at full speed; None where the robot stands or dwells."""
        where = self.where()
        if where is None or not isinstance(where[0], RobotMotion):
            return None
        velocity = where[0].path.velocity(where[1] + TICK_S)  # where it will be, so that a start does not go unseen
        return velocity if velocity.any() else None

    def plan(self, skill: Skill, execution: Execution) -> Step:
        """Return how the robot does a skill, see `SteppedExecutor`."""
        if skill.kind == GO_TO:
            pose = self._cell.robot.pose(skill.pose)
            motion = self._planner.go_to(self._joints, np.array(pose.joints)) if pose else None
            if motion is None:
                raise CannotError(f"no way to the pose {skill.pose!r} is free of collisions")
            return Step(skill, motion, path_length=self._planner.length_m(motion))
        held_item = self._stock.held_by(self._agent)
        if skill.kind == PICK and held_item is not None:
            return self._keep_held(skill, held_item.box.name, held_item.group)
        if skill.kind != PICK and held_item is None:
            raise CannotError("there is nothing in the gripper to place")
        targets = self._targets(skill, self.chosen(execution, skill))
        grip_s = self._cell.robot.grasp_s if skill.kind == PICK else self._cell.robot.release_s
        if not targets:
            raise CannotError(f"nothing is left in {(skill.objects if skill.kind == PICK else skill.slots)!r}")
        key = execution.command.item_id, skill.task, skill.kind
        motion = self._planner.handle(self._joints, targets, grip_s, self._last_yaws.get(key))
        if motion is None:
            raise CannotError(f"no way to {', '.join(target.name for target in targets[:3])} is free of collisions")
        self._last_yaws[key] = motion.yaw
        planning = self._cell.robot.planning(skill.kind)
        planning_s = self._stream.lognormal(planning.mu, planning.sigma)
        return Step(skill, motion, motion.target, motion.position, planning_s, self._planner.length_m(motion))

    def rest(self, step: Step, done_s: float) -> None:
        """Stay where a motion has come to."""
        if isinstance(step.motion, RobotMotion):
            self._joints = step.motion.path.at(done_s)

    def _keep_held(self, skill: Skill, name: str, group: str) -> Step:
        if group != skill.objects:
            raise CannotError(f"the gripper is full ({name})")
        motion = self._planner.go_to(self._joints, self._joints)
        assert motion is not None  # noqa: S101 - there is always a way to where one is
        return Step(skill, motion)

    def _targets(self, skill: Skill, chosen: str) -> list[Target]:
        if skill.kind == PICK:
            candidates = [
                Target(item.box.name, item.position) for item in self._stock.available(skill.objects, self._agent)
            ]
        else:
            candidates = [Target(slot.name, slot.position) for slot in self._stock.free_slots(skill.slots, self._agent)]
        return [target for target in candidates if target.name == chosen] or candidates


class HumanExecutor(SteppedExecutor):
    """The human: walks, reaches, hesitates; now and then waits for the robot to get out of the way.

    Args:
        robot_tip: where the robot's gripper is, m.
        shared: with the robot.
        stream: random numbers of the human.
    """

    pause_cause = Cause.DEPENDENCY

    def __init__(self, robot_tip: Callable[[], FloatArray], shared: Shared, stream: Stream) -> None:
        super().__init__(shared.cell.human.agent, shared, stream)
        self._model = shared.cell.human
        self._robot_tip = robot_tip
        self._joints: FloatArray = standing(self._model.home)
        self._person = stream.lognormal(0.0, self._model.person_sigma)
        self._patience_left = 0
        self._idle_ticks = 0
        self._way_home: tuple[HumanMotion, float] | None = None

    def joints(self) -> FloatArray:
        """Return where the joints (13,) are."""
        where = self._way_home or self.where()
        if where is None:
            return self._joints
        motion, done_s = where
        return motion.at(done_s) if isinstance(motion, HumanMotion) else self._joints

    @property
    def at_home(self) -> bool:
        """Whether nothing moves and nothing is going to."""
        x, y, _ = self._model.home
        return not self.busy and math.hypot(self._joints[0] - x, self._joints[1] - y) < 1e-6

    def rate(self) -> float:
        """Return the share of full speed at which the human goes on: 0 while it lets the robot go first."""
        where = self.where()
        if where is None or not self._model.yield_m:
            return 1.0
        motion, done_s = where
        if not isinstance(motion, HumanMotion):
            return 1.0
        step = self.running.step if self.running else None
        reaching = motion.reach_at_s <= done_s < motion.reach_at_s + TICK_S
        if not reaching or step is None or step.skill.kind != PICK or self._patience_left <= 0:
            return 1.0
        near = float(np.linalg.norm(self._robot_tip() - np.asarray(step.position))) < self._model.yield_m
        self._patience_left -= near
        return 0.0 if near else 1.0

    def idle(self) -> None:
        """Advance by one tick without work. After a while the human goes home."""
        if self.running is not None or self.at_home:
            self._idle_ticks = 0
            return
        self._idle_ticks += 1
        if self._way_home is None and self._idle_ticks * TICK_S >= _IDLE_S and not self._waiting:
            self._way_home = HumanMotion([walk(self._model, self._joints, self._home_pose(), self._person)]), 0.0
        if self._way_home is not None:
            motion, done_s = self._way_home
            self._way_home = motion, done_s + TICK_S
            if done_s + TICK_S >= motion.duration_s:
                self._joints, self._way_home = motion.at(motion.duration_s), None

    def plan(self, skill: Skill, execution: Execution) -> Step:
        """Return how the human does a skill, see `SteppedExecutor`."""
        if self._way_home is not None:
            self._joints, self._way_home = self.joints(), None
        pace = self._person * self._stream.lognormal(0.0, self._model.repetition_sigma)
        hesitates = self._stream.uniform() < self._model.hesitation_probability
        pause_s = self._stream.lognormal(self._model.hesitation.mu, self._model.hesitation.sigma)
        chance = self._stream.uniform()
        self._patience_left = round(self._model.patience_s / TICK_S)
        if skill.kind == GO_TO:
            return Step(skill, HumanMotion([walk(self._model, self._joints, self._home_pose(), pace)]))
        picks = skill.kind == PICK
        if picks == (self._stock.held_by(self._agent) is not None):
            raise CannotError("the hand is full" if picks else "there is nothing in the hand to place")
        group = skill.objects if picks else skill.slots
        if picks:
            candidates = [(item.box.name, item.position) for item in self._stock.available(group, self._agent)]
        else:
            candidates = [(slot.name, slot.position) for slot in self._stock.free_slots(group, self._agent)]
        if not candidates:
            raise CannotError(f"nothing is left in {group!r}")
        chosen = self.chosen(execution, skill)
        name, position = next(
            (candidate for candidate in candidates if candidate[0] == chosen), self._choose_near(candidates, chance)
        )
        grip_s = self._model.grasp_s if picks else self._model.release_s
        motion = handle(
            self._model,
            self._joints,
            position,
            self._cell.stand[group],
            pace,
            grip_s,
            pause_s if picks and hesitates else 0.0,
        )
        return Step(skill, motion, name, position)

    def rest(self, step: Step, done_s: float) -> None:
        """Stay where a motion has come to."""
        if isinstance(step.motion, HumanMotion):
            self._joints = step.motion.at(done_s)

    def _choose_near(self, candidates: list[tuple[str, Point]], chance: float) -> tuple[str, Point]:
        """Return one of the nearest candidates: people take something close by, not exactly the nearest object."""
        x, y = self._joints[:2].tolist()
        nearest = sorted(
            candidates, key=lambda candidate: (math.hypot(candidate[1][0] - x, candidate[1][1] - y), candidate[0])
        )
        return nearest[int(chance * min(len(nearest), self._model.choice))]

    def _home_pose(self) -> tuple[float, float, float]:
        x, y, yaw = self._model.home
        yaw_now = float(self._joints[2])
        return x, y, yaw_now + math.remainder(yaw - yaw_now, 2 * math.pi)
