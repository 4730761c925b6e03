"""How the human walks, reaches and draws back."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cells import small_cell
from hypothesis import given
from hypothesis import strategies as st

from hrclog.arrays import FloatArray
from hrclog.errors import ScenarioError
from hrclog.sim.bullet.human import (
    HumanMotion,
    Move,
    check_reach,
    hand_position,
    handle,
    progress,
    reach_pose,
    stand_pose,
    standing,
    walk,
)
from hrclog.sim.cell.description import Box, HumanModel, Slot
from hrclog.sim.cell.human_kinematics import HUMAN_LOWER, HUMAN_UPPER

CELL = small_cell()
MODEL = CELL.human
HOME = standing(MODEL.home)
THINGS: list[Box | Slot] = [*CELL.objects_of("blue"), *CELL.objects_of("white"), *CELL.slots_of("shelf")]

offsets = st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)).filter(lambda way: math.hypot(*way) > 0.1)


def reaching(thing: Box | Slot, pace: float = 1.0, pause_s: float = 0.0, model: HumanModel = MODEL) -> HumanMotion:
    """Return the motion from home that grasps a thing."""
    return handle(model, HOME, thing.position, CELL.stand[thing.group], pace, model.grasp_s, pause_s)


def samples(motion: HumanMotion, step_s: float = 0.01) -> FloatArray:
    """Return the joints along a motion, shape (n, 13)."""
    times = np.arange(0.0, motion.duration_s, step_s).tolist()
    return np.array([motion.at(time) for time in [*times, motion.duration_s]])


def test_progress_runs_from_0_to_1_without_turning_back() -> None:
    values = [progress(share) for share in np.linspace(-0.1, 1.1, 400).tolist()]
    assert values[0] == 0.0
    assert values[-1] == 1.0
    assert (np.diff(values) >= 0.0).all()
    assert progress(0.5) == pytest.approx(0.5)


@given(st.floats(0.0, 1.0))
def test_progress_is_the_same_from_both_ends(share: float) -> None:
    assert progress(share) + progress(1.0 - share) == pytest.approx(1.0)


def test_the_speed_of_progress_rises_holds_and_falls() -> None:
    speed = np.diff([progress(share) for share in np.linspace(0.0, 1.0, 1001).tolist()]) * 1000
    assert speed[0] < 0.01
    assert speed[-1] < 0.01
    assert speed.max() == pytest.approx(1.25, abs=1e-3)
    np.testing.assert_allclose(speed[250:750], 1.25, atol=1e-9)
    assert np.abs(np.diff(speed)).max() < 0.01


def test_a_motion_is_its_moves_one_after_the_other() -> None:
    first, second, third = np.zeros(13), np.ones(13), np.full(13, 3.0)
    motion = HumanMotion([Move(first, second, 1.0), Move(second, second, 0.5), Move(second, third, 2.0)])
    assert motion.duration_s == 3.5
    np.testing.assert_array_equal(motion.at(0.0), first)
    np.testing.assert_allclose(motion.at(0.5), 0.5)
    np.testing.assert_array_equal(motion.at(1.0), second)
    np.testing.assert_array_equal(motion.at(1.25), second)
    np.testing.assert_allclose(motion.at(2.5), 2.0)
    np.testing.assert_array_equal(motion.at(3.5), third)
    np.testing.assert_array_equal(motion.at(99.0), third)


def test_a_move_that_takes_no_time_is_at_its_end() -> None:
    motion = HumanMotion([Move(np.zeros(13), np.ones(13), 0.0)])
    assert motion.duration_s == 0.0
    np.testing.assert_array_equal(motion.at(0.0), np.ones(13))


@given(st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(0.0, 2.0)), offsets, st.floats(-20.0, 20.0))
def test_one_stands_at_the_offset_and_faces_the_target_by_the_least_turn(
    target: tuple[float, float, float], offset: tuple[float, float], yaw_now: float
) -> None:
    x, y, yaw = stand_pose(target, offset, yaw_now)
    assert (x, y) == pytest.approx((target[0] + offset[0], target[1] + offset[1]))
    away = math.hypot(*offset)
    facing = x + away * math.cos(yaw), y + away * math.sin(yaw)
    assert facing == pytest.approx(target[:2], abs=1e-9)
    assert abs(yaw - yaw_now) <= math.pi + 1e-9


def test_a_walk_takes_its_way_by_the_speed_of_walking_or_its_turn() -> None:
    far = walk(MODEL, HOME, (1.0, 3.15, MODEL.home[2]), 1.0)
    assert far.duration_s == pytest.approx(2.0 / MODEL.walk_speed)
    turn = walk(MODEL, HOME, (1.0, 1.15, MODEL.home[2] + math.pi), 1.0)
    assert turn.duration_s == pytest.approx(math.pi / 2.0)
    slow = walk(MODEL, HOME, (1.0, 3.15, MODEL.home[2]), 1.5)
    assert slow.duration_s == pytest.approx(1.5 * far.duration_s)
    np.testing.assert_array_equal(far.end[:3], (1.0, 3.15, MODEL.home[2]))
    assert walk(MODEL, HOME, MODEL.home, 1.0).duration_s == 0.0


@pytest.mark.parametrize("thing", THINGS, ids=lambda thing: thing.name)
def test_the_hand_is_at_the_target_when_it_grasps_and_draws_back_then(thing: Box | Slot) -> None:
    motion = reaching(thing, pause_s=0.7)
    np.testing.assert_array_equal(motion.at(0.0), HOME)
    np.testing.assert_allclose(hand_position(motion.at(motion.grip_at_s)), thing.position, atol=1e-6)
    np.testing.assert_allclose(hand_position(motion.at(motion.grip_at_s - MODEL.grasp_s)), thing.position, atol=1e-6)
    x, y = CELL.stand[thing.group]
    at = np.add(thing.position[:2], (x, y))
    for time in (motion.reach_at_s - 0.7, motion.reach_at_s, motion.grip_at_s, motion.duration_s):
        np.testing.assert_allclose(motion.at(time)[:2], at, atol=1e-9)
    standing_there = motion.at(motion.reach_at_s)
    np.testing.assert_allclose(motion.at(motion.reach_at_s - 0.7), standing_there, atol=1e-9)
    np.testing.assert_allclose(motion.at(motion.duration_s), standing_there, atol=1e-9)
    assert motion.reach_at_s < motion.grip_at_s < motion.duration_s


@pytest.mark.parametrize("thing", THINGS, ids=lambda thing: thing.name)
def test_motions_are_smooth_and_within_the_limits_of_the_joints(thing: Box | Slot) -> None:
    joints = samples(reaching(thing, pause_s=0.3))
    assert (joints >= np.array(HUMAN_LOWER) - 1e-9).all()
    assert (joints <= np.array(HUMAN_UPPER) + 1e-9).all()
    steps = np.abs(np.diff(joints, axis=0)).max(axis=0)
    assert (steps[:2] <= 1.25 * MODEL.walk_speed * 0.01 + 1e-9).all()
    assert (steps[2:] < 0.1).all(), "a joint jumps"


def test_the_pace_stretches_everything_but_the_pause() -> None:
    usual, slow, paused = (reaching(THINGS[0], pace, pause) for pace, pause in ((1.0, 0.0), (1.3, 0.0), (1.3, 2.0)))
    assert slow.duration_s == pytest.approx(1.3 * usual.duration_s)
    assert slow.grip_at_s == pytest.approx(1.3 * usual.grip_at_s)
    assert paused.duration_s == pytest.approx(slow.duration_s + 2.0)
    assert paused.reach_at_s == pytest.approx(slow.reach_at_s + 2.0)


def test_a_quicker_hand_saves_time_at_the_target_alone() -> None:
    quick = small_cell({"human.hand_speed": 2 * MODEL.hand_speed}).human
    usual, quicker = reaching(THINGS[0]), reaching(THINGS[0], model=quick)
    assert quicker.reach_at_s == usual.reach_at_s
    hand_s = usual.grip_at_s - usual.reach_at_s - MODEL.grasp_s
    assert quicker.grip_at_s - quicker.reach_at_s - MODEL.grasp_s == pytest.approx(hand_s / 2)


def test_the_other_arm_stays_as_it_is() -> None:
    held = reach_pose(standing(stand_pose(THINGS[0].position, CELL.stand["blue"], 0.0)), THINGS[0].position)
    np.testing.assert_array_equal(held[5:9], HOME[5:9])


def test_what_is_out_of_the_humans_reach_is_named() -> None:
    with pytest.raises(
        ScenarioError, match=r"the human who stands at \(1.00, 1.15\) cannot reach \(5.00, 1.00, 1.00\)"
    ):
        reach_pose(HOME, (5.0, 1.0, 1.0))
    check_reach(CELL)
    far = small_cell({"stands.1.offset": [-1.5, 0.0]})
    with pytest.raises(ScenarioError, match=r"'pick_white' by 'human': 'white_1': .* cannot reach .* change its stand"):
        check_reach(far)
    high = small_cell({"slots.1.positions": [[0.1, 1.0, 2.6]]})
    with pytest.raises(ScenarioError, match=r"'put' by 'human': 'shelf_1'"):
        check_reach(high)
