"""What the robot and the human make of their tasks."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from cells import HUMAN, ROBOT, Stage, cell_json, parsed, small_cell, with_areas

from hrclog.events import Cause, Outcome, TaskPaused, TaskResumed, TaskStarted
from hrclog.sim.bullet.human import hand_position

pytestmark = pytest.mark.slow

Stages = Callable[..., Stage]

CELL = small_cell()


@dataclass(frozen=True)
class Who:
    """An agent, its task of picking, and the groups it picks from and puts into."""

    agent: str
    pick: str
    group: str
    slots: str


BOTH = pytest.mark.parametrize(
    "who",
    [Who(ROBOT, "pick_red", "red", "bin"), Who(HUMAN, "pick_white", "white", "shelf")],
    ids=lambda who: who.agent,
)


@BOTH
def test_what_is_picked_is_held_and_what_is_put_down_stands_in_its_slot(stage: Stages, who: Who) -> None:
    on = stage(CELL)
    picked = on.do(who.agent, who.pick)
    assert picked.outcome == Outcome.SUCCEEDED
    assert picked.target.startswith(f"{who.group}_")
    assert on.held(who.agent) == picked.target
    put = on.do(who.agent, "put")
    assert put.outcome == Outcome.SUCCEEDED
    assert put.target.startswith(f"{who.slots}_")
    assert on.held(who.agent) == ""
    item = on.cell._stock.items[picked.target]
    assert on.placed() == {picked.target: put.target}
    assert item.position == next(slot.position for slot in CELL.slots if slot.name == put.target)


@BOTH
def test_an_empty_hand_has_nothing_to_put_down(stage: Stages, who: Who) -> None:
    on = stage(CELL)
    end = on.do(who.agent, "put")
    hand = "gripper" if who.agent == ROBOT else "hand"
    assert (end.outcome, end.reason) == (Outcome.FAILED, f"there is nothing in the {hand} to place")
    assert len(on.cell._stock.free_slots(who.slots, "somebody")) == 6


@BOTH
def test_where_nothing_is_left_nothing_can_be_picked(stage: Stages, who: Who) -> None:
    on = stage(CELL)
    for _ in range(2):
        on.do(who.agent, who.pick)
        on.do(who.agent, "put")
    end = on.do(who.agent, who.pick)
    assert (end.outcome, end.reason) == (Outcome.FAILED, f"nothing is left in {who.group!r}")


@BOTH
def test_where_all_slots_are_full_nothing_can_be_put_down(stage: Stages, who: Who) -> None:
    value = cell_json()
    for entry in value["slots"]:
        del entry["positions"][1:]
    on = stage(parsed(value))
    on.do(who.agent, who.pick)
    on.do(who.agent, "put")
    on.do(who.agent, who.pick)
    end = on.do(who.agent, "put")
    assert (end.outcome, end.reason) == (Outcome.FAILED, f"nothing is left in {who.slots!r}")
    assert on.held(who.agent).startswith(f"{who.group}_")


@BOTH
def test_to_pick_and_place_is_one_execution(stage: Stages, who: Who) -> None:
    on, apart = stage(CELL), stage(CELL)
    whole = on.do(who.agent, f"carry_{who.group}")
    assert whole.outcome == Outcome.SUCCEEDED
    assert whole.target.startswith(f"{who.slots}_")
    assert on.held(who.agent) == ""
    assert [(name.split("_")[0], slot) for name, slot in on.placed().items()] == [(who.group, whole.target)]
    assert not [e for e in on.events if getattr(e, "parent_execution_id", "")]
    ends = [apart.do(who.agent, who.pick), apart.do(who.agent, "put")]
    if who.agent == ROBOT:
        assert whole.path_length == pytest.approx(sum(end.path_length or 0.0 for end in ends))
        assert whole.planning_time_s == pytest.approx(sum(end.planning_time_s or 0.0 for end in ends), abs=0.15)


def test_a_gripper_that_holds_what_it_shall_pick_has_nothing_to_do(stage: Stages) -> None:
    on = stage(CELL)
    first = on.do(ROBOT, "pick_red")
    again = on.do(ROBOT, "pick_red")
    assert (again.outcome, dict(again.details)) == (Outcome.SUCCEEDED, {"no_op": True})
    assert again.time_ns == on.of(again)[0].time_ns
    assert on.held(ROBOT) == first.target


def test_a_gripper_that_holds_something_else_is_full(stage: Stages) -> None:
    on = stage(CELL)
    first = on.do(ROBOT, "pick_red")
    end = on.do(ROBOT, "pick_blue")
    assert (end.outcome, end.reason) == (Outcome.FAILED, f"the gripper is full ({first.target})")
    assert on.held(ROBOT) == first.target


def test_a_full_hand_picks_nothing(stage: Stages) -> None:
    on = stage(CELL)
    first = on.do(HUMAN, "pick_white")
    end = on.do(HUMAN, "pick_blue")
    assert (end.outcome, end.reason) == (Outcome.FAILED, "the hand is full")
    assert on.held(HUMAN) == first.target


def test_both_never_go_to_the_same_object(stage: Stages) -> None:
    on = stage(small_cell({"objects.1.positions": [[1.16, 0.17, 1.03]]}))
    first, second = on.give(ROBOT, "pick_blue"), on.give(HUMAN, "pick_blue")
    on.play()
    ends = {end.execution_id: end for end in on.ends()}
    assert ends[first.execution_id].outcome == Outcome.SUCCEEDED
    assert ends[second.execution_id].reason == "nothing is left in 'blue'"


def test_an_object_in_a_hand_follows_it(stage: Stages) -> None:
    on = stage(CELL)
    on.give(ROBOT, "carry_red")
    on.give(HUMAN, "carry_white")
    seen = {ROBOT: 0, HUMAN: 0}
    for _ in range(1000):
        on.play(0.02)
        for agent in seen:
            item = on.cell._stock.held_by(agent)
            if item is None or item.position == item.box.position:
                continue
            hand = (
                on.cell._arm.forward(on.cell._robot.joints())[:3, 3]
                if agent == ROBOT
                else hand_position(on.cell._human.joints())
            )
            # the sample is at most two ticks older
            assert math.dist(item.position, hand) < 0.05
            seen[agent] += 1
    assert min(seen.values()) > 10


TAKING = {
    "skills.13": {"agent": HUMAN, "task": "take", "skill": "pick", "objects": "bin"},
    "skills.14": {"agent": ROBOT, "task": "take", "skill": "pick", "objects": "bin"},
    "stands.3": {"group": "bin", "offset": [0.1, 0.55]},
}


def test_what_one_puts_down_another_can_take_from_there(stage: Stages) -> None:
    on = stage(small_cell(TAKING))
    assert on.do(HUMAN, "take").reason == "nothing is left in 'bin'"
    name, slot = on.do(ROBOT, "pick_red").target, on.do(ROBOT, "put").target
    taken = on.do(HUMAN, "take")
    assert (taken.outcome, taken.target) == (Outcome.SUCCEEDED, name)
    assert on.held(HUMAN) == name
    assert slot in [one.name for one in on.cell._stock.free_slots("bin", ROBOT)]
    on.do(HUMAN, "put")
    assert on.placed()[name].startswith("shelf_")


def test_a_gripper_that_took_something_from_a_slot_has_nothing_to_do_either(stage: Stages) -> None:
    on = stage(small_cell(TAKING))
    for task in ("pick_red", "put", "take"):
        assert on.do(ROBOT, task).outcome == Outcome.SUCCEEDED
    again = on.do(ROBOT, "take")
    assert (again.outcome, again.reason, dict(again.details)) == (Outcome.SUCCEEDED, "", {"no_op": True})


def test_a_robot_that_goes_somewhere_arrives_there(stage: Stages) -> None:
    on = stage(CELL)
    for task, pose in (("step_aside", "aside"), ("go_home", "home")):
        assert on.do(ROBOT, task).outcome == Outcome.SUCCEEDED
        named = CELL.robot.pose(pose)
        assert named is not None
        np.testing.assert_allclose(on.cell._robot.joints(), named.joints)


def test_a_human_that_goes_home_arrives_there(stage: Stages) -> None:
    on = stage(CELL)
    on.do(HUMAN, "pick_white")
    assert on.do(HUMAN, "go_home").outcome == Outcome.SUCCEEDED
    x, y, yaw = CELL.human.home
    assert on.cell._human.joints()[:2].tolist() == [x, y]
    assert math.remainder(on.cell._human.joints()[2] - yaw, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)


def test_a_human_without_work_goes_home_after_a_while(stage: Stages) -> None:
    on = stage(CELL)
    on.do(HUMAN, "pick_white")
    there = on.cell._human.joints()[:2].tolist()
    on.play(1.8)
    assert on.cell._human.joints()[:2].tolist() == there
    on.play()
    x, y, _ = CELL.human.home
    assert on.cell._human.joints()[:2].tolist() == [x, y]
    assert on.cell._human.at_home


def test_a_human_that_is_called_on_its_way_home_turns_round_where_it_is(stage: Stages) -> None:
    on = stage(CELL)
    on.do(HUMAN, "pick_white")
    on.play(2.4)
    before = on.cell._human.joints()
    on.give(HUMAN, "put")
    on.play(0.02)
    after = on.cell._human.joints()
    assert not on.cell._human.at_home
    assert np.abs(after - before).max() < 0.1, "it jumps"
    on.play()
    assert on.ends()[-1].outcome == Outcome.SUCCEEDED


def test_a_robot_that_waits_for_a_human_at_rest_goes_on_when_the_human_has_gone_home(stage: Stages) -> None:
    on = stage(with_areas(CELL, ("red", (-1.0, -1.0), (3.0, 0.55), 0.0)))
    on.do(HUMAN, "pick_blue")
    command = on.give(ROBOT, "pick_red")
    on.play()
    assert on.of(command)[-1].kind == "task_ended"
    assert any(isinstance(event, TaskPaused) for event in on.of(command))


def yielding(yield_m: float, patience_s: float) -> dict[str, object]:
    """Return a cell in which the human waits while the gripper is near the only blue object."""
    return {
        "human.yield_m": yield_m,
        "human.patience_s": patience_s,
        "objects.1.positions": [[1.16, 0.17, 1.03]],
        "robot.poses.aside": [0.9, -math.pi / 2, -1.57, 1.57, -1.57, -1.57, 0.0],
    }


def test_a_human_waits_for_the_gripper_to_go_and_says_what_for(stage: Stages) -> None:
    # the gripper stands over the table for good: the human waits as long as it has patience
    waits, hastes = stage(small_cell(yielding(1.0, 1.5))), stage(small_cell(yielding(0.0, 1.5)))
    spans = []
    for on in (waits, hastes):
        on.do(ROBOT, "step_aside")
        end = on.do(HUMAN, "pick_blue")
        assert end.outcome == Outcome.SUCCEEDED
        start = next(e for e in on.of(end) if isinstance(e, TaskStarted))
        spans.append((end.time_ns - start.time_ns) / 1e9)
    assert spans[0] - spans[1] == pytest.approx(1.5, abs=1e-6)
    halts = [e for e in waits.events if isinstance(e, TaskPaused | TaskResumed)]
    assert [type(halt) for halt in halts] == [TaskPaused, TaskResumed]
    assert {(halt.agent, halt.cause) for halt in halts} == {(HUMAN, Cause.DEPENDENCY)}
    assert (halts[1].time_ns - halts[0].time_ns) / 1e9 == pytest.approx(1.5)
    assert waits.cell.truth[-1].lost_s == pytest.approx(1.5)
    assert waits.cell.truth[-1].work_s == pytest.approx(hastes.cell.truth[-1].work_s)


def test_a_human_waits_no_longer_than_the_gripper_is_near(stage: Stages) -> None:
    on = stage(small_cell(yielding(0.5, 60.0)))
    on.do(ROBOT, "step_aside")
    command = on.give(HUMAN, "pick_blue")
    on.play_until(lambda: any(isinstance(event, TaskPaused) for event in on.of(command)))
    on.give(ROBOT, "go_home")
    on.play()
    assert on.of(command)[-1].kind == "task_ended"
    halts = [e for e in on.of(command) if isinstance(e, TaskPaused | TaskResumed)]
    assert len(halts) == 2
    assert (halts[1].time_ns - halts[0].time_ns) / 1e9 < 5.0


def test_a_hesitating_human_takes_longer(stage: Stages) -> None:
    sure, hesitant = (
        stage(small_cell({"human.hesitation_probability": chance, "human.hesitation": {"median_s": 2.0, "sigma": 0.0}}))
        for chance in (0.0, 1.0)
    )
    works = []
    for on in (sure, hesitant):
        on.do(HUMAN, "pick_white")
        on.do(HUMAN, "put")
        works.append([row.work_s for row in on.cell.truth])
    assert works[1][0] - works[0][0] == pytest.approx(2.0, abs=0.011)
    assert works[1][1] == pytest.approx(works[0][1])


def test_no_two_people_are_alike_and_no_two_repetitions(stage: Stages) -> None:
    def works(seed: int, changes: dict[str, float]) -> list[float]:
        on = stage(small_cell({f"human.{name}": value for name, value in changes.items()}), seed=seed)
        for _ in range(3):
            on.do(HUMAN, "go_home")
            on.do(HUMAN, "pick_white")
            on.do(HUMAN, "go_home")
            on.put_back(HUMAN)
        return [row.work_s for row in on.cell.truth if row.task == "pick_white"]

    steady = {"person_sigma": 0.0, "repetition_sigma": 0.0}
    white = small_cell({"objects.2.positions": [[1.84, 1.25, 0.88]]})
    assert len(white.objects_of("white")) == 1
    alike = [works(seed, steady) for seed in (1, 2)]
    assert {min(group) for group in alike} == {min(alike[0])}
    people = [works(seed, {**steady, "person_sigma": 0.2}) for seed in (1, 2, 3)]
    assert len({min(group) for group in people}) == 3
    assert len({tuple(group) for group in people}) == 3
    repeated = works(1, {**steady, "repetition_sigma": 0.3})
    assert len(set(repeated)) == 3


def test_a_failed_grasp_is_tried_again_at_the_same_object_with_the_gripper_turned(stage: Stages) -> None:
    fault = {"agent": ROBOT, "task": "pick_red", "probability": 1.0, "reason": "it slipped"}
    on = stage(small_cell({"faults": [fault]}))
    seen: list[tuple[str, np.ndarray]] = []
    for attempt in (1, 2):
        command = on.give(ROBOT, "pick_red", item="one", attempt=attempt)
        lowest, turned = math.inf, np.zeros(3)
        for _ in range(1000):
            if on.of(command)[-1].kind == "task_ended":
                break
            on.play(0.02)
            pose = on.cell._arm.forward(on.cell._robot.joints())
            if pose[2, 3] < lowest:
                lowest, turned = float(pose[2, 3]), pose[:3, 0]
        seen.append((on.ends()[-1].target, turned))
        assert lowest == pytest.approx(1.03, abs=0.002)
    assert seen[0][0] == seen[1][0]
    assert abs(seen[0][1] @ seen[1][1]) < 1e-3


def test_where_no_way_is_free_the_task_fails_and_says_so(stage: Stages) -> None:
    on = stage(CELL)
    on.cell._robot._planner._free = lambda _: False
    for task, reason in (
        ("pick_red", "no way to red_1, red_2 is free of collisions"),
        ("step_aside", "no way to the pose 'aside' is free of collisions"),
    ):
        end = on.do(ROBOT, task)
        assert (end.outcome, end.reason) == (Outcome.FAILED, reason)
        assert on.held(ROBOT) == ""
    assert len(on.cell._stock.available("red", "somebody else")) == 2


def test_planning_takes_the_time_it_is_said_to_take(stage: Stages) -> None:
    on = stage(small_cell({"robot.planning": {
        "pick": {"median_s": 0.5, "sigma": 0.0}, "place": {"median_s": 0.25, "sigma": 0.0},
    }}))  # fmt: skip
    assert on.do(ROBOT, "pick_red").planning_time_s == pytest.approx(0.5)
    assert on.do(ROBOT, "put").planning_time_s == pytest.approx(0.25)
    assert on.do(ROBOT, "go_home").planning_time_s is None
    assert on.do(HUMAN, "pick_white").planning_time_s is None


def test_the_robot_stands_while_it_plans(stage: Stages) -> None:
    on = stage(small_cell({"robot.planning.pick": {"median_s": 1.0, "sigma": 0.0}}))
    on.give(ROBOT, "pick_red")
    on.play(0.99)
    assert tuple(on.cell._robot.joints()) == CELL.robot.home.joints
    assert not on.cell._robot.moving
    assert on.cell._robot.velocity() is None
    on.play(0.1)
    assert tuple(on.cell._robot.joints()) != CELL.robot.home.joints
    assert on.cell._robot.moving
