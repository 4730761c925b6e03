"""The life of a command in the stepped cell: its time adds up, whenever it begins and however it ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from cells import HUMAN, ROBOT, START_NS, Stage, small_cell, small_plan, small_scenario, with_areas
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.events import (
    AnnotationAdded,
    Cause,
    Outcome,
    Role,
    TaskDispatched,
    TaskEnded,
    TaskFact,
    TaskPaused,
    TaskResumed,
    TaskStarted,
)
from hrclog.sim.run import Run, simulate_run
from hrclog.sim.truth import ExecutionTruth

pytestmark = pytest.mark.slow

Stages = Callable[..., Stage]

CELL = small_cell()
EVERYWHERE = ("everywhere", (-9.0, -9.0), (9.0, 9.0))


def durations(stage: Stage) -> dict[str, float]:
    """Return the seconds from start to end of every execution that began, by its id."""
    starts = {e.execution_id: e.time_ns for e in stage.events if isinstance(e, TaskStarted)}
    return {
        e.execution_id: (e.time_ns - starts[e.execution_id]) / 1e9 for e in stage.ends() if e.execution_id in starts
    }


def truth_of(stage: Stage, execution_id: str) -> ExecutionTruth:
    """Return the truth about an execution."""
    return next(row for row in stage.cell.truth if row.execution_id == execution_id)


def adds_up(stage: Stage) -> None:
    """Assert that the time of every execution is planning, work and loss."""
    taken = durations(stage)
    assert taken
    for row in stage.cell.truth:
        assert row.planning_s is not None
        assert row.lost_s is not None
        assert row.work_s + row.lost_s == pytest.approx(taken[row.execution_id], abs=1e-6)
        assert row.lost_s >= -1e-9
        assert row.work_s >= row.planning_s - 1e-9 >= -1e-9


def test_an_execution_at_full_speed_is_planning_and_work(stage: Stages) -> None:
    on = stage(CELL)
    for agent, task in ((ROBOT, "pick_red"), (ROBOT, "put"), (ROBOT, "tour"), (HUMAN, "carry_white")):
        end = on.do(agent, task)
        assert end.outcome == Outcome.SUCCEEDED
        row = truth_of(on, end.execution_id)
        assert row.lost_s == pytest.approx(0.0, abs=1e-9)
        assert row.planning_s == pytest.approx(end.planning_time_s or 0.0)
    adds_up(on)


@pytest.mark.parametrize("scale", [0.5, 0.3, 1 / 3])
def test_at_a_share_of_full_speed_the_same_work_takes_longer_and_planning_does_not(stage: Stages, scale: float) -> None:
    usual, slowed = stage(CELL), stage(with_areas(CELL, (*EVERYWHERE, scale)))
    for on in (usual, slowed):
        on.do(ROBOT, "pick_red")
        adds_up(on)
    free, late = usual.cell.truth[0], slowed.cell.truth[0]
    assert free.planning_s == late.planning_s
    assert late.work_s == pytest.approx(free.work_s, abs=1e-6)
    motion_s = free.work_s - (free.planning_s or 0.0)
    # brakes need a moment to let the scale fall, and the last tick is a whole one
    assert late.lost_s == pytest.approx(motion_s / scale - motion_s, abs=0.1)


def test_a_robot_that_is_not_let_go_on_loses_all_the_time_there_is(stage: Stages) -> None:
    on = stage(with_areas(CELL, (*EVERYWHERE, 0.0)))
    command = on.give(ROBOT, "pick_red")
    on.play(10.0)
    assert not on.ends()
    on.cell.executors[ROBOT].cancel(command.execution_id, "enough")
    adds_up(on)
    row = truth_of(on, command.execution_id)
    assert row.work_s - (row.planning_s or 0.0) < 0.1
    assert row.work_s + (row.lost_s or 0.0) == pytest.approx(10.0)


def test_a_halt_is_told_once_and_so_is_its_end(stage: Stages) -> None:
    # the human at home is outside, at its release area inside
    on = stage(with_areas(CELL, ("red", (-1.0, 0.0), (0.75, 3.0), 0.0)))
    robot = on.give(ROBOT, "tour")
    on.give(HUMAN, "carry_white")
    on.play()
    halts = [e for e in on.of(robot) if isinstance(e, TaskPaused | TaskResumed)]
    kinds = [type(e) for e in halts]
    assert kinds
    assert kinds == [TaskPaused, TaskResumed] * (len(kinds) // 2)
    assert {e.cause for e in halts} == {Cause.SAFETY}
    paused_s = sum((b.time_ns - a.time_ns) / 1e9 for a, b in zip(halts[::2], halts[1::2], strict=True))
    row = truth_of(on, robot.execution_id)
    assert row.lost_s is not None
    assert 0.0 < paused_s <= row.lost_s + 1e-6
    adds_up(on)


def test_a_command_begins_after_the_gap_of_its_agent(stage: Stages) -> None:
    on = stage(CELL, gap_s=0.5)
    commands = [on.give(ROBOT, "pick_red"), on.give(HUMAN, "pick_white")]
    on.play()
    starts = {e.execution_id: (e.time_ns - START_NS) / 1e9 for e in on.events if isinstance(e, TaskStarted)}
    assert starts == {command.execution_id: pytest.approx(0.5) for command in commands}
    adds_up(on)


@pytest.mark.parametrize("offset_s", [0.001, 0.0099999, 0.01])
@pytest.mark.parametrize("agent", [ROBOT, HUMAN])
def test_a_command_may_come_at_any_instant(stage: Stages, agent: str, offset_s: float) -> None:
    on = stage(CELL)
    on.give(HUMAN if agent == ROBOT else ROBOT, "go_home")  # time goes by already
    on.play(offset_s)
    command = on.give(agent, "pick_red" if agent == ROBOT else "pick_white")
    on.play()
    assert on.of(command)[-1].kind == "task_ended"
    adds_up(on)


@pytest.mark.parametrize("for_s", [0.001, 0.1234567, 1.0, 1.2512345])
def test_a_command_may_be_cancelled_at_any_instant(stage: Stages, for_s: float) -> None:
    on = stage(CELL)
    commands = [on.give(ROBOT, "pick_red"), on.give(HUMAN, "pick_white")]
    on.play(for_s)
    under_way = [command for command in commands if not isinstance(on.of(command)[-1], TaskEnded)]
    assert under_way
    for command in under_way:
        on.cell.executors[command.agent].cancel(command.execution_id, "enough")
        end = on.of(command)[-1]
        assert isinstance(end, TaskEnded)
        assert (end.outcome, end.reason, end.time_ns) == (Outcome.CANCELED, "enough", on.queue.now_ns)
    adds_up(on)
    for agent in (ROBOT, HUMAN):  # life goes on
        on.do(agent, "go_home")
    on.play()
    adds_up(on)


def test_a_command_that_waits_is_cancelled_without_a_start(stage: Stages) -> None:
    on = stage(CELL, gap_s=1.0)
    command = on.give(ROBOT, "pick_red")
    on.play(0.5)
    on.cell.executors[ROBOT].cancel(command.execution_id, "enough")
    on.play()
    assert [type(event) for event in on.of(command)] == [TaskDispatched, TaskEnded]
    assert not on.cell.truth
    assert on.do(ROBOT, "pick_red").outcome == Outcome.SUCCEEDED


def test_cancelling_while_it_plans_costs_no_more_planning_than_there_was(stage: Stages) -> None:
    on = stage(small_cell({"robot.planning.pick": {"median_s": 2.0, "sigma": 0.0}}))
    command = on.give(ROBOT, "pick_red")
    on.play(0.5)
    before = joints(on)
    on.cell.executors[ROBOT].cancel(command.execution_id, "enough")
    row = truth_of(on, command.execution_id)
    assert (row.planning_s, row.work_s, row.lost_s) == pytest.approx((0.5, 0.5, 0.0))
    end = on.of(command)[-1]
    assert isinstance(end, TaskEnded)
    assert end.planning_time_s == pytest.approx(0.5)
    assert not end.path_length
    assert joints(on) == before == CELL.robot.home.joints


def joints(stage: Stage) -> tuple[float, ...]:
    """Return where the robot's joints are."""
    return tuple(stage.cell._robot.joints().tolist())


