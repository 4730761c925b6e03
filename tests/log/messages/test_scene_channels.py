"""The cell of a run in its log: what was written is read, and what is damaged or foreign is said and left out."""

from __future__ import annotations

import copy
import json
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import ARM_URDF, cell_scene

from hrclog.errors import InvalidEventError
from hrclog.events import Heartbeat, TaskStarted
from hrclog.log.logs import Logs
from hrclog.log.messages import channels
from hrclog.log.messages.encode import (
    DescriptionSignal,
    FloatSignal,
    JointSignal,
    Message,
    PoseSignal,
    SceneSignal,
    Signal,
    event_message,
)
from hrclog.log.reader import read_logs
from hrclog.log.writing.writer import write_atomically, write_log
from hrclog.scene import Area, Base, Box, Scene, Slot, parse_scene, scene_text

STARTED = TaskStarted(time_ns=5, run_id="r", agent="robot", task="pick", execution_id="e")
HALF = math.sqrt(0.5)
ANY_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=4),
    max_leaves=8,
)


def raw(path: Path, *messages: Message) -> Logs:
    """Return what is read of a log with messages as they are."""

    def fill(writer: Any) -> None:  # noqa: ANN401 - a FinishedWriter
        for message in (event_message(STARTED, 5), *messages):
            writer.add(message)

    write_atomically(path, fill)
    return read_logs(path, signals=True)


def written(path: Path, *signals: Signal) -> Logs:
    write_log(path, [STARTED], signals)
    return read_logs(path, signals=True)


def test_a_scene_comes_back_as_it_was_written(tmp_path: Path) -> None:
    logs = written(
        tmp_path / "a.mcap",
        SceneSignal("r", 5, cell_scene()),
        DescriptionSignal("r", "Müller, Ana", 5, ARM_URDF),
        PoseSignal("r", "cube", 7, (1.0, 2.0, 3.0), (0.0, 0.0, HALF, HALF)),
        PoseSignal("r", "cube", 6, (0.5, 2.0, 3.0)),
        PoseSignal("r", "a/b 🦾", 6, (0.0, 0.0, 0.0)),
    )
    assert [found.code for found in logs.diagnostics] == ["run_not_ended"] or not logs.diagnostics
    cell = logs.scene.of_run("r")
    assert cell is not None
    assert cell.scene == Scene(
        (Box("cube", (0.1, 0.1, 0.1), (0.8, 0.0, 0.55), 0.0, (0, 0, 255)),),
        (Box("table", (1.0, 1.0, 0.5), (1.0, 0.0, 0.25), 0.0, (120, 90, 60)),),
        (
            Area("near", (-1.0, -1.0), (1.0, 1.0), "red", "robot"),
            Area("far", (-2.0, -2.0), (2.0, 2.0), "orange", "robot"),
        ),
        (Slot("slot 1", (1.2, 0.2, 0.55)),),
        (Base("robot", (0.0, -0.5, 0.0), 1.5),),
    )
    assert cell.descriptions == {"Müller, Ana": ARM_URDF}
    assert cell.poses.select("name", "time_ns", "x").rows() == [("a/b 🦾", 6, 0.0), ("cube", 6, 0.5), ("cube", 7, 1.0)]
    np.testing.assert_allclose(cell.poses.row(2)[3:], [1, 2, 3, 0, 0, HALF, HALF])
    assert logs.signals.is_empty()
    assert logs.scene.of_run("another run") is None
    assert read_logs(tmp_path / "a.mcap").scene.of_run("r") is None


def test_runs_in_one_file_and_files_of_one_run_keep_their_scenes(tmp_path: Path) -> None:
    scenes = [
        SceneSignal(run, 1, {"schema_version": 1, "slots": [{"name": run, "position": [0, 0, 0]}]}) for run in "ab"
    ]
    write_log(tmp_path / "1.mcap", [Heartbeat(time_ns=1, run_id=run) for run in "ab"], scenes)
    again = [DescriptionSignal("a", "robot", 9, "later"), PoseSignal("a", "cube", 9, (0, 0, 1))]
    write_log(tmp_path / "2.mcap", [Heartbeat(time_ns=9, run_id="a")], [scenes[1], *again])
    scene = read_logs([tmp_path / "2.mcap", tmp_path / "1.mcap"], signals=True).scene
    assert {run: one.slots[0].name for run, one in scene.scenes.items()} == {"a": "a", "b": "b"}
    assert scene.descriptions == {("a", "robot"): "later"}
    assert scene.poses.select("run_id", "name", "z").rows() == [("a", "cube", 1.0)]


