"""The arm on the rail: forward and inverse kinematics, and velocities."""

from __future__ import annotations

import math

import numpy as np
import pytest
from bullet_body import bullet_body
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hrclog.arrays import FloatArray
from hrclog.sim.cell.robot_kinematics import JOINT_NAMES, RailArm, top_down
from hrclog.sim.models import ROBOT_URDF

ARM = RailArm()
TURNED = RailArm(rail_y=0.4, base_z=0.8, yaw=0.7, tip_m=0.2)

joints = st.tuples(*(st.floats(low, high) for low, high in zip(ARM.lower, ARM.upper, strict=True))).map(np.array)
arms = st.sampled_from([ARM, TURNED])


def denavit_hartenberg(theta: float, a: float, d: float, alpha: float) -> FloatArray:
    """Return Rz(theta) Tz(d) Tx(a) Rx(alpha), as the textbook has it."""
    c, s, ca, sa = math.cos(theta), math.sin(theta), math.cos(alpha), math.sin(alpha)
    return np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]])


def textbook_frames(arm: RailArm, q: FloatArray) -> list[FloatArray]:
    """Return the frames along the arm from the UR5's table, which is written out here a second time."""
    quarter = math.pi / 2
    table = [
        (0.0, 0.089159, quarter),
        (-0.425, 0.0, 0.0),
        (-0.39225, 0.0, 0.0),
        (0.0, 0.10915, quarter),
        (0.0, 0.09465, -quarter),
        (0.0, 0.0823, 0.0),
    ]
    carriage = denavit_hartenberg(arm.yaw, 0.0, 0.0, 0.0)
    carriage[:3, 3] = q[0], arm.rail_y, arm.base_z
    frames = [carriage]
    for theta, (a, d, alpha) in zip(q[1:], table, strict=True):
        frames.append(frames[-1] @ denavit_hartenberg(theta, a, d, alpha))
    return [*frames, frames[-1] @ denavit_hartenberg(0.0, 0.0, arm.tip_m, 0.0)]


def random_joints(count: int) -> FloatArray:
    """Return joint positions within the limits, shape (count, 7)."""
    return np.random.default_rng(7).uniform(ARM.lower, ARM.upper, (count, 7))


@given(arms, joints)
def test_frames_are_the_textbook_product(arm: RailArm, q: FloatArray) -> None:
    np.testing.assert_allclose(arm.frames(q), textbook_frames(arm, q), atol=1e-12)


@given(arms, joints)
def test_the_tip_of_one_position_is_the_last_frame(arm: RailArm, q: FloatArray) -> None:
    np.testing.assert_allclose(arm.forward(q), arm.frames(q)[7], atol=1e-12)


def test_many_positions_at_once_are_each_as_alone() -> None:
    q = random_joints(24).reshape(2, 3, 4, 7)
    poses = TURNED.forward(q)
    assert poses.shape == (2, 3, 4, 4, 4)
    np.testing.assert_allclose(poses[1, 2, 3], TURNED.forward(q[1, 2, 3]), atol=1e-14)


def test_the_tip_is_where_pybullet_sees_it() -> None:
    with bullet_body(ROBOT_URDF, (0.0, ARM.rail_y, ARM.base_z)) as body:
        for q in random_joints(40):
            body.set(q)
            np.testing.assert_allclose(ARM.forward(q), body.pose(7), atol=1e-6)


@settings(max_examples=60)
@given(arms, joints)
def test_inverse_finds_the_joints_that_forward_came_from(arm: RailArm, q: FloatArray) -> None:
    assume(abs(math.sin(q[5])) > 1e-3)  # else the wrist is singular: infinitely many solutions
    assume(abs(q[3]) > 1e-3)  # else the arm is stretched: two solutions merge, and are less exact than the limits
    solutions, target = arm.inverse(arm.forward(q)[None], q[:1])
    assert (target == 0).all()
    turns = (solutions - q) / (2 * math.pi)
    away = np.abs(turns - np.round(turns))[:, 1:].max(axis=1)
    assert away.min() < 1e-6


@settings(max_examples=60)
@given(arms, st.lists(joints, min_size=1, max_size=3), st.lists(st.floats(0.0, 1.45), min_size=1, max_size=3))
def test_every_solution_reaches_its_pose_within_the_limits(
    arm: RailArm, wishes: list[FloatArray], rails: list[float]
) -> None:
    poses = arm.forward(np.array(wishes))
    solutions, target = arm.inverse(poses, np.array(rails))
    assert solutions.shape == (len(target), 7)
    assert (np.diff(target) >= 0).all()
    assert np.isin(solutions[:, 0], rails).all()
    assert ((solutions >= arm.lower) & (solutions <= arm.upper)).all()
    np.testing.assert_allclose(arm.forward(solutions), poses[target], atol=1e-6)


