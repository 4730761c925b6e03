"""JSON lines of signals, joints, poses and scenes make the messages that Python and the simulator make."""

from __future__ import annotations

import json
import math
import struct
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import ARM_URDF, cell_scene

from hrclog.events import COLUMNS
from hrclog.log.mcap.streamed import read_streamed
from hrclog.log.messages import channels
from hrclog.log.reader import read_logs
from hrclog.recorders.recorder import Recorder
from hrclog.recorders.sample_lines import SAMPLE_KINDS
from hrclog.recorders.stdin import Recording, record_stream

SAMPLES = Path(__file__).parents[2] / "sample_logs"
NOON = 1_772_452_800_000_000_000
Messages = dict[tuple[str, str, str], list[tuple[int, bytes]]]

NAMES = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=5).filter(str.strip)
NUMBERS = st.floats(-100, 100)
INSTANTS = st.integers(NOON, NOON + 10**12)
ROTATIONS = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda numbers: math.hypot(*numbers) > 0.01)


def messages(path: Path) -> Messages:
    """Return the instants and bytes of the messages of each topic, type and name, but for events."""
    data = path.read_bytes()
    contents = read_streamed(data)
    by_topic: Messages = defaultdict(list)
    for batch in contents.batches:
        columns = (batch.channel, batch.publish_time, batch.start, batch.end)
        for number, time_ns, start, end in zip(*(column.tolist() for column in columns), strict=True):
            channel = contents.channels[number]
            if channel.topic != channels.EVENTS_TOPIC:
                names = [channel.metadata[key] for key in ("agent", "object", "signal") if key in channel.metadata]
                key = channel.topic, contents.schemas[channel.schema_id].name, *names, *[""] * (1 - len(names))
                by_topic[key].append((time_ns, bytes(batch.data[start:end])))
    return dict(by_topic)


def line(**fields: object) -> str:
    return json.dumps(fields)


def as_lines(path: Path) -> Iterator[tuple[int, int, str]]:
    """Return the lines that another program would write of a log: instant, rank among those of it, line."""
    for row in read_logs([path]).events.sort("seq").iter_rows(named=True):
        given = {name: row[name] for name in COLUMNS if row[name] not in (None, "")}
        yield row["time_ns"], 1 if row["kind"] != "run_started" else 0, json.dumps(given)
    for (topic, _, name), samples in messages(path).items():
        for time_ns, data in samples:
            for fields in filter(None, [_fields(topic, name, data)]):
                yield time_ns, 1, line(**fields, time_ns=time_ns)


def _fields(topic: str, name: str, data: bytes) -> dict[str, Any]:
    last = topic.rsplit("/", maxsplit=1)[-1]
    if topic == channels.SCENE_TOPIC:
        return {"kind": "scene", "scene": json.loads(channels.decode_string(data))}
    if last == "description":
        return {"kind": "description", "agent": name, "urdf": channels.decode_string(data)}
    if last == "joint_states":
        names, begin, count = channels.joint_names(data)
        positions = struct.unpack_from(f"<{count}d", data, begin)
        return {"kind": "joints", "agent": name, "names": names, "positions": positions}
    if last == "pose":
        numbers = struct.unpack("<7d", data[-56:])
        return {"kind": "pose", "name": name, "position": numbers[:3], "quaternion": numbers[3:]}
    if topic.startswith("/hrc/signals/"):
        return {"kind": "signal", "name": name, "value": struct.unpack("<d", data[-8:])[0]}
    return {}


@pytest.mark.parametrize("name", ["cell_ssm.mcap", "cell_areas.mcap"])
def test_a_simulated_run_that_comes_as_lines_has_the_same_messages(name: str, tmp_path: Path) -> None:
    source, copy = SAMPLES / name, tmp_path / name
    lines = [text for *_, text in sorted(as_lines(source), key=lambda entry: entry[:2])]
    recording = record_stream(lines, copy)
    assert recording.refused == []
    before, after = messages(source), messages(copy)
    assert {topic.split("/")[-1] for topic, *_ in after} >= {"scene", "description", "joint_states", "pose"}
    assert {key: sorted(samples) for key, samples in after.items()} == {
        key: sorted(samples) for key, samples in before.items()
    }
    then, now = read_logs([source], signals=True), read_logs([copy], signals=True)
    assert now.scene.scenes.keys() == {recording.runs[0].run_id}
    [run_id] = then.scene.scenes
    seen, drawn = now.scene.of_run(recording.runs[0].run_id), then.scene.of_run(run_id)
    assert seen is not None
    assert drawn is not None
    assert (seen.scene, seen.descriptions) == (drawn.scene, drawn.descriptions)
    assert seen.poses.drop("run_id").sort(pl.all()).equals(drawn.poses.drop("run_id").sort(pl.all()))


