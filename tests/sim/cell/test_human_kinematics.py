"""The human's body: where its points are, and how its hands reach."""

from __future__ import annotations

import math

import numpy as np
import pytest
from bullet_body import bullet_body
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hrclog.arrays import FloatArray
from hrclog.sim.cell.human_kinematics import (
    BODY_POINTS,
    HAND_M,
    HUMAN_JOINT_NAMES,
    HUMAN_LOWER,
    HUMAN_UPPER,
    Side,
    human_points,
    reach,
)
from hrclog.sim.models import HUMAN_URDF

SIDES: tuple[Side, ...] = ("left", "right")
PLACES = {  # link of PyBullet, and the point in its frame
    "head": (4, (0.0, 0.0, 0.16)),
    "neck": (4, (0.0, 0.0, 0.0)),
    "pelvis": (2, (0.0, 0.0, 0.0)),
    "left_shoulder": (5, (0.0, 0.0, 0.0)),
    "right_shoulder": (9, (0.0, 0.0, 0.0)),
    "left_elbow": (7, (0.0, 0.0, 0.0)),
    "right_elbow": (11, (0.0, 0.0, 0.0)),
    "left_wrist": (8, (0.0, 0.0, 0.0)),
    "right_wrist": (12, (0.0, 0.0, 0.0)),
    "left_hand": (8, (0.0, 0.0, -0.12)),
    "right_hand": (12, (0.0, 0.0, -0.12)),
}

bases = st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-7.0, 7.0))
sides = st.sampled_from(SIDES)


def points(q: FloatArray) -> dict[str, FloatArray]:
    """Return the points of the body by name."""
    return dict(zip(BODY_POINTS, human_points(q), strict=True))


def joint(q: FloatArray, name: str) -> float:
    """Return a joint's position by name."""
    return float(q[HUMAN_JOINT_NAMES.index(name)])


def in_front(base: tuple[float, float, float], forward: float, left: float, height: float) -> FloatArray:
    """Return the point that somebody has before them."""
    x, y, yaw = base
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([x + c * forward - s * left, y + s * forward + c * left, height])


def test_at_zero_a_person_stands_upright_and_looks_along_x() -> None:
    expected = {
        "head": (0, 0, 1.64),
        "neck": (0, 0, 1.48),
        "pelvis": (0, 0, 0.95),
        "left_shoulder": (0, 0.2, 1.42),
        "right_shoulder": (0, -0.2, 1.42),
        "left_elbow": (0, 0.2, 1.11),
        "right_elbow": (0, -0.2, 1.11),
        "left_wrist": (0, 0.2, 0.84),
        "right_wrist": (0, -0.2, 0.84),
        "left_hand": (0, 0.2, 0.72),
        "right_hand": (0, -0.2, 0.72),
    }
    found = points(np.zeros(13))
    assert list(found) == list(BODY_POINTS)
    for name, point in expected.items():
        np.testing.assert_allclose(found[name], point, atol=1e-12, err_msg=name)


@pytest.mark.parametrize(
    ("name", "angle", "point", "place"),
    [
        ("base_yaw", math.pi / 2, "left_shoulder", (-0.2, 0.0, 1.42)),
        ("torso_bend", math.pi / 2, "neck", (0.53, 0.0, 0.95)),
        ("head_nod", math.pi / 2, "head", (0.16, 0.0, 1.48)),
        ("left_shoulder_pitch", math.pi / 2, "left_hand", (0.7, 0.2, 1.42)),
        ("left_elbow_pitch", math.pi / 2, "left_hand", (0.39, 0.2, 1.11)),
        ("right_wrist_pitch", math.pi / 2, "right_hand", (0.12, -0.2, 0.84)),
        ("right_shoulder_yaw", math.pi / 2, "right_hand", (0.0, -0.2, 0.72)),
    ],
)
def test_positive_joints_move_forward_and_up(
    name: str, angle: float, point: str, place: tuple[float, float, float]
) -> None:
    q = np.zeros(13)
    q[HUMAN_JOINT_NAMES.index(name)] = angle
    np.testing.assert_allclose(points(q)[point], place, atol=1e-12)


