"""The cell in PyBullet against distances worked out in numpy."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import pytest
from cells import small_cell
from segment_distance import Body, box_distances, capsule_distances, least_distances, own_distances, segment_distances

from hrclog.arrays import FloatArray
from hrclog.errors import ScenarioError
from hrclog.sim.bullet import world as world_module
from hrclog.sim.bullet.robot import make_arm
from hrclog.sim.bullet.world import FAR_M, World, load_pybullet, robot_urdf
from hrclog.sim.cell.human_kinematics import HUMAN_LOWER, HUMAN_UPPER
from hrclog.sim.models import HUMAN_URDF

CELL = small_cell()
ARM = make_arm(CELL.robot)
ROBOT = Body(robot_urdf(CELL.robot))
HUMAN = Body(HUMAN_URDF.read_text(encoding="utf-8"))
CLEAR_M = 0.005
"""What a free path keeps from the fixtures."""


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    """Return the small cell's world."""
    pytest.importorskip("pybullet")
    made = World(CELL)
    yield made
    made.close()


def robots(count: int, seed: int = 3) -> FloatArray:
    """Return joints of the robot within the limits, shape (count, 7)."""
    return np.random.default_rng(seed).uniform(ARM.lower, ARM.upper, (count, 7))


def humans(count: int) -> FloatArray:
    """Return joints of humans who stand in the cell, shape (count, 13)."""
    low, high = np.array(HUMAN_LOWER), np.array(HUMAN_UPPER)
    low[:3], high[:3] = (-0.5, -1.0, -3.2), (2.5, 2.0, 3.2)
    return np.random.default_rng(4).uniform(low, high, (count, 13))


def test_the_oracle_knows_distances_that_anybody_knows() -> None:
    a0, a1 = np.array([0.0, 0.0, 0.0]), np.array([2.0, 0.0, 0.0])
    cases = {
        ((1.0, -1.0, 3.0), (1.0, 1.0, 3.0)): 3.0,  # across, above
        ((1.0, -1.0, 0.0), (1.0, 1.0, 0.0)): 0.0,  # through
        ((0.0, 4.0, 0.0), (2.0, 4.0, 0.0)): 4.0,  # beside
        ((5.0, 4.0, 0.0), (9.0, 4.0, 0.0)): 5.0,  # end to end
        ((1.0, 2.0, 0.0), (1.0, 5.0, 0.0)): 2.0,  # end to side
        ((3.0, 0.0, 0.0), (7.0, 0.0, 0.0)): 1.0,  # in line
        ((2.0, 0.0, 1.0), (2.0, 0.0, 1.0)): 1.0,  # a point
    }
    for (b0, b1), away in cases.items():
        assert segment_distances(a0, a1, np.array(b0), np.array(b1)) == pytest.approx(away)
        assert segment_distances(np.array(b1), np.array(b0), a0, a1) == pytest.approx(away)


def test_the_oracle_stands_where_the_kinematics_do() -> None:
    for joints in robots(5):
        frames = ROBOT.frames(joints[None])
        np.testing.assert_allclose(frames["gripper"][0], ARM.forward(joints), atol=1e-9)


def test_the_quick_oracle_finds_the_least_of_all_distances() -> None:
    robot, human = robots(200), humans(200)
    every = capsule_distances(ROBOT, robot, HUMAN, human)
    np.testing.assert_allclose(least_distances(ROBOT, robot, HUMAN, human), every.min(axis=(1, 2)), atol=1e-12)


def test_every_distance_is_that_of_the_oracle(world: World) -> None:
    robot, human = robots(40), humans(40)
    ours = capsule_distances(ROBOT, robot, HUMAN, human)
    # one capsule a link, in the order in which PyBullet counts them
    assert ROBOT.links == ["carriage", "shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3", "gripper"]
    for number in range(40):
        world.set_robot(robot[number])
        world.set_human(human[number])
        found = world.separation()
        assert found.least_m == pytest.approx(ours[number].min(), abs=1e-6)
        for link in range(8):
            own = found.distances[found.robot_links == link]
            # deep inside each other, capsules are pushed apart another way than their segments
            if ours[number, link].min() > 0.0:
                assert own.min() == pytest.approx(ours[number, link].min(), abs=1e-6)
        np.testing.assert_allclose(
            np.linalg.norm(found.on_robot - found.on_human, axis=1), np.abs(found.distances), atol=1e-6
        )


def test_only_what_is_near_enough_is_looked_at(world: World) -> None:
    world.set_robot(np.array(CELL.robot.home.joints))
    human = np.zeros(13)
    human[:2] = 1.0, 2.0
    world.set_human(human)
    every = world.separation()
    near = world.separation(every.least_m + 0.05)
    assert 0 < len(near.distances) < len(every.distances)
    assert near.least_m == every.least_m
    nothing = world.separation(every.least_m - 0.05)
    assert (len(nothing.distances), nothing.least_m) == (0, FAR_M)
    assert nothing.on_robot.shape == nothing.on_human.shape == (0, 3)


def touching(joints: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how near the robot is to the fixtures and to itself, shapes (n,)."""
    fixtures = np.array([box_distances(ROBOT, joints, box.size, box.position).min(axis=1) for box in CELL.fixtures])
    return fixtures.min(axis=0), own_distances(ROBOT, joints)


def test_the_robot_is_free_just_where_the_oracle_says_so(world: World) -> None:
    joints = robots(300)
    fixtures, own = touching(joints)
    clear = (np.abs(fixtures - CLEAR_M) > 1e-4) & (np.abs(own) > 1e-4)
    expected = (fixtures > CLEAR_M) & (own > 0.0)
    found = np.array([world.free(one) for one in joints])
    np.testing.assert_array_equal(found[clear], expected[clear])
    assert 30 < expected[clear].sum() < 270
    assert ((own < 0.0) & (fixtures > CLEAR_M)).sum() > 5, "no example of a robot that touches itself alone"


def test_worlds_do_not_know_of_each_other(world: World) -> None:
    joints = next(one for one in robots(50) if not world.free(one))
    other = World(small_cell({"fixtures": []}))
    try:
        assert any(other.free(one) and not world.free(one) for one in robots(50))
        before = world.separation().least_m
        other.set_robot(joints)
        assert world.separation().least_m == before
    finally:
        other.close()


def test_the_description_in_the_log_stands_where_the_cell_has_it() -> None:
    moved = small_cell({"robot.rail_y": -0.5, "robot.base_z": 0.7})
    body = Body(robot_urdf(moved.robot))
    joints = robots(3)
    np.testing.assert_allclose(body.frames(joints)["gripper"], make_arm(moved.robot).forward(joints), atol=1e-9)


def test_pybullet_is_loaded_without_a_word() -> None:
    pytest.importorskip("pybullet")
    code = "from hrclog.sim.bullet.world import load_pybullet, silent; load_pybullet(); print('ours')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("ours\n", "")


def test_without_pybullet_one_is_told_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pybullet", None)
    with pytest.raises(
        ScenarioError, match=r"'bullet' needs PyBullet, .* pip install 'hrclog\[sim\]', .* --engine events"
    ):
        load_pybullet()


def test_the_rest_of_the_simulator_does_without_pybullet() -> None:
    code = (
        "import sys; sys.modules['pybullet'] = None\n"
        "from hrclog.sim.run import simulate_run; from hrclog.sim.scenario import load_scenario\n"
        "print(simulate_run(load_scenario('paper'), 1, 0).events[-1].outcome)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "succeeded\n"


def test_the_models_are_files_of_the_package() -> None:
    assert world_module.ROBOT_URDF.is_file()
    assert world_module.HUMAN_URDF.is_file()
