"""The trapezoidal time law, and paths made of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from hrclog.arrays import FloatArray
from hrclog.sim.bullet.motion import Dwell, Path, path_through, trapezoid
from hrclog.sim.cell.robot_kinematics import RailArm

ARM = RailArm()
VELOCITY, ACCELERATION = np.array(ARM.max_velocity), np.array(ARM.max_acceleration)

joints = st.tuples(*(st.floats(low, high) for low, high in zip(ARM.lower, ARM.upper, strict=True))).map(np.array)
shares = st.floats(0.0, 1.0)
STEP = 1e-4


def one(travel: float, velocity: float = 1.0, acceleration: float = 2.0) -> float:
    """Return how long one joint takes."""
    return trapezoid(np.zeros(1), np.array([travel]), (velocity,), (acceleration,)).duration_s


def test_durations_are_those_of_the_textbook() -> None:
    assert one(1.0) == pytest.approx(1.0 / 1.0 + 1.0 / 2.0)  # cruises
    assert one(-1.0) == one(1.0)
    assert one(0.1) == pytest.approx(2 * math.sqrt(0.1 / 2.0))  # never gets to the greatest speed
    assert one(0.5) == pytest.approx(1.0)  # just gets there
    assert one(0.0) == 0.0


def test_the_slowest_joint_sets_the_duration() -> None:
    start, end = np.zeros(2), np.array([0.5, 3.0])
    assert trapezoid(start, end, (1.0, 1.0), (2.0, 2.0)).duration_s == pytest.approx(one(3.0))


@given(joints, joints)
def test_a_motion_begins_and_ends_exactly_and_at_rest(start: FloatArray, end: FloatArray) -> None:
    segment = trapezoid(start, end, ARM.max_velocity, ARM.max_acceleration)
    assume(segment.duration_s > 0.0)
    for early, late in ((0.0, segment.duration_s), (-1.0, segment.duration_s + 1.0)):
        np.testing.assert_array_equal(segment.at(late), end)
        np.testing.assert_array_equal(segment.at(early), start)
        assert not segment.velocity(early).any()
        assert not segment.velocity(late).any()


@pytest.mark.parametrize("travel", [0.0, 1e-310, 1e-14])
def test_a_move_of_nothing_takes_no_time(travel: float) -> None:
    segment = trapezoid(np.zeros(7), np.full(7, travel), ARM.max_velocity, ARM.max_acceleration)
    assert segment.duration_s == 0.0
    np.testing.assert_array_equal(segment.at(0.0), np.full(7, travel))
    assert not segment.velocity(0.0).any()


@given(joints, joints, shares)
def test_no_joint_is_faster_or_speeds_up_faster_than_it_may(start: FloatArray, end: FloatArray, share: float) -> None:
    segment = trapezoid(start, end, ARM.max_velocity, ARM.max_acceleration)
    t = share * segment.duration_s
    assert (np.abs(segment.velocity(t)) <= VELOCITY * (1 + 1e-9)).all()
    gain = np.abs(segment.velocity(t + STEP) - segment.velocity(t))
    assert (gain <= ACCELERATION * STEP * (1 + 1e-9) + 1e-12).all()


@given(joints, joints)
def test_a_joint_is_as_fast_or_speeds_up_as_fast_as_it_may(start: FloatArray, end: FloatArray) -> None:
    segment = trapezoid(start, end, ARM.max_velocity, ARM.max_acceleration)
    assume(segment.duration_s > 0.1)
    assert np.max(np.abs(segment.velocity(STEP)) / (ACCELERATION * STEP)) == pytest.approx(1.0)
    cruises = segment.duration_s > 2 * segment.ramp_s
    top = np.max(np.abs(segment.velocity(segment.duration_s / 2)) / VELOCITY)
    assert top == pytest.approx(1.0) if cruises else top <= 1.0 + 1e-9


@given(joints, joints, shares)
def test_the_second_half_mirrors_the_first(start: FloatArray, end: FloatArray, share: float) -> None:
    segment = trapezoid(start, end, ARM.max_velocity, ARM.max_acceleration)
    t = share * segment.duration_s
    np.testing.assert_allclose(segment.at(t) - start, end - segment.at(segment.duration_s - t), atol=1e-9)


@given(joints, joints, shares)
def test_velocity_is_the_change_of_position(start: FloatArray, end: FloatArray, share: float) -> None:
    segment = trapezoid(start, end, ARM.max_velocity, ARM.max_acceleration)
    t = share * segment.duration_s
    change = (segment.at(t + STEP) - segment.at(t - STEP)) / (2 * STEP)
    np.testing.assert_allclose(change, segment.velocity(t), atol=float(ACCELERATION.max()) * STEP)


@given(st.lists(joints, min_size=1, max_size=4))
def test_a_path_rests_at_every_waypoint_in_turn(waypoints: list[FloatArray]) -> None:
    path = path_through(waypoints, ARM.max_velocity, ARM.max_acceleration)
    np.testing.assert_array_equal(path.start, waypoints[0])
    np.testing.assert_array_equal(path.end, waypoints[-1])
    time = 0.0
    for part, waypoint in zip(path.parts, waypoints[1:], strict=False):
        time += part.duration_s
        np.testing.assert_allclose(path.at(time), waypoint, atol=1e-12)
        np.testing.assert_allclose(path.velocity(time), 0.0, atol=1e-12)
    assert path.duration_s == pytest.approx(time)


@given(st.lists(joints, min_size=2, max_size=4), shares)
def test_a_path_has_no_jumps(waypoints: list[FloatArray], share: float) -> None:
    path = path_through(waypoints, ARM.max_velocity, ARM.max_acceleration)
    t = share * path.duration_s
    assert (np.abs(path.at(t + STEP) - path.at(t)) <= VELOCITY * STEP * (1 + 1e-6) + 1e-9).all()


def test_a_dwell_holds_a_path_up() -> None:
    here, there = np.zeros(7), np.array([0.5, 0, 0, 0, 0, 0, 0])
    go = trapezoid(here, there, ARM.max_velocity, ARM.max_acceleration)
    back = trapezoid(there, here, ARM.max_velocity, ARM.max_acceleration)
    path = Path([go, Dwell(there, 2.0), back])
    assert path.duration_s == pytest.approx(4.0)
    np.testing.assert_array_equal(path.at(2.9), there)
    assert not path.velocity(2.9).any()
    np.testing.assert_array_equal(path.at(-1.0), here)
    np.testing.assert_array_equal(path.at(9.0), here)
    assert path.velocity(0.5)[0] == pytest.approx(1.0)
    assert path.velocity(3.5)[0] == pytest.approx(-1.0)
    assert path.at(3.5)[0] == pytest.approx(0.25)


def test_the_length_is_the_way_of_the_tip() -> None:
    bent = np.array([0.0, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0])
    along, around = bent.copy(), bent.copy()
    along[0], around[1] = 1.2, 2.0
    radius = float(np.hypot(*(ARM.forward(bent)[:2, 3] - (0.0, ARM.rail_y))))
    path = path_through([bent, along, bent, around], ARM.max_velocity, ARM.max_acceleration)
    assert path.length_m(ARM) == pytest.approx(1.2 + 1.2 + 2.0 * radius, rel=1e-4)
    assert Path([Dwell(bent, 3.0)]).length_m(ARM) == 0.0


def test_a_motion_keeps_its_own_joint_positions() -> None:
    start, end = np.zeros(7), np.ones(7)
    segment = trapezoid(start, end, ARM.max_velocity, ARM.max_acceleration)
    start += 1.0
    end += 1.0
    segment.at(0.0)[:] = 9.0
    segment.at(segment.duration_s)[:] = 9.0
    np.testing.assert_array_equal(segment.at(0.0), np.zeros(7))
    np.testing.assert_array_equal(segment.at(segment.duration_s), np.ones(7))


def test_a_path_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one"):
        Path([])