def test_cancelling_a_motion_leaves_the_robot_where_it_is_and_its_target_to_others(stage: Stages) -> None:
    on = stage(small_cell({"objects.1.positions": [[1.16, 0.17, 1.03]]}))
    whole = stage(CELL).do(ROBOT, "pick_red").path_length
    command = on.give(ROBOT, "pick_blue")
    on.play(1.0)
    where = joints(on)
    assert where != CELL.robot.home.joints
    assert not on.cell._stock.available("blue", HUMAN)
    on.cell.executors[ROBOT].cancel(command.execution_id, "enough")
    assert joints(on) == where
    on.play(1.0)
    assert joints(on) == where
    end = on.of(command)[-1]
    assert isinstance(end, TaskEnded)
    assert whole is not None
    assert end.path_length is not None
    assert 0.0 < end.path_length < whole
    assert [item.box.name for item in on.cell._stock.available("blue", HUMAN)] == ["blue_1"]
    assert on.do(ROBOT, "pick_blue").outcome == Outcome.SUCCEEDED
    adds_up(on)


def test_what_was_gripped_before_the_cancel_stays_in_the_gripper(stage: Stages) -> None:
    on = stage(CELL)
    command = on.give(ROBOT, "pick_red")
    on.play_until(lambda: on.held(ROBOT) != "")
    on.cell.executors[ROBOT].cancel(command.execution_id, "enough")
    held = on.held(ROBOT)
    assert held
    again = on.do(ROBOT, "pick_red")
    assert (again.outcome, dict(again.details)) == (Outcome.SUCCEEDED, {"no_op": True})
    assert on.do(ROBOT, "put").outcome == Outcome.SUCCEEDED
    assert list(on.placed()) == [held]