@settings(max_examples=20)
@given(data=st.data())
def test_a_line_is_recorded_as_the_same_call_in_python_is(data: st.DataObject, tmp_path: Path) -> None:
    paths = tmp_path / "lines.mcap", tmp_path / "calls.mcap"
    for path in paths:
        path.unlink(missing_ok=True)
    time_ns, name = data.draw(INSTANTS), data.draw(NAMES)
    values = data.draw(st.dictionaries(NAMES, NUMBERS, min_size=1, max_size=3))
    position, rotation = data.draw(st.tuples(*[NUMBERS] * 3)), data.draw(ROTATIONS)
    as_lists = data.draw(st.booleans())
    joints = {"names": list(values), "positions": list(values.values())} if as_lists else {"values": values}
    lines = [
        line(kind="run_started", time_ns=NOON),
        line(kind="scene", scene=cell_scene(), time_ns=time_ns),
        line(kind="description", agent=name, urdf=ARM_URDF, time_ns=time_ns),
        line(kind="joints", agent=name, time_ns=time_ns, **joints),
        line(kind="pose", name=name, position=position, time_ns=time_ns),
        line(kind="pose", name=name, position=position, quaternion=rotation, time_ns=time_ns),
        line(kind="signal", values=values, time_ns=time_ns),
    ]
    recording = record_stream(lines, paths[0])
    assert recording.refused == []
    assert recording.runs[0].n_samples == 5 + len(values)
    with Recorder(paths[1], time_ns=NOON) as recorder:
        recorder.scene(cell_scene(), time_ns=time_ns)
        recorder.describe(name, ARM_URDF, time_ns=time_ns)
        recorder.joints(name, list(values), list(values.values()), time_ns=time_ns)
        recorder.pose(name, position, time_ns=time_ns)
        recorder.pose(name, position, rotation, time_ns=time_ns)
        for signal, value in values.items():
            recorder.signal(signal, value, time_ns=time_ns)
    assert messages(paths[0]) == messages(paths[1])


@pytest.mark.parametrize("yaw", [0, -1.5, math.pi, 7.0])
def test_a_yaw_turns_about_z(tmp_path: Path, yaw: float) -> None:
    rotation = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    [run] = recorded(tmp_path / "run.mcap", line(kind="pose", name="cube", position=[1, 2, 3], yaw=yaw)).runs
    poses = read_logs([run.path], signals=True).scene.poses
    assert poses.select("x", "y", "z", "qx", "qy", "qz", "qw").row(0) == pytest.approx((1, 2, 3, *rotation))


BAD = {
    "joints": [
        {},
        {"names": ["a"], "positions": [1]},
        {"agent": "r", "names": ["a"], "positions": [1, 2]},
        {"agent": "r", "names": [], "positions": []},
        {"agent": "r", "names": ["a", "a"], "positions": [1, 2]},
        {"agent": "r", "names": ["a"], "positions": [math.nan]},
        {"agent": "r", "names": ["a"], "positions": ["1"]},
        {"agent": "r", "names": ["\ud800"], "positions": [1]},
        {"agent": "r", "names": "a", "positions": "1"},
        {"agent": "r", "values": {"a": math.inf}},
        {"agent": "r", "values": {}},
        {"agent": "r", "values": {"a": 1}, "names": ["a"], "positions": [1]},
        {"agent": "r", "values": {"a": 1}, "velocities": [1]},
        {"agent": "r", "values": {"a": 1}, "time_ns": -1},
        {"agent": "r", "values": {"a": 1}, "time_ns": 2**62},
    ],
    "pose": [
        {},
        {"name": "cube"},
        {"name": "cube", "position": [1, 2]},
        {"name": "cube", "position": {"x": 1, "y": 2, "z": 3}},
        {"name": "cube", "position": [1, 2, math.nan]},
        {"name": "cube", "position": [1, 2, 1e5]},
        {"name": "cube", "position": [1, 2, 10**400]},
        {"name": "cube", "position": [1, 2, 3], "quaternion": [0, 0, 0, 0]},
        {"name": "cube", "position": [1, 2, 3], "quaternion": [0, 0, 0, 1e300]},
        {"name": "cube", "position": [1, 2, 3], "quaternion": [0, 0, 1]},
        {"name": "cube", "position": [1, 2, 3], "quaternion": [0, 0, 0, 1], "yaw": 1},
        {"name": "cube", "position": [1, 2, 3], "yaw": math.inf},
        {"name": " ", "position": [1, 2, 3]},
    ],
    "scene": [
        {},
        {"scene": []},
        {"scene": {}},
        {"scene": {"schema_version": 2}},
        {"scene": {"schema_version": 1, "boxes": [{"name": "cube"}]}},
        {"scene": {"schema_version": 1, "boxes": "cube"}},
        {"schema_version": 1},
    ],
    "description": [
        {},
        {"agent": "r"},
        {"agent": "r", "urdf": "arm.urdf"},
        {"agent": "r", "urdf": 5},
        {"agent": "", "urdf": ARM_URDF},
        {"agent": "r", "urdf": "<robot name='\ud800'/>"},
    ],
}  # fmt: skip