def test_the_points_are_where_pybullet_sees_them() -> None:
    low, high = np.array(HUMAN_LOWER), np.array(HUMAN_UPPER)
    low[:3], high[:3] = -3.0, 3.0
    with bullet_body(HUMAN_URDF) as human:
        for q in np.random.default_rng(5).uniform(low, high, (30, 13)):
            human.set(q)
            found = points(q)
            for name, (link, place) in PLACES.items():
                expected = human.pose(link) @ (*place, 1.0)
                np.testing.assert_allclose(found[name], expected[:3], atol=1e-6, err_msg=name)


@given(bases, st.floats(0.1, 1.0), st.floats(-0.6, 0.6), st.floats(0.8, 1.7), sides)
def test_a_reaching_hand_is_level_at_its_target_within_the_limits(
    base: tuple[float, float, float], forward: float, left: float, height: float, side: Side
) -> None:
    target = in_front(base, forward, left, height)
    q = reach(base, target, side)
    assume(q is not None)
    assert q is not None
    found = points(q)
    np.testing.assert_allclose(found[f"{side}_hand"], target, atol=1e-9)
    assert found[f"{side}_wrist"][2] == pytest.approx(height, abs=1e-9)
    assert np.linalg.norm(found[f"{side}_hand"] - found[f"{side}_wrist"]) == pytest.approx(HAND_M)
    assert ((q >= HUMAN_LOWER) & (q <= HUMAN_UPPER)).all()
    np.testing.assert_array_equal(q[:3], base)
    other = slice(9, 13) if side == "left" else slice(5, 9)
    assert not q[other].any()


@given(st.floats(0.1, 1.0), st.floats(-0.6, 0.6), st.floats(0.8, 1.7))
def test_the_torso_bends_only_as_far_as_the_stretched_arm_needs(forward: float, left: float, height: float) -> None:
    q = reach((0.0, 0.0, 0.0), np.array([forward, left, height]), "left")
    assume(q is not None)
    assert q is not None
    if joint(q, "torso_bend") > 0.0:
        assert joint(q, "left_elbow_pitch") < 0.01


@settings(max_examples=50)
@given(bases, st.floats(0.35, 0.5), st.floats(-0.1, 0.1), st.floats(1.0, 1.4), sides)
def test_what_lies_before_a_shoulder_is_reached_without_bending(
    base: tuple[float, float, float], forward: float, aside: float, height: float, side: Side
) -> None:
    left = aside + (0.2 if side == "left" else -0.2)
    q = reach(base, in_front(base, forward, left, height), side)
    assert q is not None
    assert joint(q, "torso_bend") == 0.0


@given(st.floats(0.1, 1.0), st.floats(-0.6, 0.6), st.floats(0.8, 1.7))
def test_left_and_right_are_mirror_images(forward: float, left: float, height: float) -> None:
    one = reach((0.0, 0.0, 0.0), np.array([forward, left, height]), "left")
    two = reach((0.0, 0.0, 0.0), np.array([forward, -left, height]), "right")
    assert (one is None) == (two is None)
    if one is not None and two is not None:
        np.testing.assert_allclose(two[9:] * [-1, 1, 1, 1], one[5:9], atol=1e-12)
        assert two[3] == one[3]


def test_bending_brings_more_into_reach_and_still_not_everything() -> None:
    base, bends = (1.0, 1.0, -math.pi / 2), []
    for distance in (0.5, 0.65, 0.8):
        q = reach(base, np.array([1.2, 1.0 - distance, 1.05]), "left")
        assert q is not None
        bends.append(joint(q, "torso_bend"))
    assert bends[0] == 0.0
    assert 0.0 < bends[1] < bends[2] <= HUMAN_UPPER[3]
    assert reach(base, np.array([1.2, 0.0, 1.05]), "left") is None
    assert reach(base, np.array([1.2, 0.5, 2.3]), "left") is None


def test_nobody_reaches_behind_the_back() -> None:
    assert reach((0.0, 0.0, 0.0), np.array([-0.4, 0.1, 1.2]), "left") is None