@pytest.mark.parametrize(("agent", "pick", "slots"), [(ROBOT, "pick_red", "slots.0"), (HUMAN, "pick_white", "slots.1")])
def test_a_slot_that_was_filled_before_the_cancel_stays_full(stage: Stages, agent: str, pick: str, slots: str) -> None:
    places = [[0.08, 0.05, 1.03]] if agent == ROBOT else [[0.07, 1.01, 0.93]]
    on = stage(small_cell({f"{slots}.positions": places}))
    on.do(agent, pick)
    command = on.give(agent, "put")
    on.play_until(lambda: on.held(agent) == "")
    on.cell.executors[agent].cancel(command.execution_id, "enough")
    on.play(0.1)
    assert on.do(agent, pick).outcome == Outcome.SUCCEEDED
    assert on.do(agent, "put").reason == f"nothing is left in {'bin' if agent == ROBOT else 'shelf'!r}"


def test_an_unknown_execution_cannot_be_cancelled(stage: Stages) -> None:
    on = stage(CELL)
    on.cell.executors[ROBOT].cancel("none", "enough")
    end = on.do(ROBOT, "go_home")
    on.cell.executors[ROBOT].cancel(end.execution_id, "too late")
    assert len(on.ends()) == 1


def test_nothing_to_do_ends_at_once_and_says_so(stage: Stages) -> None:
    on = stage(CELL)
    for agent in (ROBOT, HUMAN):
        end = on.do(agent, "go_home")
        assert (end.outcome, dict(end.details)) == (Outcome.SUCCEEDED, {"no_op": True})
        assert durations(on)[end.execution_id] == 0.0
    moved = on.do(ROBOT, "step_aside")
    assert (moved.outcome, dict(moved.details)) == (Outcome.SUCCEEDED, {})
    assert moved.path_length == pytest.approx(0.6)


def test_the_parts_of_a_sequence_are_auxiliary_and_belong_to_it(stage: Stages) -> None:
    on = stage(CELL)
    whole = on.do(ROBOT, "tour")
    parts = [e for e in on.events if isinstance(e, TaskFact) and e.parent_execution_id]
    assert {part.parent_execution_id for part in parts} == {whole.execution_id}
    assert {part.role for part in parts} == {Role.AUXILIARY}
    assert [(part.kind, part.task) for part in parts] == [
        (kind, task) for task in ("step_aside", "pick_red", "put") for kind in ("task_started", "task_ended")
    ]
    assert len({part.execution_id for part in parts}) == 3
    start, end = on.of(whole)[1], on.of(whole)[-1]
    assert parts[0].time_ns == start.time_ns
    assert parts[-1].time_ns == end.time_ns
    assert [a.time_ns for a in parts[1:-1:2]] == [b.time_ns for b in parts[2::2]]
    assert len(on.cell.truth) == 1


