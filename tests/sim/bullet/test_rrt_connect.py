"""The way around obstacles."""

from __future__ import annotations

import random
from itertools import pairwise

import numpy as np
import pytest
from bullet_body import bullet_body
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.arrays import FloatArray
from hrclog.sim.bullet.rrt_connect import edge_free, rrt_connect, shortcut
from hrclog.sim.cell.robot_kinematics import RailArm
from hrclog.sim.models import ROBOT_URDF

START, GOAL = np.array([0.1, 0.1]), np.array([0.9, 0.1])
LOWER, UPPER = (0.0, 0.0), (1.0, 1.0)
RESOLUTION = 0.01


def length(way: list[FloatArray]) -> float:
    """Return the length of a way."""
    return float(sum(np.linalg.norm(b - a) for a, b in pairwise(way)))


def wall(q: FloatArray) -> bool:
    """Return whether a point is free of a wall that leaves a gap at the top."""
    return not (0.4 < q[0] < 0.6 and q[1] < 0.8)


def sealed(q: FloatArray) -> bool:
    """Return whether a point is free of a wall without a gap."""
    return not 0.4 < q[0] < 0.6


def around(seed: int, **options: int) -> list[FloatArray] | None:
    """Return a way around the wall."""
    source = random.Random(seed)
    return rrt_connect(START, GOAL, LOWER, UPPER, wall, source, step=0.1, resolution=RESOLUTION, **options)


@settings(max_examples=20)
@given(st.integers(0, 10**6))
def test_a_way_around_a_wall_is_free_and_within_the_limits(seed: int) -> None:
    way = around(seed)
    assert way is not None
    assert len(way) > 2
    np.testing.assert_array_equal(way[0], START)
    np.testing.assert_array_equal(way[-1], GOAL)
    assert all(edge_free(a, b, wall, RESOLUTION) for a, b in pairwise(way))
    assert all(((q >= LOWER) & (q <= UPPER)).all() for q in way)


@settings(max_examples=20)
@given(st.integers(0, 10**6))
def test_shortcuts_make_no_way_longer(seed: int) -> None:
    rough = around(seed, shortcuts=0)
    assert rough is not None
    smooth = shortcut(rough, wall, random.Random(seed), RESOLUTION, 50)
    assert length(smooth) <= length(rough) + 1e-12
    assert all(edge_free(a, b, wall, RESOLUTION) for a, b in pairwise(smooth))


def test_shortcuts_come_near_the_shortest_way() -> None:
    corners = [START, np.array([0.4, 0.8]), np.array([0.6, 0.8]), GOAL]
    lengths = [length(around(seed) or []) for seed in range(20)]
    assert float(np.median(lengths)) < 1.05 * length(corners)


def test_the_same_numbers_find_the_same_way() -> None:
    first, again, other = around(3), around(3), around(4)
    np.testing.assert_array_equal(np.array(first), np.array(again))
    assert first is not None
    assert other is not None
    assert not np.array_equal(first[1], other[1])


def test_a_free_straight_line_is_the_way_and_takes_no_random_number() -> None:
    source = random.Random(0)
    way = rrt_connect(START, GOAL, LOWER, UPPER, lambda _: True, source, resolution=RESOLUTION)
    assert way is not None
    assert len(way) == 2
    assert source.random() == random.Random(0).random()


def test_there_is_no_way_through_a_sealed_wall() -> None:
    assert rrt_connect(START, GOAL, LOWER, UPPER, sealed, random.Random(0), step=0.1, max_iterations=200) is None


@pytest.mark.parametrize("spot", [START, GOAL])
def test_there_is_no_way_from_or_to_where_the_robot_may_not_stand(spot: FloatArray) -> None:
    def free(q: FloatArray) -> bool:
        return wall(q) and not np.array_equal(q, spot)

    assert rrt_connect(START, GOAL, LOWER, UPPER, free, random.Random(0), step=0.1) is None


def test_the_search_gives_up_after_its_iterations() -> None:
    source, witness = random.Random(0), random.Random(0)
    assert rrt_connect(START, GOAL, LOWER, UPPER, sealed, source, step=0.1, max_iterations=10) is None
    for _ in range(10 * len(START)):
        witness.random()
    assert source.random() == witness.random()


def test_a_way_is_sought_between_the_limits_wherever_these_are() -> None:
    shift = np.array([-3.0, 5.0])
    source = random.Random(0)
    way = rrt_connect(
        START + shift, GOAL + shift, shift, shift + 1.0, lambda q: wall(q - shift), source, step=0.1, resolution=0.01
    )
    assert way is not None
    assert all(((q >= shift) & (q <= shift + 1.0)).all() for q in way)


def test_an_edge_is_checked_at_its_resolution_and_at_its_end() -> None:
    seen: list[float] = []

    def note(q: FloatArray) -> bool:
        seen.append(float(q[0]))
        return True

    assert edge_free(np.array([0.0, 0.0]), np.array([1.0, 0.1]), note, 0.25)
    assert seen == [0.25, 0.5, 0.75, 1.0]
    assert edge_free(START, START, note, 0.25)
    assert not edge_free(START, np.array([0.5, 0.1]), wall, 10.0)


def test_the_arm_finds_a_way_around_a_post() -> None:
    arm = RailArm()
    start = np.array([0.7, -1.2, -0.9, 1.4, -2.0, -1.57, 0.0])
    goal = np.array([0.7, 1.2, -0.9, 1.4, -2.0, -1.57, 0.0])
    with bullet_body(ROBOT_URDF, (0.0, arm.rail_y, arm.base_z)) as robot:
        bullet, client = robot.bullet, robot.client
        middle = arm.forward((start + goal) / 2)[:3, 3]
        shape = bullet.createCollisionShape(bullet.GEOM_BOX, halfExtents=[0.05, 0.05, 0.3], physicsClientId=client)
        post = bullet.createMultiBody(0, shape, -1, middle.tolist(), physicsClientId=client)

        def free(q: FloatArray) -> bool:
            robot.set(q)
            return not bullet.getClosestPoints(robot.body, post, 0.01, physicsClientId=client)

        assert free(start)
        assert free(goal)
        assert not edge_free(start, goal, free, 0.05)
        way = rrt_connect(start, goal, arm.lower, arm.upper, free, random.Random(1))
        assert way is not None
        assert all(edge_free(a, b, free, 0.05) for a, b in pairwise(way))
        assert all(((q >= arm.lower) & (q <= arm.upper)).all() for q in way)
