"""The cell in a run's recording: its links, boxes and areas move and light up as was logged."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cell_logs import RUN, write_cell_log
from rerun.chunk import RrdReader
from scenes import ARM_URDF, cell_scene

from hrclog.analyzers.analysis import analyze
from hrclog.analyzers.result import Analysis
from hrclog.events import TaskStarted
from hrclog.log.messages import channels
from hrclog.log.messages.encode import Message, event_message
from hrclog.log.writing.writer import FinishedWriter, write_atomically

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def analysis(tmp_path_factory: pytest.TempPathFactory) -> Analysis:
    path = tmp_path_factory.mktemp("cell") / "cell.mcap"
    write_cell_log(path)
    return analyze(path)


@pytest.fixture(scope="module")
def drawn(analysis: Analysis, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("cell") / "cell.rrd"
    analysis.run_to_rerun(RUN, path)
    return path


def columns(path: Path, entity: str) -> dict[str, list[Any]]:
    """Return what was logged on an entity, by component and without the lists around single values."""
    found: dict[str, list[Any]] = {}
    for chunk in RrdReader(path).stream().filter(content=entity):
        for name, values in chunk.to_record_batch().to_pydict().items():
            unpacked = [value[0] if isinstance(value, list) else value for value in values]
            found.setdefault(name.rpartition(":")[2], []).extend(unpacked)
    return found


def seconds(found: dict[str, list[Any]]) -> list[float]:
    return [time.total_seconds() for time in found["run_time"]]


def views(path: Path) -> list[str]:
    reader = RrdReader(path)
    (layout,) = reader.blueprints()
    name = "ViewBlueprint:class_identifier"
    batches = [chunk.to_record_batch() for chunk in reader.stream(store=layout)]
    return [batch.column(name)[0][0].as_py() for batch in batches if name in batch.schema.names]


def rerun(*arguments: str | Path) -> int:
    command = [str(Path(sys.executable).parent / "rerun"), "rrd", *map(str, arguments)]
    return subprocess.run(command, check=False, capture_output=True, timeout=120).returncode


def about(path: Path) -> str:
    return str(columns(path, "/about")["text"][0]).replace("\\", "")


def test_a_joint_turns_its_link_as_was_logged(drawn: Path) -> None:
    turn = columns(drawn, "/cell/joints/robot/turn")
    assert set(turn["parent_frame"]) == {"agent_robot/base"}
    assert set(turn["child_frame"]) == {"agent_robot/boom"}
    times = seconds(turn)
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(5.98)
    assert 100 < len(times) < 6 * 25 + 5
    half = np.array([math.sin(time) / 2 for time in times])
    np.testing.assert_allclose(
        turn["quaternion"], np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)], 1), atol=1e-6
    )
    np.testing.assert_allclose(turn["translation"], [[0, 0, 0.55]] * len(times), atol=1e-6)


def test_a_body_stands_on_its_base(drawn: Path) -> None:
    base = columns(drawn, "/cell/bases/robot")
    assert (base["parent_frame"], base["child_frame"]) == (["tf#/cell"], ["agent_robot/base"])
    assert base["translation"] == [pytest.approx([0, -0.5, 0])]
    assert base["quaternion"] == [pytest.approx([0, 0, math.sin(0.75), math.cos(0.75)])]
    assert columns(drawn, "/cell/bases/human")["child_frame"] == ["agent_human/base"]


def test_a_box_moves_as_was_logged(drawn: Path) -> None:
    cube = columns(drawn, "/cell/objects/cube")
    assert cube["half_sizes"] == [pytest.approx([0.05] * 3)]
    times = seconds(cube)
    assert (times[0], times[1], times[-1]) == (0.0, 2.0, 2.98)
    y = [translation[1] for translation in cube["translation"]]
    np.testing.assert_allclose(y, [0.0, *(time - 2 for time in times[1:])], atol=1e-6)


def test_areas_change_their_colour_with_the_safety_state(drawn: Path) -> None:
    far, near = (columns(drawn, f"/cell/areas/{name}") for name in ("far", "near"))
    assert seconds({"run_time": [time for time in far["run_time"] if time is not None]}) == [0.0, 2.0, 3.0]
    assert seconds({"run_time": [time for time in near["run_time"] if time is not None]}) == [0.0, 3.0, 4.0]
    assert len(set(near["colors"])) == 2


def test_the_view_of_the_cell_is_there_and_collision_shapes_are_not(drawn: Path, tmp_path: Path) -> None:
    assert sorted(views(drawn)).count("3D") == 1
    entities = {chunk.entity_path for chunk in RrdReader(drawn).stream()}
    assert "/cell/agent_robot/visual_geometries/base/visual_0" in entities
    assert not any("collision" in entity for entity in entities)
    without = tmp_path / "without.rrd"
    found = analyze(Path(__file__).parents[3] / "sample_logs" / "single.mcap")
    found.run_to_rerun(found.runs["run_id"][0], without)
    assert "3D" not in views(without)
    assert "Cell" not in about(without)
    assert "Cell" in about(drawn)


def test_scalar_signals_come_before_joints(drawn: Path) -> None:
    entities = [chunk.entity_path for chunk in RrdReader(drawn).stream() if chunk.entity_path.startswith("/signals/")]
    groups = list(dict.fromkeys(entity.split("/")[2] for entity in entities))
    assert groups == [
        "speed\\ scale",
        "minimum\\ distance\\ \\(m\\)",
        "overlap\\ so\\ far\\ \\(s\\)",
        "joints\\ of\\ human",
        "joints\\ of\\ robot",
    ]


def test_two_recordings_of_a_cell_are_equal(analysis: Analysis, drawn: Path, tmp_path: Path) -> None:
    again = tmp_path / "again.rrd"
    analysis.run_to_rerun(RUN, again)
    assert rerun("verify", again) == 0
    assert rerun("compare", "--unordered", drawn, again) == 0


NAMES = ("a/b", "..", "x\\", "机 器", "__properties", "R\u202e")


def test_names_with_slashes_stay_apart(tmp_path: Path) -> None:
    scene = cell_scene()
    scene["boxes"] = [scene["boxes"][0] | {"name": name} for name in NAMES]
    scene["areas"] = [scene["areas"][0] | {"name": name} for name in NAMES]
    scene["bases"] = [{"name": name, "position": [0, 0, 0]} for name in NAMES]
    link = ARM_URDF.replace('"boom"', '"a/b {}"')
    write_cell_log(tmp_path / "a.mcap", scene, dict.fromkeys(NAMES, link))
    analyze(tmp_path / "a.mcap").run_to_rerun(RUN, tmp_path / "a.rrd")
    entities = {chunk.entity_path for chunk in RrdReader(tmp_path / "a.rrd").stream()}
    for kind in ("objects", "bases"):
        assert len([entity for entity in entities if entity.startswith(f"/cell/{kind}/")]) == len(NAMES)
    assert rerun("verify", tmp_path / "a.rrd") == 0


def changed(**parts: object) -> bytes:
    return channels.encode_string(json.dumps(cell_scene() | parts))


BODY = channels.encode_string(ARM_URDF)
PAIR = "<robot><link name='a'/><link name='b'/>{}<parent link='a'/><child link='b'/></joint></robot>"
SLIDE = "<joint name='j' type='prismatic'><axis xyz='1e3 0 0'/>"
MIMIC = "<joint name='j' type='revolute'><mimic joint='ghost'/>"
HOSTILE: list[tuple[bytes, dict[str, bytes]]] = [
    (b"", {}),
    (b"\xff" * 50, {"robot": b"\xff" * 50}),
    (channels.encode_string("[" * 10_000), {"robot": channels.encode_string("<robot>" * 10_000)}),
    (changed(boxes=[{"name": "x", "size": [1e308] * 3, "position": [math.nan] * 3}]), {"robot": BODY}),
    (changed(boxes=7, areas={"a": 1}, fixtures="x", slots=None, bases=[[]]), {"": BODY}),
    (changed(areas=[{"name": "x", "low": [0, 0], "high": [1, 1], "kind": "red", "agent": "nobody"}]), {"robot": BODY}),
    (changed(boxes=[cell_scene()["boxes"][0] | {"name": f"{i}"} for i in range(1200)]), {}),
    (changed(), {f"robot {number}": BODY for number in range(12)}),
    (changed(schema_version=9), {"robot": channels.encode_string(PAIR.format(SLIDE))}),
    (changed(), {"robot": channels.encode_string(PAIR.format(MIMIC))}),
    (changed(), {"robot": channels.encode_string(ARM_URDF.replace('material name="blue"/', 'material name="ghost"/'))}),
    (changed(), {"robot": channels.encode_string(ARM_URDF.replace("box size", "capsule length='1' radius"))}),
    (changed(), {"robot": channels.encode_string(ARM_URDF.replace("0.3 0.3 0.5", "1e400 1 1"))}),
]


@pytest.mark.parametrize(("scene", "bodies"), HOSTILE, ids=range(len(HOSTILE)))
def test_a_hostile_scene_does_not_break_the_analysis(
    scene: bytes, bodies: dict[str, bytes], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    def fill(writer: FinishedWriter) -> None:
        writer.add(event_message(TaskStarted(time_ns=1, run_id=RUN, agent="robot", task="push", execution_id="e"), 1))
        writer.add(Message(channels.scene(RUN), 1, 1, scene))
        for agent, data in bodies.items():
            writer.add(Message(channels.description(agent, RUN), 1, 1, data))

    write_atomically(tmp_path / "a.mcap", fill)
    analysis = analyze(tmp_path / "a.mcap")
    assert {found.severity for found in analysis.diagnostics if found.code == "invalid_scene"} <= {"warning"}
    analysis.run_to_rerun(RUN, tmp_path / "a.rrd")
    assert views(tmp_path / "a.rrd")
    assert capfd.readouterr().err == ""