def test_a_sequence_that_is_cut_short_ends_its_part_too(stage: Stages) -> None:
    on = stage(CELL)
    command = on.give(ROBOT, "tour")
    on.play(0.5)
    on.cell.executors[ROBOT].cancel(command.execution_id, "enough")
    assert [(e.kind, e.task, getattr(e, "outcome", "")) for e in on.events if isinstance(e, TaskFact)] == [
        ("task_dispatched", "tour", ""),
        ("task_started", "tour", ""),
        ("task_started", "step_aside", ""),
        ("task_ended", "step_aside", Outcome.CANCELED),
        ("task_ended", "tour", Outcome.CANCELED),
    ]


def test_a_part_that_cannot_be_done_fails_its_sequence(stage: Stages) -> None:
    on = stage(small_cell({"skills.6.steps": ["step_aside", "put", "pick_red"]}))
    end = on.do(ROBOT, "tour")
    assert (end.outcome, end.reason) == (Outcome.FAILED, "there is nothing in the gripper to place")
    parts = [e for e in on.events if isinstance(e, TaskEnded) and e.parent_execution_id]
    assert [(part.task, part.outcome) for part in parts] == [
        ("step_aside", Outcome.SUCCEEDED),
        ("put", Outcome.FAILED),
    ]
    adds_up(on)


def fault(agent: str, task: str, probability: float = 1.0) -> dict[str, Any]:
    """Return a fault as JSON values."""
    return {"agent": agent, "task": task, "probability": probability, "reason": "it slipped"}


@pytest.mark.parametrize(("agent", "task"), [(ROBOT, "pick_red"), (HUMAN, "pick_white")])
def test_a_failed_grasp_takes_the_whole_way_and_nothing_with_it(stage: Stages, agent: str, task: str) -> None:
    on, fine = stage(small_cell({"faults": [fault(agent, task)]})), stage(CELL)
    end = on.do(agent, task, item="one")
    assert (end.outcome, end.reason) == (Outcome.FAILED, "it slipped")
    assert on.cell._stock.held_by(agent) is None
    group = "red" if agent == ROBOT else "white"
    assert len(on.cell._stock.available(group, "somebody else")) == 2
    fine.do(agent, task)
    assert truth_of(on, end.execution_id).work_s == pytest.approx(fine.cell.truth[0].work_s)
    adds_up(on)


@pytest.mark.parametrize(("agent", "task"), [(ROBOT, "pick_blue"), (HUMAN, "pick_blue")])
def test_a_retry_goes_to_the_same_object_if_nobody_took_it(stage: Stages, agent: str, task: str) -> None:
    on = stage(small_cell({"faults": [fault(agent, task)]}))
    targets = [on.do(agent, task, item="one", attempt=attempt).target for attempt in (1, 2, 3, 4)]
    assert len(set(targets)) == 1
    assert targets[0].startswith("blue_")


def test_a_retry_goes_elsewhere_if_somebody_took_the_object(stage: Stages) -> None:
    on = stage(small_cell({"faults": [fault(ROBOT, "pick_blue")]}))
    first = on.do(ROBOT, "pick_blue", item="one").target
    taken: list[str] = []
    while first not in taken and len(taken) < 3:
        taken.append(on.do(HUMAN, "pick_blue").target)
        on.do(HUMAN, "put")
    second = on.do(ROBOT, "pick_blue", item="one", attempt=2)
    if len(taken) == 3:
        assert second.reason == "nothing is left in 'blue'"
    else:
        assert second.target not in taken


def test_a_failed_placing_keeps_the_object_and_its_slot_for_the_retry(stage: Stages) -> None:
    on = stage(small_cell({"faults": [fault(ROBOT, "put")]}))
    on.do(ROBOT, "pick_red")
    ends = [on.do(ROBOT, "put", item="one", attempt=attempt) for attempt in (1, 2)]
    assert [end.outcome for end in ends] == [Outcome.FAILED] * 2
    assert ends[0].target == ends[1].target
    assert on.cell._stock.held_by(ROBOT) is not None


@pytest.mark.parametrize("agent", [ROBOT, HUMAN])
def test_a_fault_of_going_somewhere_strikes_both_agents_alike(stage: Stages, agent: str) -> None:
    on = stage(small_cell({"faults": [fault(agent, "go_home")]}))
    on.do(agent, "pick_red" if agent == ROBOT else "pick_white")
    assert on.do(agent, "go_home").outcome == Outcome.FAILED


