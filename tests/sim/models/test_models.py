"""The URDF files: what their maker writes, what PyBullet and the viewer read from them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from bullet_body import bullet_body
from urdf_capsules import Capsule, capsules

from hrclog.sim.cell.human_kinematics import HUMAN_JOINT_NAMES
from hrclog.sim.cell.robot_kinematics import JOINT_NAMES, RailArm
from hrclog.sim.models import HUMAN_URDF, ROBOT_URDF
from hrclog.sim.models.build import human_urdf, robot_urdf

BODIES = pytest.mark.parametrize("path", [ROBOT_URDF, HUMAN_URDF], ids=["robot", "human"])


def test_the_files_are_what_their_maker_writes() -> None:
    remedy = "run python -m hrclog.sim.models.build"
    assert ROBOT_URDF.read_text(encoding="utf-8") == robot_urdf(RailArm()), remedy
    assert HUMAN_URDF.read_text(encoding="utf-8") == human_urdf(), remedy


@BODIES
def test_pybullet_loads_a_body_without_a_word(path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pybullet")
    capfd.readouterr()  # PyBullet greets
    with bullet_body(path):
        pass
    assert capfd.readouterr() == ("", "")


def test_pybullet_counts_joints_and_links_as_we_do() -> None:
    for path, expected in ((ROBOT_URDF, [*JOINT_NAMES, "tip"]), (HUMAN_URDF, list(HUMAN_JOINT_NAMES))):
        with bullet_body(path) as body:
            count = body.bullet.getNumJoints(body.body, physicsClientId=body.client)
            rows = [body.bullet.getJointInfo(body.body, joint, physicsClientId=body.client) for joint in range(count)]
        assert [row[1].decode() for row in rows] == expected


def test_the_limits_of_the_joints_are_those_of_the_arm() -> None:
    arm = RailArm()
    with bullet_body(ROBOT_URDF) as robot:
        for joint in range(7):
            info = robot.bullet.getJointInfo(robot.body, joint, physicsClientId=robot.client)
            assert info[8] == pytest.approx(arm.lower[joint])
            assert info[9] == pytest.approx(arm.upper[joint])
            assert info[11] == pytest.approx(arm.max_velocity[joint])


def test_an_arm_that_stands_elsewhere_is_the_same_file_moved_and_turned(tmp_path: Path) -> None:
    arm = RailArm(rail_y=0.5, base_z=0.7, yaw=0.9, tip_m=0.22)
    path = tmp_path / "robot.urdf"
    path.write_text(robot_urdf(arm), encoding="utf-8")
    with bullet_body(path, (0.0, arm.rail_y, arm.base_z)) as robot:
        for q in np.random.default_rng(3).uniform(arm.lower, arm.upper, (10, 7)):
            robot.set(q + np.array([0.0, arm.yaw, 0.0, 0.0, 0.0, 0.0, 0.0]))
            np.testing.assert_allclose(robot.pose(7), arm.forward(q), atol=1e-6)


def test_each_link_turns_about_its_own_z_which_is_the_axis_in_the_arms_frames() -> None:
    arm = RailArm()
    with bullet_body(ROBOT_URDF, (0.0, arm.rail_y, arm.base_z)) as robot:
        for q in np.random.default_rng(4).uniform(arm.lower, arm.upper, (10, 7)):
            robot.set(q)
            frames = arm.frames(q)
            np.testing.assert_allclose(robot.pose(0), frames[0], atol=1e-6)
            for joint in range(1, 7):
                np.testing.assert_allclose(robot.pose(joint)[:, 2:], frames[joint - 1][:, 2:], atol=1e-6)


@BODIES
def test_the_capsules_are_those_that_pybullet_has(path: Path) -> None:
    ours = capsules(path)
    with bullet_body(path) as body:
        count = body.bullet.getNumJoints(body.body, physicsClientId=body.client)
        theirs = [(link, *shape) for link in range(count) for shape in body.capsules(link)]
        names = [body.bullet.getJointInfo(body.body, link, physicsClientId=body.client)[12] for link in range(count)]
    assert [capsule.link for capsule in ours] == [row[0] for row in theirs]
    assert [capsule.link_name for capsule in ours] == [names[row[0]].decode() for row in theirs]
    for capsule, (_, radius, a, b) in zip(ours, theirs, strict=True):
        assert capsule.radius == pytest.approx(radius)
        np.testing.assert_allclose(capsule.a, a, atol=1e-6)
        np.testing.assert_allclose(capsule.b, b, atol=1e-6)


def test_capsules_lie_as_their_roll_pitch_and_yaw_say(tmp_path: Path) -> None:
    path = tmp_path / "body.urdf"
    shape = '<geometry><capsule radius="0.1" length="2"/></geometry>'
    turns = ("0.3 -0.5 1.1", "1.5707963267948966 0 0", "0 1.5707963267948966 0", "0 0 1")
    parts = "".join(f'<collision><origin xyz="1 2 3" rpy="{turn}"/>{shape}</collision>' for turn in turns)
    inertial = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    links = f'<link name="base">{inertial}</link><link name="arm">{inertial}{parts}</link>'
    joint = '<joint name="j" type="fixed"><origin xyz="0 0 0"/><parent link="base"/><child link="arm"/></joint>'
    path.write_text(f'<robot name="body">{links}{joint}</robot>', encoding="utf-8")
    found = capsules(path)
    ends = [(1, 1, 3), (0, 2, 3), (1, 2, 2)]  # roll turns z to -y, pitch to x; yaw does not move it
    signs = [(0, 2, 0), (2, 0, 0), (0, 0, 2)]
    for capsule, end, way in zip(found[1:], ends, signs, strict=True):
        low = capsule.b if way == (0, 2, 0) else capsule.a
        high = capsule.a if way == (0, 2, 0) else capsule.b
        np.testing.assert_allclose(low, end, atol=1e-12)
        np.testing.assert_allclose(high, np.add(end, way), atol=1e-12)
    with bullet_body(path) as body:
        for capsule, (_, a, b) in zip(found, body.capsules(0), strict=True):
            np.testing.assert_allclose(capsule.a, a, atol=1e-6)
            np.testing.assert_allclose(capsule.b, b, atol=1e-6)


def test_a_shape_that_is_no_capsule_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "box.urdf"
    box = '<collision><geometry><box size="1 1 1"/></geometry></collision>'
    path.write_text(f'<robot name="box"><link name="box">{box}</link></robot>', encoding="utf-8")
    with pytest.raises(ValueError, match="capsule"):
        capsules(path)


def test_the_human_is_as_large_as_a_human() -> None:
    parts = capsules(HUMAN_URDF)
    assert len(parts) == 12
    height = {"pelvis": 0.95, "torso": 0.95, "head": 0.95 + 0.53}
    tops = [top(part, height[part.link_name]) for part in parts if part.link_name in height]
    assert max(high for _, high in tops) == pytest.approx(1.77)
    assert min(low for low, _ in tops) == pytest.approx(0.0, abs=1e-9)


def top(part: Capsule, link_height: float) -> tuple[float, float]:
    """Return the lowest and the highest z of a capsule on an upright link."""
    ends = (float(part.a[2]), float(part.b[2]))
    return link_height + min(ends) - part.radius, link_height + max(ends) + part.radius


def test_the_grippers_capsule_ends_at_the_tip() -> None:
    [gripper] = [part for part in capsules(ROBOT_URDF) if part.link_name == "gripper"]
    assert gripper.link == 7
    assert max(gripper.a[2], gripper.b[2]) + gripper.radius == pytest.approx(0.0)


@BODIES
def test_the_viewer_reads_the_body(path: Path) -> None:
    import rerun.urdf

    tree = rerun.urdf.UrdfTree.from_file_path(path)
    names = [joint.name for joint in tree.joints()]
    assert set(names) == ({*JOINT_NAMES, "tip"} if path == ROBOT_URDF else set(HUMAN_JOINT_NAMES))
    turn = next(joint for joint in tree.joints() if joint.name in {"elbow", "torso_bend"})
    transform = turn.compute_transform(0.5)
    assert transform.quaternion is not None
    assert math.isclose(abs(transform.quaternion.as_arrow_array().to_pylist()[0][3]), math.cos(0.25), rel_tol=1e-6)