def test_a_pose_in_reach_has_up_to_eight_different_solutions() -> None:
    counts = []
    for q in random_joints(60):
        solutions, _ = ARM.inverse(ARM.forward(q)[None], q[:1])
        counts.append(len(solutions))
        assert len(np.unique(solutions.round(6), axis=0)) == len(solutions)
    assert max(counts) == 8


def test_a_singular_pose_is_reached_all_the_same() -> None:
    stretched = np.array([0.4, 0.3, -0.8, 0.0, 0.5, -1.2, 0.2])
    straight_wrist = np.array([0.4, 0.3, -0.8, 1.1, 0.5, 0.0, 0.0])
    for q in (stretched, straight_wrist):
        solutions, _ = ARM.inverse(ARM.forward(q)[None], q[:1])
        assert np.abs(solutions - q).max(axis=1).min() < 1e-5


def test_narrower_limits_only_drop_solutions() -> None:
    poses, rails = ARM.forward(random_joints(20)), np.linspace(0.0, 1.45, 5)
    narrow = RailArm(upper=(1.45, math.pi, 0.0, 0.0, math.pi, math.pi, math.pi))
    every, of_every = ARM.inverse(poses, rails)
    some, of_some = narrow.inverse(poses, rails)
    keep = every[:, 3] <= 0.0
    assert 0 < keep.sum() < len(every)
    np.testing.assert_array_equal(some, every[keep])
    np.testing.assert_array_equal(of_some, of_every[keep])


def test_what_is_out_of_reach_has_no_solution() -> None:
    near, far = top_down(np.array([0.7, 0.2, 1.1]), 0.0), top_down(np.array([0.7, 1.2, 1.1]), 0.0)
    solutions, target = ARM.inverse(np.stack((far, near, far)), np.array([0.3, 0.7]))
    assert len(solutions) > 0
    assert set(target.tolist()) == {1}
    nothing, of_nothing = ARM.inverse(far[None], np.array([0.7]))
    assert nothing.shape == (0, 7)
    assert of_nothing.shape == (0,)


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2])
def test_all_places_of_the_cell_can_be_reached_from_above(yaw: float) -> None:
    blue = [(x, y) for x in (0.92, 1.40, 1.88) for y in (0.05, 0.29)]
    orange = [(x, y) for x in (0.64, 1.0, 1.36) for y in (-0.69, -0.62)]
    slots = [(x, y) for x in (0.08, 0.35, 0.62) for y in (0.05, 0.29)]
    poses = np.stack([top_down(np.array([x, y, 1.05]), yaw) for x, y in (*blue, *orange, *slots)])
    _, target = ARM.inverse(poses, np.linspace(0.0, 1.45, 15))
    assert set(target.tolist()) == set(range(18))


def test_top_down_points_down_and_turns_about_the_vertical() -> None:
    pose = top_down(np.array([0.1, 0.2, 0.3]), 0.5)
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-15)
    assert np.linalg.det(pose) == pytest.approx(1.0)
    np.testing.assert_allclose(pose[:3, 2], [0.0, 0.0, -1.0])
    assert math.atan2(pose[1, 0], pose[0, 0]) == pytest.approx(0.5)
    np.testing.assert_allclose(pose[:3, 3], [0.1, 0.2, 0.3])


@settings(max_examples=40)
@given(arms, joints, st.integers(0, 2**32 - 1))
def test_velocities_are_finite_differences(arm: RailArm, q: FloatArray, seed: int) -> None:
    random = np.random.default_rng(seed)
    qd, link = random.uniform(-1.0, 1.0, 7), np.arange(8).repeat(2)
    fixed = np.append(random.uniform(-0.3, 0.3, (16, 3)), np.ones((16, 1)), axis=1)[..., None]

    def world(frames: FloatArray) -> FloatArray:
        return np.asarray((frames[link] @ fixed)[:, :3, 0])

    h = 1e-5
    expected = (world(arm.frames(q + h * qd)) - world(arm.frames(q - h * qd))) / (2 * h)
    frames = arm.frames(q)
    np.testing.assert_allclose(arm.point_velocity(frames, qd, link, world(frames)), expected, atol=1e-8)


def test_no_points_have_no_velocities() -> None:
    none = ARM.point_velocity(ARM.frames(np.zeros(7)), np.ones(7), np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    assert none.shape == (0, 3)


def test_every_joint_has_a_name_and_limits() -> None:
    assert {len(JOINT_NAMES), len(ARM.lower), len(ARM.upper), len(ARM.max_velocity), len(ARM.max_acceleration)} == {7}