def test_faults_strike_as_often_as_they_should(stage: Stages) -> None:
    on = stage(small_cell({"faults": [fault(HUMAN, "pick_white", 0.3)], "human.grasp_s": 0.0}))
    failed = 0
    for _ in range(40):
        if on.do(HUMAN, "pick_white").outcome == Outcome.FAILED:
            failed += 1
        else:
            on.put_back(HUMAN)
    assert 4 <= failed <= 20  # 1 in 1000 runs of 40 is outside


deeds = st.lists(
    st.tuples(
        st.sampled_from([ROBOT, HUMAN]),
        st.sampled_from(["pick_blue", "put", "tour", "go_home"]),
        st.integers(0, 4_000_000_000),
        st.booleans(),
    ),
    min_size=1,
    max_size=6,
)


@settings(max_examples=8)
@given(deeds, st.floats(0.0, 1.0))
def test_time_adds_up_and_hands_hold_one_thing_whatever_is_told(
    stage: Stages, told: list[tuple[str, str, int, bool]], scale: float
) -> None:
    on = stage(with_areas(CELL, ("slow", (-9.0, -9.0), (9.0, 1.0), scale)))
    for agent, task, for_ns, cancels in told:
        executor = on.cell.executors[agent]
        inner = on.cell._robot if agent == ROBOT else on.cell._human
        if not inner.busy:
            on.give(agent, task)
        on.play(for_ns / 1e9)
        running = inner.running
        if cancels and running is not None:
            executor.cancel(running.command.execution_id, "enough")
        assert len(set(on.in_hands())) == len(on.in_hands())
        assert len(set(on.placed().values())) == len(on.placed())
    if on.cell.truth:
        adds_up(on)


ITEMS = ((ROBOT, "pick_red"), (ROBOT, "put"), (HUMAN, "pick_white"), (HUMAN, "put"), (ROBOT, "carry_red"))


def run_of(items: tuple[tuple[str, str], ...] = ITEMS, mode: str = "sequential", timeout_s: float | None = None) -> Run:
    """Return a run of the small cell in which both agents have work."""
    scenario = replace(small_scenario(CELL, items, gap_s=0.1), dispatch_mode=mode)
    return simulate_run(scenario, 1, 0, plan=small_plan(*items, timeout_s=timeout_s), engine="bullet")


@pytest.mark.parametrize("mode", ["sequential", "timed", "synchronous", "asynchronous", "reactive"])
def test_plans_are_carried_out_in_every_mode(mode: str) -> None:
    pytest.importorskip("pybullet")
    run = run_of(mode=mode)
    assert {row.outcome for row in run.truth.executions} == {"succeeded"}
    assert len(run.truth.executions) == 5


@pytest.mark.parametrize("timeout_s", [1.5, 1.2345678])
def test_a_limit_of_any_length_ends_an_attempt_and_nothing_else(timeout_s: float) -> None:
    pytest.importorskip("pybullet")
    run = run_of(timeout_s=timeout_s)
    assert not [event for event in run.events if isinstance(event, AnnotationAdded)]
    starts = {e.execution_id: e.time_ns for e in run.events if isinstance(e, TaskStarted)}
    limited = [e for e in run.events if isinstance(e, TaskEnded) and e.outcome == Outcome.TIMED_OUT]
    assert limited
    assert {(e.time_ns - starts[e.execution_id]) / 1e9 for e in limited} == {timeout_s}
    taken = {e.execution_id: (e.time_ns - starts[e.execution_id]) / 1e9 for e in limited}
    for row in run.truth.executions:
        if row.execution_id in taken:
            assert row.work_s + (row.lost_s or 0.0) == pytest.approx(taken[row.execution_id], abs=1e-6)


def test_the_parts_of_a_sequence_are_in_the_log_of_a_run() -> None:
    pytest.importorskip("pybullet")
    run = run_of(((ROBOT, "pick_red"), (ROBOT, "put"), (ROBOT, "tour")))
    assert not [event for event in run.events if isinstance(event, AnnotationAdded)]
    parts = [e for e in run.events if isinstance(e, TaskEnded) and e.parent_execution_id]
    assert [part.task for part in parts] == ["step_aside", "pick_red", "put"]
    wholes = [e for e in run.events if isinstance(e, TaskEnded) and e.task == "tour"]
    assert {part.parent_execution_id for part in parts} == {wholes[0].execution_id}