def recorded(path: Path, *lines: str) -> Recording:
    return record_stream([line(kind="run_started", time_ns=NOON), *lines], path)


@pytest.mark.parametrize("kind", BAD)
def test_a_sample_that_is_none_is_refused_by_its_number_alone(kind: str, tmp_path: Path) -> None:
    good = line(kind="signal", name="force", value=1)
    lines = [text for fields in BAD[kind] for text in (line(kind=kind, **fields), good)]
    recording = recorded(tmp_path / "run.mcap", *lines)
    assert [entry.line for entry in recording.refused] == list(range(2, len(lines) + 2, 2))
    assert recording.runs[0].n_samples == len(BAD[kind])
    assert all(len(entry.reason) < 400 for entry in recording.refused)


@pytest.mark.parametrize("kind", BAD)
def test_a_first_line_that_is_no_sample_writes_nothing(kind: str, tmp_path: Path) -> None:
    bad = [line(kind=kind, **fields) for fields in BAD[kind]]
    recording = record_stream([*bad, line(kind="heartbeat", time_ns=NOON)], tmp_path / "run.mcap")
    assert [entry.line for entry in recording.refused] == list(range(1, len(bad) + 1))


def test_a_scene_and_a_description_are_told_once_at_any_place(tmp_path: Path) -> None:
    scene, pose = line(kind="scene", scene=cell_scene()), line(kind="pose", name="cube", position=[0, 0, 1])
    bodies = [line(kind="description", agent=agent, urdf=ARM_URDF) for agent in ("robot", "other", "robot")]
    recording = recorded(tmp_path / "run.mcap", pose, scene, *bodies, pose, scene)
    assert [(entry.line, "a second time" in entry.reason) for entry in recording.refused] == [(6, True), (8, True)]
    [run] = recording.runs
    cell = read_logs([run.path], signals=True).scene.of_run(run.run_id)
    assert cell is not None
    assert (len(cell.scene.boxes), cell.descriptions.keys(), cell.poses.height) == (1, {"robot", "other"}, 2)


def test_a_pose_of_a_body_that_the_scene_lacks_is_recorded_and_told(tmp_path: Path) -> None:
    poses = [line(kind="pose", name=name, position=[0, 0, 1]) for name in ("cube", "cub")]
    [run] = recorded(tmp_path / "run.mcap", *poses, line(kind="scene", scene=cell_scene())).runs
    assert [("'cub'" in remark, "'cube'" in remark) for remark in run.remarks] == [(True, False)]
    [alone] = recorded(tmp_path / "alone.mcap", *poses).runs  # without a scene nothing is drawn anyway
    assert (run.n_samples, alone.n_samples, alone.remarks) == (3, 2, ())


def test_the_page_on_recording_names_every_kind_and_field() -> None:
    page = (Path(__file__).parents[2] / "docs" / "recording.md").read_text()
    for name, kind in SAMPLE_KINDS.items():
        for field in (name, *kind.fields):
            assert f"`{field}`" in page, f"{name}: {field}"


def test_of_signals_that_do_not_fit_none_is_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hrclog.log.writing.journal._MAX_CHANNELS", 4)
    many = line(kind="signal", values={f"signal {number}": 1 for number in range(5)})
    recording = recorded(tmp_path / "run.mcap", many, line(kind="signal", name="force", value=1))
    assert [(entry.line, "use fewer names" in entry.reason) for entry in recording.refused] == [(2, True)]
    assert recording.runs[0].n_samples == 1
