"""The cell of a run: what is drawn of it, how that is lit and moved, and that foreign content does no harm."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import polars as pl
import pytest
from event_frames import event, frame
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import ARM_URDF, cell_scene

from hrclog.analyzers.figures.cell import CellFigure, cell_figure
from hrclog.analyzers.figures.palette import CARD, FAILED, REDUCED, blend
from hrclog.analyzers.figures.series import signal_series
from hrclog.analyzers.figures.thinning import worth_drawing
from hrclog.analyzers.figures.urdf import drawable
from hrclog.analyzers.projections.schemas import SIGNALS
from hrclog.log.messages.recorded_scene import POSE_COLUMNS, RunScene
from hrclog.scene import parse_scene, scene_text

MS = 1_000_000
STILL = (0.0, 0.0, 0.0, 1.0)


def samples(*rows: tuple[str, int, float]) -> pl.DataFrame:
    return pl.DataFrame([("r", *row) for row in rows], schema=SIGNALS, orient="row")


def poses(*rows: tuple[str, int, float]) -> pl.DataFrame:
    values = [("r", name, at, x, 0.0, 0.0, *STILL) for name, at, x in rows]
    return pl.DataFrame(values, schema=POSE_COLUMNS, orient="row")


def cell_of(
    log: list[dict[str, Any]] | None = None,
    signals: pl.DataFrame | None = None,
    moves: pl.DataFrame | None = None,
    bodies: dict[str, str] | None = None,
    scene: dict[str, Any] | None = None,
) -> CellFigure:
    parsed, problems = parse_scene(scene_text(cell_scene() if scene is None else scene))
    assert not problems
    run = RunScene(parsed, {"robot": ARM_URDF} if bodies is None else bodies, poses() if moves is None else moves)
    return cell_figure(run, frame(log or []), samples() if signals is None else signals, 1000, -5)


def safety(time_ns: int, zone: str, mode: str = "", scale: float | None = None, agent: str = "robot") -> dict[str, Any]:
    return event("safety_state_changed", time_ns, agent=agent, mode=mode, zone=zone, speed_scale=scale)


def test_an_area_is_lit_while_a_safety_state_of_its_agent_names_it() -> None:
    log = [
        safety(1010, "far", scale=0.5),
        safety(1020, "near", scale=0.0),
        safety(1025, "near", scale=1.0, agent="human"),
        safety(1030, "", "normal", 1.0),
        safety(1040, "near", "protective_stop"),
        safety(1050, "near", "normal"),
    ]
    far, near = cell_of(log).areas
    assert (far.area.name, near.area.name) == ("far", "near")  # the larger one lies below
    orange, red = blend(CARD, REDUCED, 0.8), blend(CARD, FAILED, 0.8)
    assert far.times_ns == (-5, 10, 20)
    assert far.colors == (far.colors[0], orange, far.colors[0])
    assert near.times_ns == (-5, 20, 30, 40, 50)
    assert near.colors == (near.colors[0], red, near.colors[0], red, near.colors[0])
    assert near.colors[0] not in (red, orange)


def test_an_area_without_an_agent_is_lit_by_any_agent() -> None:
    scene = cell_scene()
    del scene["areas"][1]["agent"]
    far, near = cell_of([safety(1010, "far", scale=0.5, agent="AGV")], scene=scene).areas
    assert (len(far.times_ns), len(near.times_ns)) == (2, 1)


def test_a_box_stands_where_it_is_listed_until_it_moves() -> None:
    (moved,) = cell_of(moves=poses(("cube", 1010, 3.0), ("cube", 2000 * MS, 4.0), ("ghost", 1, 0.0))).boxes
    assert moved.times_ns.tolist() == [-5, 10, 2000 * MS - 1000]
    assert moved.positions.tolist() == [[0.8, 0.0, 0.55], [3.0, 0.0, 0.0], [4.0, 0.0, 0.0]]
    assert moved.quaternions[0].tolist() == list(STILL)


def test_poses_of_what_the_scene_does_not_list_are_said_to_be_left_out() -> None:
    assert cell_of(moves=poses(("ghost", 1, 0.0))).captions == (
        "Poses of 1 object that the scene does not list, the first 'ghost'.",
    )


def test_a_body_follows_the_joints_that_were_logged_and_stands_before() -> None:
    signals = samples(("robot/turn", 1100, 0.5), ("robot/turn", 1000 + 80 * MS, 0.7), ("robot/turn", 1, math.nan),
                      ("robot/ghost", 1, 1.0), ("human/turn", 1, 9.0))  # fmt: skip
    (robot,) = cell_of(signals=signals).machines
    assert (robot.agent, robot.name, robot.urdf.root) == ("robot", "agent_robot", "base")
    assert (robot.base.position, robot.base.yaw) == ((0.0, -0.5, 0.0), 1.5)
    (turn,) = robot.joints
    assert turn.times_ns.tolist() == [-5, 100, 80 * MS]
    assert turn.values.tolist() == [0.5, 0.5, 0.7]


def test_the_corners_hold_what_stands_and_where_boxes_go() -> None:
    cell = cell_of(moves=poses(("cube", 1010, 7.0)))
    assert cell.low.tolist() == [-2.4, -2.4, 0.0]
    assert cell.high.tolist() == [7.4, 2.4, 1.7]
    bare = cell_of(scene={"schema_version": 1})
    assert (bare.low < bare.high).all()


BAD_BODIES = {
    "": "not XML",
    "<robot>": "not XML",
    "<mesh/>": "expected 'robot'",
    "<robot/>": "0 links",
    "<!DOCTYPE x [<!ENTITY a 'b'>]><robot/>": "declares entities",
    "<robot><link name='a'/><link name='a'/></robot>": "has no name, or that of another",
    "<robot><link/></robot>": "has no name",
    "<robot><link name='a'/><link name='b'/></robot>": "no tree",
    "<robot><link name='a'/><joint name='j' type='fixed'><parent link='a'/><child link='b'/></joint></robot>": "lead",
    "<robot><link name='a'/><link name='b'/><link name='c'/>"
    "<joint name='j' type='fixed'><parent link='b'/><child link='c'/></joint>"
    "<joint name='k' type='fixed'><parent link='c'/><child link='b'/></joint></robot>": "no tree",
    ARM_URDF.replace('axis xyz="0 0 1"', 'axis xyz="0 0 0"'): "expected a direction",
    ARM_URDF.replace('origin xyz="0.4 0 0"', 'origin xyz="nan 0 0"'): "expected numbers within",
    ARM_URDF.replace('origin xyz="0.4 0 0"', 'origin xyz="1 2"'): "expected numbers within",
    "<robot>" + "".join(f"<link name='{number}'/>" for number in range(301)) + "</robot>": "expected 1 to 300",
    "<a>" * 100_000 + "</a>" * 100_000: "expected 'robot'",
}


@pytest.mark.parametrize(("text", "said"), BAD_BODIES.items(), ids=range(len(BAD_BODIES)))
def test_a_description_that_is_none_is_said_to_be_left_out(text: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        drawable(text, "x")
    cell = cell_of(bodies={"robot": text})
    assert cell.machines == ()
    assert len(cell.captions) == 1
    assert cell.captions[0].startswith("The body of 'robot': ")


def test_a_description_loses_what_lies_in_files_and_what_is_not_seen() -> None:
    text = ARM_URDF.replace('<box size="0.8 0.1 0.1"/>', '<mesh filename="/etc/passwd"/>')
    text = text.replace('type="revolute"', 'type="floating"')
    found = drawable(text, "other")
    assert found.left_out == ("1 joints of kind 'floating'", "1 shapes of kind 'mesh'")
    assert found.joints == ()
    assert 'robot name="other"' in found.text
    for gone in ("passwd", "collision", "floating"):
        assert gone not in found.text
    assert drawable(ARM_URDF, "x").text.count("<box") == 2


def test_at_most_eight_bodies_are_drawn() -> None:
    cell = cell_of(bodies={f"robot {number}": ARM_URDF for number in range(10)})
    assert len({machine.name for machine in cell.machines}) == 8
    assert cell.captions == ("2 further agents with bodies.",)


def test_joints_of_bodies_come_after_the_other_signals() -> None:
    signals = samples(*[(name, at * MS, float(at)) for name in ("human/a", "gap", "z/y") for at in range(0, 300, 20)])
    lines, _ = signal_series(signals, 0, ["human"])
    assert [(line.group, line.name, line.joint) for line in lines] == [
        ("signals", "gap", False), ("z", "z/y", False), ("joints of human", "a", True),
    ]  # fmt: skip
    assert [len(line.times_ns) for line in lines] == [15, 15, 4]
    assert [line.group for line in signal_series(signals, 0)[0]] == ["signals", "human", "z"]


@settings(max_examples=60)
@given(st.lists(st.tuples(st.integers(0, 200 * MS), st.integers(0, 2)), max_size=40))
def test_a_held_value_is_never_late_by_more_than_a_period(steps: list[tuple[int, int]]) -> None:
    times = np.cumsum([gap for gap, _ in steps], dtype=np.int64)
    values = np.array([[float(value)] for _, value in steps]).reshape(-1, 1)
    kept = worth_drawing(times, values, 40 * MS)
    assert (np.diff(kept) > 0).all()
    if not steps:
        return
    assert kept[0] == 0
    assert kept[-1] == len(steps) - 1
    for at in range(len(steps)):
        last = kept[kept <= at][-1]
        assert values[last] == values[at] or times[at] - times[last] <= 40 * MS


def test_what_moves_all_the_time_is_thinned_and_what_stands_is_two_samples() -> None:
    times = np.arange(0, 1000 * MS, 10 * MS)
    assert len(worth_drawing(times, np.arange(100.0)[:, None])) == 26
    assert worth_drawing(times, np.zeros((100, 1))).tolist() == [0, 99]