@settings(max_examples=25)
@given(
    st.lists(
        st.tuples(
            st.lists(st.tuples(st.text(max_size=3), st.floats(allow_nan=False)), max_size=3), st.integers(0, 2**62)
        ),
        max_size=6,
    )
)
def test_joint_states_of_mixed_layouts_give_every_sample(
    tmp_path: Path, states: list[tuple[list[tuple[str, float]], int]]
) -> None:
    path = tmp_path / "a.mcap"
    path.unlink(missing_ok=True)
    states = [([(name.rstrip("\0"), value) for name, value in joints], time_ns // 4) for joints, time_ns in states]
    signals = [
        JointSignal("r", "H", time_ns, tuple(name for name, _ in joints), tuple(value for _, value in joints))
        for joints, time_ns in states
    ]
    found = written(path, *signals).signals.select("name", "time_ns", "value").rows()
    assert sorted(found) == sorted(
        (f"H/{name}", time_ns, value) for joints, time_ns in states for name, value in joints
    )


def test_what_is_no_scene_is_refused_when_it_is_written(tmp_path: Path) -> None:
    bad = cell_scene()
    bad["boxes"][0]["color"] = [0.5, 0.5, 0.5]
    cases: list[tuple[Signal, str]] = [
        (SceneSignal("r", 1, bad), r"boxes\[0\]: color: found .*0\.5.*, expected 3 whole numbers from 0 to 255"),
        (SceneSignal("r", 1, {"boxes": []}), "schema_version: found None, expected 1"),
        (SceneSignal("r", 1, {"schema_version": 1, "boxes": [math.nan]}), "not JSON"),
        (SceneSignal("r", 1, {"schema_version": 1, "boxes": {1, 2}}), "not JSON"),
        (DescriptionSignal("r", "robot", 1, "\ud800"), "not valid Unicode"),
        (PoseSignal("r", "cube", 2**70, (0, 0, 0)), "pose: a field cannot be written"),
        (PoseSignal("r", "cube", 1, (0, 0)), "expected 3 and 4"),  # type: ignore[arg-type]  # the error is the point
    ]
    for number, (signal, text) in enumerate(cases):
        with pytest.raises(InvalidEventError, match=text):
            write_log(tmp_path / f"{number}.mcap", [STARTED], [signal])


HOSTILE: list[tuple[list[Any], Any, str]] = [
    (["boxes"], "cube", "boxes: found 'cube', expected a list"),
    (["boxes", 0], 7, "expected a JSON object"),
    (["boxes", 0, "name"], "", "expected a text that is not empty"),
    (["boxes", 0, "name"], "\ud800", "expected valid Unicode"),
    (["boxes", 0, "size"], [1, 1, 0], "expected numbers above 0"),
    (["boxes", 0, "size"], [1, 1], "expected 3 numbers"),
    (["boxes", 0, "position"], [1, math.nan, 1], "expected a number within"),
    (["boxes", 0, "position"], [1, math.inf, 1], "expected a number within"),
    (["boxes", 0, "position"], [1, 10**400, 1], "expected a number within"),
    (["boxes", 0, "position"], [True, 1, 1], "expected a number within"),
    (["boxes", 0, "yaw"], "left", "expected a number within"),
    (["boxes", 0, "color"], [0, 0, 256], "expected 3 whole numbers"),
    (["boxes", 0, "color"], "red", "expected 3 whole numbers"),
    (["areas", 0, "low"], [5, 5], "more than low"),
    (["areas", 0, "kind"], "green", "expected red or orange"),
    (["areas", 0, "agent"], None, "expected a name"),
    (["areas", 1, "name"], "near", "expected one of its own"),
    (["bases", 0, "yaw"], [0], "expected a number within"),
    (["slots", 0, "position"], None, "expected 3 numbers"),
    (["schema_version"], 2, "schema_version: found 2, expected 1"),
]


@pytest.mark.parametrize(("place", "value", "text"), HOSTILE)
def test_what_is_wrong_of_a_scene_is_left_out_and_said(place: list[Any], value: Any, text: str) -> None:  # noqa: ANN401 - JSON
    good = parse_scene(scene_text(cell_scene()))[0]
    scene = copy.deepcopy(cell_scene())
    parent = scene
    for step in place[:-1]:
        parent = parent[step]
    parent[place[-1]] = value
    found, problems = parse_scene(json.dumps(scene))
    assert len(problems) == 1
    assert text in problems[0]
    kinds = ("boxes", "fixtures", "areas", "slots", "bases")
    for kind in kinds:
        lost = len(getattr(good, kind)) - len(getattr(found, kind))
        assert lost == (kind == place[0])


@pytest.mark.parametrize("text", ["", "[]", "7", "nonsense", "[" * 100_000, '{"schema_version":1,"boxes":{}}', "NaN"])
def test_a_text_that_is_no_scene_gives_an_empty_one(text: str) -> None:
    found, problems = parse_scene(text)
    assert found == Scene()
    assert len(problems) == 1


@settings(max_examples=100)
@given(st.dictionaries(st.sampled_from(["boxes", "areas", "bases", "schema_version"]), ANY_JSON))
def test_any_json_is_a_scene_or_says_what_is_wrong(value: dict[str, Any]) -> None:
    found, problems = parse_scene(json.dumps(value))
    assert problems or value.get("schema_version") == 1
    assert isinstance(found, Scene)


def test_damaged_messages_and_foreign_numbers_are_left_out_and_said(tmp_path: Path) -> None:
    pose = channels.encode_pose(1, (1, 2, 3), (0, 0, 0, 2))
    bad_poses = [
        b"",
        pose[:40],
        b"\0\0" + pose[2:],
        pose[:12] + struct.pack("<I", 2**31) + pose[16:],
        channels.encode_pose(1, (math.nan, 2, 3), (0, 0, 0, 1)),
        channels.encode_pose(1, (1e300, 2, 3), (0, 0, 0, 1)),
        channels.encode_pose(1, (1, 2, 3), (0, 0, 0, 0)),
        channels.encode_pose(1, (1, 2, 3), (0, 0, 0, math.inf)),
    ]
    texts = [b"", b"\0\1\0\0\xff\xff\xff\xff", b"\0\1\0\0\2\0\0\0\xff\0", channels.encode_string("{")]
    logs = raw(
        tmp_path / "a.mcap",
        *[Message(channels.object_pose("cube", "r"), 1, 1, data) for data in (*bad_poses, pose)],
        *[Message(channels.scene("r"), 1, 1, data) for data in texts],
        *[Message(channels.description("robot", "r"), 1, 1, data) for data in texts[:3]],
        *[Message(channels.joint_states("robot", "r"), 1, 1, data) for data in (b"", pose[:20], pose)],
    )
    assert logs.scene.poses.drop("run_id").rows() == [("cube", 1, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)]
    assert logs.scene.scenes == {"r": Scene()}
    assert logs.scene.descriptions == {}
    said = [found.message for found in logs.diagnostics if found.code == "invalid_scene"]
    assert len(said) == 1 + 3 + 1 + 3
    assert any(f"{len(bad_poses)} poses of 'cube' were left out" in text for text in said)
    assert logs.events.height == 1


def test_a_huge_description_is_left_out_and_said(tmp_path: Path) -> None:
    logs = written(tmp_path / "a.mcap", DescriptionSignal("r", "robot", 1, " " * 10_000_001))
    assert logs.scene.of_run("r") is None
    assert "expected at most 10000000" in logs.diagnostics[0].message


def test_topics_of_a_scene() -> None:
    assert channels.description("robot", "r").topic == "/hrc/agents/robot/description"
    assert channels.object_pose("blue 1", "r").topic.startswith("/hrc/objects/_blue_1_")
    assert channels.scene("r").topic == "/hrc/scene"
    assert pl.Series(channels.object_pose("blue 1", "r").metadata).to_list() == [["object", "blue 1"], ["run_id", "r"]]


def test_samples_and_poses_given_twice_count_once(tmp_path: Path) -> None:
    signals: list[Signal] = [FloatSignal("r", "gap", 3, 0.5), PoseSignal("r", "cube", 3, (1, 2, 3))]
    for name in ("a", "b"):
        write_log(tmp_path / f"{name}.mcap", [STARTED], signals)
    write_log(tmp_path / "c.mcap", [Heartbeat(time_ns=1, run_id="q")], [FloatSignal("q", "gap", 3, 0.5)])
    logs = read_logs(tmp_path, signals=True)
    assert logs.signals.rows() == [("q", "gap", 3, 0.5), ("r", "gap", 3, 0.5)]
    assert logs.scene.poses.height == 1
