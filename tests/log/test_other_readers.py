"""Finished logs as others see them: mcap, rosbags and Rerun read equal content; and bags that carry our events."""

from __future__ import annotations

import json
import sqlite3
import struct
import subprocess
import sys
from collections import Counter
from contextlib import closing
from pathlib import Path
from typing import Any, Literal

import polars as pl
import pytest
from mcap.reader import make_reader
from rerun.chunk import RrdReader
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore
from scenes import ARM_URDF, cell_scene

from hrclog.errors import LogReadError
from hrclog.event_rows import to_row
from hrclog.events import COLUMNS, FLOAT_COLUMNS, INT_COLUMNS, Event, Heartbeat
from hrclog.log.messages.channels import encode_pose, encode_string
from hrclog.log.messages.message import DEFINITION, TYPE_NAME, encode_row
from hrclog.log.reader import read_logs
from hrclog.recorders.recorder import Recorder

T0 = 1_700_000_000 * 10**9


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recorded log with every kind of channel and names of many scripts."""
    ticks = iter(range(T0, T0 + 10**12, 1000))
    path = tmp_path_factory.mktemp("log") / "run.mcap"
    with Recorder(path, "läuft 🦾", agents=["robot", "Müller, Ana"], clock_ns=lambda: next(ticks)) as recorder:
        recorder.scene(cell_scene())
        recorder.describe("robot", ARM_URDF)
        for i in range(30):
            with recorder.task("robot", f"pick {i}", details={"grip": i / 7}) as task:
                task.pause("safety")
                task.resume()
            recorder.start("Müller, Ana", "看", planned_start_ns=T0, planned_end_ns=T0 + 5).end(
                "failed", path_length=1 / 3
            )
            recorder.signal("distance to hand", i / 10)
            recorder.joints("robot", ["a", "bb"], [i / 3, -i])
            recorder.pose("cube", (i / 7, -1, 0.5), (0, 0, 0.6, 0.8))
        recorder.safety("robot", "reduced", 0.25, "table")
        recorder.annotate("well done")
    return path


@pytest.fixture(scope="module")
def frame(log: Path) -> pl.DataFrame:
    logs = read_logs(log)
    assert logs.diagnostics == []
    return logs.events


@pytest.fixture(scope="module")
def store() -> Typestore:
    store = get_typestore(Stores.LATEST)
    store.register(get_types_from_msg(DEFINITION, TYPE_NAME))
    return store


def _unset(row: dict[str, Any]) -> dict[str, Any]:
    """Return a row of our frame as the wire has it."""
    numbers = dict.fromkeys(INT_COLUMNS, -(2**63)) | dict.fromkeys(FLOAT_COLUMNS, "nan")
    return {name: numbers[name] if row[name] is None else row[name] for name in COLUMNS}


def _fields(message: object) -> dict[str, Any]:
    values = {name: getattr(message, name) for name in COLUMNS}
    return {name: "nan" if value != value else value for name, value in values.items()}  # noqa: PLR0124 - NaN


def test_mcap_reads_every_message_with_valid_checksums(log: Path, frame: pl.DataFrame) -> None:
    with log.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        messages = list(reader.iter_messages(log_time_order=False))
        header = reader.get_header()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == len(messages)
    assert header.profile == "ros2"
    topics = Counter(channel.topic for _, channel, _ in messages)
    assert topics["/hrc/events"] == frame.height
    assert topics["/hrc/agents/robot/active_task"] == topics["/hrc/agents/robot/joint_states"] * 2 == 60
    assert len(topics) == 8
    rows = [_unset(row) for row in frame.iter_rows(named=True)]
    for row, (schema, channel, message) in zip(rows, messages, strict=False):
        assert schema is not None
        assert (channel.topic, schema.name, schema.encoding) == ("/hrc/events", TYPE_NAME, "ros2msg")
        assert message.publish_time == row["time_ns"]
        assert message.sequence == row["seq"]
    lanes = [message.data[8:-1].decode() for _, channel, message in messages if channel.topic.endswith("/active_task")]
    assert lanes[:4] == ["pick 0", "", "看", ""]


def test_rosbags_decodes_equal_fields_by_the_definitions_in_the_file(log: Path, frame: pl.DataFrame) -> None:
    with AnyReader([log]) as reader:
        decoded = [
            (connection.topic, reader.deserialize(raw, connection.msgtype)) for connection, _, raw in reader.messages()
        ]
    events: list[Any] = [message for topic, message in decoded if topic == "/hrc/events"]
    events.sort(key=lambda message: message.seq)
    assert [_fields(message) for message in events] == [_unset(row) for row in frame.iter_rows(named=True)]
    joints: list[Any] = [message for topic, message in decoded if topic.endswith("/joint_states")]
    assert [(message.name, message.position.tolist()) for message in joints] == [
        (["a", "bb"], [i / 3, -i]) for i in range(30)
    ]
    poses: list[Any] = [message for topic, message in decoded if topic == "/hrc/objects/cube/pose"]
    assert [message.pose.position.x for message in poses] == [i / 7 for i in range(30)]
    assert {(message.pose.orientation.z, message.pose.orientation.w) for message in poses} == {(0.6, 0.8)}
    assert {message.header.frame_id for message in poses} == {"world"}
    stamps = [message.header.stamp.sec * 10**9 + message.header.stamp.nanosec for message in poses]
    assert stamps == read_logs(log, signals=True).scene.poses["time_ns"].to_list()
    texts: dict[str, Any] = dict(decoded)
    assert texts["/hrc/agents/robot/description"].data == ARM_URDF
    assert json.loads(texts["/hrc/scene"].data) == cell_scene()
    distances: list[Any] = [message for topic, message in decoded if topic.startswith("/hrc/signals/")]
    assert [message.data for message in distances] == [i / 10 for i in range(30)]


def test_rerun_has_as_many_rows_as_there_are_messages(log: Path, tmp_path: Path) -> None:
    recording = tmp_path / "run.rrd"
    rerun = Path(sys.executable).with_name("rerun")
    subprocess.run([rerun, "mcap", "convert", log, "-o", recording], check=True, capture_output=True)
    rows: Counter[str] = Counter()
    for chunk in RrdReader(recording).stream().to_chunks():
        if "message_log_time" in chunk.timeline_names:
            rows[chunk.entity_path] += chunk.num_rows
    with log.open("rb") as stream:
        messages = Counter(channel.topic for _, channel, _ in make_reader(stream).iter_messages())
    # Rerun lays out the parts of a joint state as further entities below its topic, and adds what else it understands
    assert {topic: rows[topic] for topic in messages} == messages
    assert {entity for entity in rows if entity not in messages} == {
        f"/hrc/agents/robot/joint_states/{part}" for part in ("position", "velocity", "effort")
    }


def _event_messages(log: Path) -> list[tuple[int, bytes]]:
    with log.open("rb") as stream:
        return [(message.log_time, message.data) for _, _, message in make_reader(stream).iter_messages("/hrc/events")]


@pytest.mark.parametrize("plugin", list(StoragePlugin))
@pytest.mark.parametrize("version", [8, 9])  # 9 carries definitions
def test_a_ros_2_bag_of_our_channel_gives_equal_events(
    log: Path, frame: pl.DataFrame, tmp_path: Path, plugin: StoragePlugin, store: Typestore, version: Literal[8, 9]
) -> None:
    bag = tmp_path / "bag"
    with Writer2(bag, version=version, storage_plugin=plugin) as writer:
        connection = writer.add_connection("/cell/facts", TYPE_NAME, typestore=store)
        for log_time, data in _event_messages(log):
            writer.write(connection, log_time + 7, data)
    logs = read_logs(bag)
    assert {diagnostic.code for diagnostic in logs.diagnostics} <= {"unprotected"}  # as rosbags writes MCAP
    assert logs.events.drop("path", "log_time_ns").equals(frame.drop("path", "log_time_ns"))
    assert read_logs(tmp_path).events.equals(logs.events)


def test_a_ros_2_bag_without_definitions_is_taken_to_hold_our_layout(
    log: Path, frame: pl.DataFrame, tmp_path: Path, store: Typestore
) -> None:
    bag = tmp_path / "bag"
    with Writer2(bag, version=9) as writer:
        connection = writer.add_connection("/hrc/events", TYPE_NAME, typestore=store)
        for log_time, data in _event_messages(log):
            writer.write(connection, log_time, data)
    with closing(sqlite3.connect(bag / "bag.db3")) as database:
        database.execute("delete from message_definitions")
        database.commit()
    logs = read_logs(bag)
    assert [diagnostic.code for diagnostic in logs.diagnostics] == ["unprotected", "assumed_definition"]
    assert logs.events.drop("path", "log_time_ns").equals(frame.drop("path", "log_time_ns"))


def test_a_ros_2_bag_gives_signals_and_ignores_other_topics(log: Path, tmp_path: Path, store: Typestore) -> None:
    with Writer2(tmp_path / "bag", version=9) as writer:
        events = writer.add_connection("/hrc/events", TYPE_NAME, typestore=store)
        speed = writer.add_connection("/hrc/signals/speed", "std_msgs/msg/Float64", typestore=store)
        other = writer.add_connection("/speed", "std_msgs/msg/Float64", typestore=store)
        scene = writer.add_connection("/hrc/scene", "std_msgs/msg/String", typestore=store)
        chatter = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=store)
        pose = writer.add_connection("/hrc/objects/cube/pose", "geometry_msgs/msg/PoseStamped", typestore=store)
        writer.write(events, T0, _event_messages(log)[0][1])
        writer.write(speed, T0 + 1, b"\0\1\0\0" + struct.pack("<d", 0.5))
        writer.write(other, T0 + 2, b"\0\1\0\0" + struct.pack("<d", 0.5))
        for text in (scene, chatter):
            writer.write(text, T0 + 3, encode_string(json.dumps(cell_scene())))
        writer.write(pose, T0 + 4, encode_pose(T0 + 4, (1, 2, 3), (0, 0, 0, 1)))
    logs = read_logs(tmp_path / "bag", signals=True)
    run_id = logs.events["run_id"][0]
    assert logs.signals.rows() == [(run_id, "speed", T0 + 1, 0.5)]
    cell = logs.scene.of_run(run_id)
    assert cell is not None
    assert [box.name for box in cell.scene.boxes] == ["cube"]
    assert cell.poses.rows() == [(run_id, "cube", T0 + 4, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)]
    assert read_logs(tmp_path / "bag").signals.is_empty()


def test_a_ros_1_bag_of_our_channel_gives_equal_events(
    log: Path, frame: pl.DataFrame, tmp_path: Path, store: Typestore
) -> None:
    bag = tmp_path / "run.bag"
    with Writer1(bag) as writer:
        connection = writer.add_connection("/hrc/events", TYPE_NAME, typestore=store)
        for log_time, data in _event_messages(log):
            writer.write(connection, log_time + 7, bytes(store.cdr_to_ros1(data, TYPE_NAME)))
    logs = read_logs(bag)
    assert [found.code for found in logs.diagnostics] == ["unprotected"]
    assert logs.events.drop("path", "log_time_ns").equals(frame.drop("path", "log_time_ns"))


def test_a_bag_with_a_layout_of_its_own_gives_equal_events(frame: pl.DataFrame, tmp_path: Path) -> None:
    lines = [line for line in DEFINITION.splitlines() if line.split("#")[0].strip()]
    own = get_typestore(Stores.LATEST)
    own.register(get_types_from_msg("float32 extra\n" + "\n".join(reversed(lines)), TYPE_NAME))
    with Writer2(tmp_path / "bag", version=9) as writer:
        connection = writer.add_connection("/hrc/events", TYPE_NAME, typestore=own)
        for row in frame.iter_rows(named=True):
            values = _unset(row)
            floats = {name: float(values[name]) for name in FLOAT_COLUMNS}
            message = own.types[TYPE_NAME](extra=1.0, **(values | floats))
            writer.write(connection, T0, bytes(own.serialize_cdr(message, TYPE_NAME)))
    logs = read_logs(tmp_path / "bag")
    assert [found.code for found in logs.diagnostics] == ["unprotected"]
    assert logs.events.drop("path", "log_time_ns").equals(frame.drop("path", "log_time_ns"))


def test_a_bag_with_a_damaged_message_gives_the_others(tmp_path: Path, store: Typestore) -> None:
    beats: list[Event] = [Heartbeat(time_ns=T0, run_id="r"), Heartbeat(time_ns=T0, run_id="r", seq=2)]
    with Writer2(tmp_path / "bag", version=9) as writer:
        connection = writer.add_connection("/hrc/events", TYPE_NAME, typestore=store)
        for data in (encode_row(to_row(beats[0])), b"\0\1\0\0junk", encode_row(to_row(beats[1]))):
            writer.write(connection, T0, data)
    logs = read_logs(tmp_path / "bag")
    assert logs.events["seq"].to_list() == [0, 2]
    assert [diagnostic.code for diagnostic in logs.diagnostics] == [
        "unprotected",
        "undecodable_event",
        "events_missing",
    ]


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("bag/metadata.yaml", "a folder with metadata.yaml and no part of a bag"),
        ("run.bag", "a file that begins with b'nonsense'"),
    ],
)
def test_a_bag_that_cannot_be_opened_is_refused(tmp_path: Path, name: str, what: str) -> None:
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_text("nonsense: [")
    bag = path.parent if path.name == "metadata.yaml" else path
    with pytest.raises(LogReadError, match=what):
        read_logs(bag)


def test_a_bag_without_our_topic_is_said_to_carry_no_events(tmp_path: Path, store: Typestore) -> None:
    with Writer2(tmp_path / "bag", version=9) as writer:
        connection = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=store)
        writer.write(connection, T0, b"\0\1\0\0\2\0\0\0a\0")
    logs = read_logs(tmp_path / "bag", signals=True)
    assert [diagnostic.code for diagnostic in logs.diagnostics] == ["unprotected", "no_events"]
