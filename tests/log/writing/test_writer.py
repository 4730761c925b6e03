"""Finished logs: what was written is read, whole or not at all."""

from __future__ import annotations

import struct
from pathlib import Path

import polars as pl
import pytest
from event_strategies import EVENTS
from folders import names_in
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.errors import InvalidEventError, LogExistsError, LogWriteError
from hrclog.event_rows import from_row, to_row
from hrclog.events import COLUMNS, Event, Heartbeat, RunStarted, TaskEnded, TaskStarted
from hrclog.log.logs import ORDER
from hrclog.log.mcap.indexed import read_indexed
from hrclog.log.messages.channels import encode_joints, joint_names
from hrclog.log.messages.encode import FloatSignal, JointSignal
from hrclog.log.messages.message import EVENTS as COLUMN_TYPES
from hrclog.log.never_set import without_unset
from hrclog.log.reader import read_logs
from hrclog.log.writing.writer import write_log

RUN_EVENTS = st.lists(EVENTS, min_size=1, max_size=8)
STARTED = TaskStarted(time_ns=5, run_id="r", agent="robot", task="pick", execution_id="e")
ENDED = TaskEnded(time_ns=7, run_id="r", agent="robot", task="pick", execution_id="e")


@settings(max_examples=50)
@given(RUN_EVENTS, st.lists(st.sampled_from(["r1", "r2"]), min_size=8, max_size=8))
def test_a_log_gives_its_events_back_numbered_per_run(tmp_path: Path, events: list[Event], run_ids: list[str]) -> None:
    path = tmp_path / "a.mcap"
    path.unlink(missing_ok=True)
    rows = [to_row(event) | {"run_id": run_id} for event, run_id in zip(events, run_ids, strict=False)]
    write_log(path, map(from_row, rows))
    logs = read_logs(path)
    for index, row in enumerate(rows):
        row["seq"] = sum(before["run_id"] == row["run_id"] for before in rows[:index])
    expected = pl.DataFrame(rows, schema={name: COLUMN_TYPES[name] for name in COLUMNS}).sort(ORDER)
    floats = [name for name in COLUMNS if COLUMN_TYPES[name] == pl.Float64]
    finite = expected.with_columns(pl.when(pl.col(name).is_finite()).then(pl.col(name)).alias(name) for name in floats)
    believed, _ = without_unset(finite.with_columns(path=pl.lit("")))
    assert logs.events.select(COLUMNS).equals(believed.select(COLUMNS))
    assert logs.events["path"].unique().to_list() == [str(path)]
    allowed = {"time_not_monotonic", "non_finite_value", "conflicting_runs", "never_set", "doubtful_speed"}
    assert {diagnostic.code for diagnostic in logs.diagnostics} <= allowed


def test_a_finished_log_is_indexed_and_carries_the_run_facts(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write_log(path, [RunStarted(time_ns=1, run_id="r", name="Müller", agents=("a", "b")), STARTED, ENDED])
    contents = read_indexed(path.read_bytes())
    assert contents.metadata[0].name == "hrclog.run"
    assert contents.metadata[0].metadata == {"run_id": "r", "name": "Müller", "segment": "1", "agents": "a\nb"}
    assert contents.header is not None
    assert contents.header.profile == "ros2"


def test_signals_come_back_by_name_and_time(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    floats = [FloatSignal("r", "distance to hand", 10, 0.5), FloatSignal("r", "distance_to_hand", 11, 0.25)]
    joints = JointSignal("r", "robot", 12, ("shoulder", "ell bow"), (1.5, -2.0))
    write_log(path, [STARTED], [*floats, joints])
    assert read_logs(path, signals=True).signals.rows() == [
        ("r", "distance to hand", 10, 0.5),
        ("r", "distance_to_hand", 11, 0.25),
        ("r", "robot/ell bow", 12, -2.0),
        ("r", "robot/shoulder", 12, 1.5),
    ]
    assert read_logs(path).signals.is_empty()


def test_signals_of_two_runs_in_one_file_keep_their_runs(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write_log(
        path,
        [Heartbeat(time_ns=1, run_id="r1"), Heartbeat(time_ns=1, run_id="r2")],
        [FloatSignal("r1", "x", 1, 1.0), FloatSignal("r2", "x", 2, 2.0)],
    )
    assert read_logs(path, signals=True).signals.rows() == [("r1", "x", 1, 1.0), ("r2", "x", 2, 2.0)]


@given(st.lists(st.tuples(st.text(max_size=6), st.floats()), max_size=5), st.integers(0, 2**31 * 10**9 - 1))
def test_joints_survive_whatever_their_names(joints: list[tuple[str, float]], time_ns: int) -> None:
    names, positions = [name.rstrip("\0") for name, _ in joints], [position for _, position in joints]
    message = encode_joints(time_ns, names, positions)
    names_read, begin, count = joint_names(message)
    assert names_read == names
    assert repr(struct.unpack_from(f"<{count}d", message, begin)) == repr(tuple(positions))


def test_existing_logs_are_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_text("precious")
    with pytest.raises(LogExistsError, match="exists already, not overwriting it"):
        write_log(path, [STARTED])
    assert path.read_text() == "precious"


def test_an_event_that_cannot_be_written_leaves_no_file_behind(tmp_path: Path) -> None:
    with pytest.raises(InvalidEventError):
        write_log(tmp_path / "a.mcap", [STARTED, Heartbeat(time_ns=2, details={"x": float("nan")})])
    assert names_in(tmp_path) == []


def test_a_folder_that_is_not_there_is_said_so(tmp_path: Path) -> None:
    with pytest.raises(LogWriteError, match=r"a.mcap: cannot be written \(No such file or directory\)"):
        write_log(tmp_path / "nowhere" / "a.mcap", [STARTED])


def test_a_name_as_long_as_the_file_system_allows_is_fine(tmp_path: Path) -> None:
    path = tmp_path / ("n" * 250 + ".mcap")
    write_log(path, [STARTED])
    assert names_in(tmp_path) == [path.name]


def test_the_same_events_give_the_same_bytes(tmp_path: Path) -> None:
    for name in "ab":
        write_log(tmp_path / f"{name}.mcap", [STARTED, ENDED], [FloatSignal("r", "x", 1, 2.0)])
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()
