"""The robot's planner: the target that is soonest reached, ways that are free, and around what is not."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from cells import cell_json, parsed, small_cell
from segment_distance import Body, box_distances

from hrclog.arrays import FloatArray
from hrclog.errors import ScenarioError
from hrclog.sim.bullet.robot import RobotMotion, RobotPlanner, Target, check_reach, make_arm
from hrclog.sim.bullet.world import World, robot_urdf
from hrclog.sim.cell.description import Box, Cell, Slot
from hrclog.sim.cell.robot_kinematics import JOINT_NAMES, top_down
from hrclog.sim.stream import Stream

Planners = Callable[..., RobotPlanner]

GRIP_S = 0.3
CELL = small_cell()
ARM = make_arm(CELL.robot)
HOME = np.array(CELL.robot.home.joints)
THINGS: list[Box | Slot] = [*CELL.objects[:5], *CELL.slots_of("bin")]
TARGETS = [Target(thing.name, thing.position) for thing in THINGS]

WALL = {"name": "wall", "size": [0.04, 0.5, 0.6], "position": [0.75, 0.1, 1.3], "color": [9, 9, 9]}
"""Between the slots on the left of the shared table and the blue objects on its right."""


@pytest.fixture(scope="module")
def worlds() -> Iterator[Callable[[Cell], World]]:
    """Return what makes the world of a cell, once."""
    pytest.importorskip("pybullet")
    made: list[tuple[Cell, World]] = []

    def of(cell: Cell) -> World:
        for known, world in made:
            if known == cell:
                return world
        made.append((cell, World(cell)))
        return made[-1][1]

    yield of
    for _, world in made:
        world.close()


@pytest.fixture
def planners(worlds: Callable[[Cell], World]) -> Planners:
    """Return a maker of planners with chances of their own."""

    def make(cell: Cell = CELL) -> RobotPlanner:
        return RobotPlanner(cell.robot, make_arm(cell.robot), worlds(cell).free, Stream(1, "paths"))

    return make


@pytest.fixture
def planner(planners: Planners) -> RobotPlanner:
    """Return the planner of the small cell."""
    return planners()


def samples(motion: RobotMotion) -> FloatArray:
    """Return the joints along a motion, 10 ms apart, shape (n, 7)."""
    count = math.ceil(motion.duration_s * 100) + 1
    return np.array([motion.path.at(time) for time in np.linspace(0.0, motion.duration_s, count).tolist()])


def found(motion: RobotMotion | None) -> RobotMotion:
    """Return a motion, which must be there."""
    assert motion is not None
    return motion


def grasp(motion: RobotMotion) -> FloatArray:
    """Return the pose of the tip when the gripper has closed or opened, shape (4, 4)."""
    return ARM.forward(motion.path.at(motion.grip_at_s))


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_the_gripper_closes_at_the_target_from_above_and_rises_again(planner: RobotPlanner, target: Target) -> None:
    motion = found(planner.handle(HOME, [target], GRIP_S))
    assert (motion.target, motion.position) == (target.name, target.position)
    np.testing.assert_array_equal(motion.path.at(0.0), HOME)
    tips = ARM.forward(samples(motion))
    pose = grasp(motion)
    np.testing.assert_allclose(pose[:3, 3], target.position, atol=1e-6)
    np.testing.assert_allclose(pose[:3, 2], (0.0, 0.0, -1.0), atol=1e-6)
    above = np.add(target.position, (0.0, 0.0, CELL.robot.approach_m))
    np.testing.assert_allclose(tips[-1][:3, 3], above, atol=1e-6)
    still = motion.path.at(motion.grip_at_s - GRIP_S)
    np.testing.assert_allclose(still, motion.path.at(motion.grip_at_s), atol=1e-9)
    assert 0.0 < motion.grip_at_s < motion.duration_s


def test_the_gripper_takes_the_time_it_is_given(planner: RobotPlanner) -> None:
    quick, slow = (found(planner.handle(HOME, TARGETS[:1], grip_s)) for grip_s in (0.0, 1.5))
    assert slow.duration_s - quick.duration_s == pytest.approx(1.5)
    assert slow.grip_at_s - quick.grip_at_s == pytest.approx(1.5)


def test_the_target_that_is_soonest_reached_is_chosen(planner: RobotPlanner) -> None:
    alone = {target.name: found(planner.handle(HOME, [target], GRIP_S)).duration_s for target in TARGETS}
    best = found(planner.handle(HOME, TARGETS, GRIP_S))
    again = found(planner.handle(HOME, TARGETS[::-1], GRIP_S))
    assert best.duration_s == pytest.approx(again.duration_s)
    assert best.duration_s <= alone[best.target] + 1e-9
    # ways down to the targets differ by less than this
    assert alone[best.target] <= min(alone.values()) + 0.25


def test_the_same_question_has_the_same_answer(planners: Planners) -> None:
    one, other = (found(planners().handle(HOME, TARGETS, GRIP_S)) for _ in range(2))
    np.testing.assert_array_equal(samples(one), samples(other))


def test_nothing_to_go_to_is_no_way(planner: RobotPlanner) -> None:
    assert planner.handle(HOME, [], GRIP_S) is None


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_each_retry_turns_the_gripper_a_quarter(planner: RobotPlanner, target: Target) -> None:
    motions = [found(planner.handle(HOME, [target], GRIP_S))]
    for _ in range(3):
        motions.append(found(planner.handle(HOME, [target], GRIP_S, motions[-1].yaw)))
    ways = [grasp(motion)[:3, 0] for motion in motions]
    for before, after in pairwise(ways):
        assert abs(before @ after) < 1e-6


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_motions_keep_the_limits_of_joints_and_speeds(planner: RobotPlanner, target: Target) -> None:
    motion = found(planner.handle(HOME, [target], GRIP_S))
    joints = samples(motion)
    assert (joints >= np.array(ARM.lower) - 1e-9).all()
    assert (joints <= np.array(ARM.upper) + 1e-9).all()
    times = np.linspace(0.0, motion.duration_s, 400).tolist()
    speeds = np.array([motion.path.velocity(time) for time in times])
    assert (np.abs(speeds) <= np.array(ARM.max_velocity) * CELL.robot.speed + 1e-9).all()
    near = np.array([speed for time, speed in zip(times, speeds, strict=True) if time > motion.grip_at_s])
    assert (np.abs(near) <= np.array(ARM.max_velocity) * CELL.robot.speed * CELL.robot.approach + 1e-9).all()


def test_half_the_speed_takes_longer(planners: Planners) -> None:
    slow = small_cell({"robot.speed": CELL.robot.speed / 2, "robot.acceleration": CELL.robot.acceleration / 4})
    usual, slower = (found(planners(cell).handle(HOME, TARGETS[:1], 0.0)) for cell in (CELL, slow))
    assert slower.duration_s == pytest.approx(2 * usual.duration_s, rel=0.01)


def test_where_one_is_one_need_not_go(planner: RobotPlanner) -> None:
    motion = found(planner.go_to(HOME, HOME))
    assert motion.duration_s == 0.0
    assert planner.length_m(motion) == 0.0
    assert motion.grip_at_s == math.inf


def test_a_straight_way_is_taken_where_it_is_free(planner: RobotPlanner) -> None:
    aside = np.array([0.0, *HOME[1:]])
    motion = found(planner.go_to(HOME, aside))
    np.testing.assert_array_equal(motion.path.end, aside)
    assert len(motion.path.parts) == 1
    assert planner.length_m(motion) == pytest.approx(0.6)


def walled(**changes: Any) -> Cell:  # noqa: ANN401 - JSON values
    """Return the small cell with a wall across the shared table."""
    value = cell_json()
    value["fixtures"].append({**WALL, **changes})
    return parsed(value)


LEFT, RIGHT = (np.array([rail, -math.pi / 2, -1.57, 1.57, -1.57, -1.57, 0.0]) for rail in (0.1, 1.4))
"""The arm over the shared table, the same on both sides of the wall."""


def test_a_wall_in_the_straight_way_is_gone_around(planners: Planners) -> None:
    cell = walled()
    planner = planners(cell)
    assert found(planners(CELL).go_to(LEFT, RIGHT)).path.parts[1:] == ()
    motion = found(planner.go_to(LEFT, RIGHT))
    assert len(motion.path.parts) > 1
    np.testing.assert_allclose(motion.path.end, RIGHT)
    wall = next(box for box in cell.fixtures if box.name == "wall")
    body = Body(robot_urdf(cell.robot))
    assert body.joint_names == JOINT_NAMES
    away = box_distances(body, samples(motion), wall.size, wall.position)
    assert away.min() > 0.0
    straight = LEFT + np.linspace(0.0, 1.0, 50)[:, None] * (RIGHT - LEFT)
    assert box_distances(body, straight, wall.size, wall.position).min() < 0.0


def test_a_target_behind_a_wall_is_reached_around_it_where_no_straight_way_is_free(planners: Planners) -> None:
    planner = planners(walled())
    target = next(target for target in TARGETS if target.name == "blue_1")
    motion = found(planner.handle(LEFT, [target], GRIP_S))
    straight_parts = len(found(planners(CELL).handle(LEFT, [target], GRIP_S)).path.parts)
    assert len(motion.path.parts) > straight_parts
    np.testing.assert_allclose(grasp(motion)[:3, 3], target.position, atol=1e-6)


def test_the_way_around_is_the_same_for_the_same_chances(planners: Planners) -> None:
    ways = []
    for _ in range(2):
        planner = planners(walled())
        ways.append(samples(found(planner.go_to(LEFT, RIGHT))))
    np.testing.assert_array_equal(ways[0], ways[1])


def test_a_pose_inside_a_fixture_has_no_way_to_it(planners: Planners) -> None:
    planner = planners(CELL)
    down, _ = ARM.inverse(top_down(np.array([0.92, 0.05, 0.97]), 0.0)[None], np.array([0.6]))
    assert not any(planner._free(joints) for joints in down)
    assert planner.go_to(HOME, down[0]) is None


def test_what_is_out_of_reach_is_named(planners: Planners) -> None:
    check_reach(CELL, planners(CELL))
    far = small_cell({"objects.0.positions": [[0.7, -0.65, 1.03], [0.7, -3.0, 1.03]]})
    with pytest.raises(
        ScenarioError, match=r"'pick_red' by 'robot': 'red_2' at \(0.70, -3.00, 1.03\) is out of the rob"
    ):
        check_reach(far, planners(far))
    high = small_cell({"slots.0.positions": [[0.1, 0.1, 3.0]]})
    with pytest.raises(ScenarioError, match=r"'put' by 'robot': 'bin_1' at .* move it"):
        check_reach(high, planners(high))


def test_a_target_inside_a_fixture_is_named(planners: Planners) -> None:
    cell = walled(position=[0.94, -0.65, 1.2])
    with pytest.raises(ScenarioError, match=r"'red_2' .* a fixture is in the way"):
        check_reach(cell, planners(cell))


def test_only_what_the_robot_shall_reach_must_be_in_its_reach(planners: Planners) -> None:
    far = small_cell({"objects.2.positions": [[0.7, 9.0, 1.03]]})
    check_reach(far, planners(far))
