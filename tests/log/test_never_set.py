"""Zeros that a node leaves in fields that it never sets."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

import polars as pl
import pytest
from clock_runs import BEGIN, HUMAN, SECOND, Written, run, write
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer

import hrclog
from hrclog.diagnostic import Diagnostic
from hrclog.event_rows import to_row
from hrclog.events import SafetyStateChanged
from hrclog.log.logs import Logs
from hrclog.log.messages.definitions import Definition
from hrclog.log.messages.message import DEFINITION, EVENTS, TYPE_NAME, encode_row
from hrclog.log.never_set import check_speeds, with_numbers, without_unset
from hrclog.log.reader import read_logs
from hrclog.log.recover import recover

PLANNED = ("planned_start_ns", "planned_end_ns")
ZEROS = dict.fromkeys((*PLANNED, "agent_time_ns", "attempt"), 0) | dict.fromkeys(
    ("planned_duration_s", "planning_time_s", "path_length", "speed_scale"), 0.0
)
MONTH = 30 * 86_400 * SECOND


def codes(logs: Logs) -> list[str]:
    return [finding.code for finding in logs.diagnostics]


def test_fields_that_ros_initialised_count_as_unset_with_one_warning(tmp_path: Path) -> None:
    logs = read_logs(write(tmp_path / "a.mcap", run(), **ZEROS))
    assert codes(logs) == ["never_set"]
    for name in ZEROS:
        assert name in logs.diagnostics[0].message
    tasks = logs.events.filter(pl.col("kind").str.starts_with("task_"))
    assert tasks["attempt"].unique().to_list() == [1]
    for name in ZEROS:
        assert name == "attempt" or logs.events[name].null_count() == logs.events.height, name


def test_nothing_is_late_that_was_never_planned(tmp_path: Path) -> None:
    analysis = hrclog.analyze(write(tmp_path / "a.mcap", run(), **ZEROS))
    assert analysis.metrics.filter(pl.col("metric").str.contains("late")).is_empty()
    assert analysis.intervals["planned_duration_s"].null_count() == analysis.intervals.height
    plain = hrclog.analyze(write(tmp_path / "b.mcap", run()))
    assert analysis.metrics.equals(plain.metrics)
    assert analysis.synergies.equals(plain.synergies)


@settings(max_examples=30)
@given(st.integers(-(2**61), 2**61), st.sampled_from(PLANNED))
def test_a_planned_instant_counts_if_it_is_near_its_event(planned: int, name: str) -> None:
    event = pl.DataFrame([{"time_ns": BEGIN, name: planned, "kind": "task_started"}], schema=EVENTS)
    found, diagnostics = without_unset(event)
    near = abs(planned - BEGIN) <= MONTH
    assert found[name].to_list() == [planned if near else None]
    assert [finding.code for finding in diagnostics] == ([] if near else ["never_set"])


def test_in_simulated_time_zero_is_an_instant_unless_all_of_the_plan_is_zero() -> None:
    rows = [
        {"time_ns": 0, "planned_start_ns": 0, "planned_end_ns": 5, "planned_duration_s": 0.0},
        {"time_ns": 0, "planned_start_ns": 0, "planned_end_ns": 0, "planned_duration_s": 0.0},
    ]
    found, _ = without_unset(pl.DataFrame(rows, schema=EVENTS))
    assert found.select(*PLANNED, "planned_duration_s").rows() == [(0, 5, 0.0), (None, None, None)]


@pytest.mark.parametrize(
    "forgot",
    [lambda _: True, lambda event: event.kind == "task_ended", lambda event: getattr(event, "agent", "") == HUMAN],
)
def test_an_event_whose_time_is_0_happened_when_it_was_received(tmp_path: Path, forgot: Any) -> None:  # noqa: ANN401 - a function
    events = run(tasks=4)
    zeros = [
        Written(replace(entry.event, time_ns=0) if forgot(entry.event) else entry.event, entry.log_time)
        for entry in events
    ]
    logs = read_logs(write(tmp_path / "a.mcap", zeros))
    assert codes(logs) == ["never_set"]
    count = sum(forgot(entry.event) for entry in events)
    assert f"time_ns in {count} events: 0" in logs.diagnostics[0].message
    assert logs.events.drop("path").equals(read_logs(write(tmp_path / "b.mcap", events)).events.drop("path"))


def test_zeros_beside_a_time_of_0_are_judged_by_the_time_of_receipt(tmp_path: Path) -> None:
    logs = read_logs(write(tmp_path / "a.mcap", run(), **ZEROS, time_ns=0, seq=0))
    assert codes(logs) == ["never_set", "seq_never_set"]
    assert all(logs.events[name].null_count() == logs.events.height for name in PLANNED)


@pytest.mark.parametrize("times", [[0, 5 * SECOND, 9 * SECOND], [0], [0, -SECOND]])
def test_in_simulated_time_0_is_an_instant_whatever_the_log_time(times: list[int]) -> None:
    rows = [{"time_ns": time, "log_time_ns": BEGIN, "run_id": "r", "kind": "heartbeat"} for time in times]
    found, diagnostics = without_unset(pl.DataFrame(rows, schema=EVENTS))
    assert found["time_ns"].to_list() == times
    assert diagnostics == []


def test_planned_values_beside_instants_that_are_near_stay(tmp_path: Path) -> None:
    planned = dict.fromkeys(PLANNED, BEGIN) | {"planned_duration_s": 0.0, "path_length": 0.0}
    logs = read_logs(write(tmp_path / "a.mcap", run(), **planned))
    assert codes(logs) == []
    assert logs.events["path_length"].to_list() == [0.0] * logs.events.height


def test_floats_that_are_all_zero_were_never_set_though_instants_are_unset(tmp_path: Path) -> None:
    floats = dict.fromkeys(("planned_duration_s", "planning_time_s", "path_length", "speed_scale"), 0.0)
    logs = read_logs(write(tmp_path / "a.mcap", run(), **floats))
    assert codes(logs) == ["never_set"]
    assert "planned_start_ns" not in logs.diagnostics[0].message
    assert all(logs.events[name].null_count() == logs.events.height for name in floats)


def test_a_seq_that_is_always_zero_was_never_set(tmp_path: Path) -> None:
    events = run(tasks=3)
    logs = read_logs(write(tmp_path / "a.mcap", events, seq=0))
    numbered = read_logs(write(tmp_path / "b.mcap", events))
    assert codes(logs) == ["seq_never_set"]
    assert logs.events.drop("path").equals(numbered.events.drop("path"))


def test_events_of_one_instant_without_numbers_stay_in_the_order_of_writing(tmp_path: Path) -> None:
    events = [Written(entry.event, BEGIN) for entry in run(tasks=4)]
    logs = read_logs(write(tmp_path / "a.mcap", events, seq=0, time_ns=BEGIN))
    executions = hrclog.intervals(logs.events)
    assert set(executions["outcome"]) == {"succeeded"}
    assert executions.height == 8


@pytest.mark.parametrize("seqs", [[0], [0, 1, 2], [0, 0, 1]])
def test_numbers_that_differ_are_believed(seqs: list[int]) -> None:
    frame = pl.DataFrame({"run_id": ["r"] * len(seqs), "seq": seqs}, schema={"run_id": pl.String, "seq": pl.Int64})
    found, diagnostics = with_numbers(frame.with_columns(path=pl.lit("p"), kind=pl.lit("heartbeat")))
    assert found["seq"].to_list() == seqs
    assert diagnostics == []


UNSET = -(2**63)


def write_bare(path: Path, events: list[Written], sequences: list[int], topics: int = 1, **columns: int) -> Path:
    """Write events as nodes that leave `seq` unset, each message with a number that its recorder or publisher gave."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="test")
        schema = writer.register_schema(TYPE_NAME, "ros2msg", DEFINITION.encode())
        channels = [writer.register_channel(f"/cell_{topic}/hrc/events", "cdr", schema) for topic in range(topics)]
        for entry, sequence in zip(events, sequences, strict=True):
            row = to_row(entry.event) | {"seq": UNSET} | columns
            channel = channels[len(getattr(entry.event, "agent", "")) % topics]
            writer.add_message(channel, entry.log_time, encode_row(row), entry.log_time, sequence)
        writer.finish()
    return path


def per_publisher(events: list[Written]) -> list[int]:
    agents = [getattr(entry.event, "agent", "") for entry in events]
    return [agents[:at].count(agent) for at, agent in enumerate(agents)]


@pytest.mark.parametrize("topics", [1, 3])
@pytest.mark.parametrize("number", [lambda n: [0] * n, lambda n: range(1, n + 1), lambda n: range(500, n + 500), None])
def test_numbers_of_messages_are_no_numbers_of_events(tmp_path: Path, topics: int, number: Any) -> None:  # noqa: ANN401 - a function
    events = run(tasks=3)
    sequences = per_publisher(events) if number is None else list(number(len(events)))
    logs = read_logs(write_bare(tmp_path / "a.mcap", events, sequences, topics))
    assert logs.diagnostics == []
    assert logs.events["seq"].to_list() == list(range(len(events)))
    assert logs.events.drop("path").equals(read_logs(write(tmp_path / "b.mcap", events)).events.drop("path"))


@settings(max_examples=15)
@given(st.lists(st.integers(1, 37), max_size=12, unique=True), st.randoms())
def test_files_of_a_run_without_numbers_are_in_the_order_of_writing_whatever_their_names(
    cuts: list[int], chance: Random
) -> None:
    events = run(tasks=9)
    places = [0, *sorted(cuts), len(events)]
    names = [f"b_{number}.mcap" for number in range(len(places))]
    chance.shuffle(names)
    with TemporaryDirectory() as folder:
        for name, (begin, end) in zip(names, pairwise(places), strict=False):
            write_bare(Path(folder, name), events[begin:end], list(range(end - begin)))
        logs = read_logs(folder)
    assert logs.diagnostics == []
    assert logs.events["seq"].to_list() == list(range(len(events)))


def test_a_file_is_in_the_order_of_writing_though_a_clock_was_put_back() -> None:
    times = [5, 6, 7, 1, 2, 4]
    frame = pl.DataFrame({"seq": [None] * 6, "log_time_ns": times}, schema={"seq": pl.Int64, "log_time_ns": pl.Int64})
    frame = frame.with_columns(run_id=pl.lit("r"), path=pl.Series(["a"] * 5 + ["b"]))
    assert with_numbers(frame)[0]["seq"].to_list() == [1, 2, 3, 4, 5, 0]


def test_numbers_that_were_given_are_checked_though_others_are_not_there(tmp_path: Path) -> None:
    events = run(tasks=4)
    write(tmp_path / "robot.mcap", [entry for entry in events if getattr(entry.event, "agent", "") != HUMAN][:-3])
    mine = [entry for entry in events if getattr(entry.event, "agent", "") == HUMAN]
    write_bare(tmp_path / "human.mcap", mine, [0] * len(mine))
    logs = read_logs(tmp_path)
    assert [finding.code for finding in logs.diagnostics if finding.severity == "error"] == ["events_missing"]
    assert logs.events["seq"].to_list() == list(range(logs.events.height))


def test_proto3_json_leaves_the_number_0_out(tmp_path: Path) -> None:
    events = run(tasks=2)
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/hrc/events", "json", 0)
        for entry in events:
            row = {name: value for name, value in to_row(entry.event).items() if value not in (None, "", 0)}
            writer.add_message(channel, entry.log_time, json.dumps(row).encode(), entry.log_time, 7)
        writer.finish()
    logs = read_logs(tmp_path)
    assert logs.diagnostics == []
    assert logs.events["seq"].to_list() == list(range(len(events)))


def test_a_recovered_run_without_numbers_remembers_its_loss(tmp_path: Path) -> None:
    whole = write_bare(tmp_path / "a.mcap", run(tasks=2), [0] * 10)
    whole.write_bytes(whole.read_bytes()[:-60])
    logs = read_logs(recover(whole).path)
    assert "recovered_with_losses" in codes(logs)
    assert logs.events["kind"].to_list().count("annotation_added") == 1
    assert sorted(logs.events["seq"]) == list(range(11))


def doubts(mode: str, scale: float | None, kind: str = "safety_state_changed") -> list[Diagnostic]:
    row = {"kind": kind, "agent": "robot", "mode": mode, "speed_scale": scale, "run_id": "r", "path": "p", "seq": 3}
    return check_speeds(pl.DataFrame([row], schema=EVENTS))


@pytest.mark.parametrize("mode", ["normal", "reduced", "collaborative", "speed_and_separation"])
def test_a_scale_of_zero_beside_a_mode_that_is_no_stop_is_questioned(mode: str) -> None:
    (doubt,) = doubts(mode, 0.0)
    assert (doubt.code, doubt.severity, doubt.seq) == ("doubtful_speed", "warning", 3)
    assert "'robot'" in doubt.message
    assert doubts(mode, 0.3) == doubts(mode, None) == doubts(mode, 0.0, "task_started") == []


@pytest.mark.parametrize(
    "mode", ["", "stopped", "PROTECTIVE_STOP", "safety_rated_monitored_stop", "halt", "STO", "paused"]
)
def test_a_stop_is_not_questioned(mode: str) -> None:
    assert doubts(mode, 0.0) == []


def test_what_is_computed_from_a_doubtful_scale_stands_beside_the_doubt(tmp_path: Path) -> None:
    events = run()
    safety = SafetyStateChanged(
        time_ns=BEGIN + SECOND, run_id="run", seq=len(events), agent="robot", mode="normal", speed_scale=0.0
    )
    analysis = hrclog.analyze(write(tmp_path / "a.mcap", [*events, Written(safety, safety.time_ns)]))
    assert not analysis.metrics.filter(pl.col("metric") == "mean_speed_scale").is_empty()
    assert "doubtful_speed" in {finding.code for finding in analysis.diagnostics}


ROS_DEFINITION = Path(__file__).parents[2] / "docs" / "TaskEvent.msg"


def with_definition(source: Path, target: Path, definition: str) -> Path:
    """Copy a log, with another definition of its events."""
    with source.open("rb") as stream, target.open("wb") as copy:
        writer = Writer(copy)
        writer.start(profile="ros2", library="test")
        schema = writer.register_schema(TYPE_NAME, "ros2msg", definition.encode())
        channel = writer.register_channel("/hrc/events", "cdr", schema)
        for _, _, message in make_reader(stream).iter_messages():
            writer.add_message(channel, message.log_time, message.data, message.publish_time, message.sequence)
        writer.finish()
    return target


def fields(definition: str) -> list[list[str]]:
    lines = (line.split("#")[0].split() for line in definition.splitlines())
    return [words for words in lines if words]


def test_the_definition_for_ros_nodes_has_our_fields_and_defaults_that_count_as_unset() -> None:
    ours, theirs = fields(DEFINITION), fields(ROS_DEFINITION.read_text(encoding="utf-8"))
    assert [words[:2] for words in theirs] == ours
    defaults = {words[1]: words[2] for words in theirs if len(words) > 2}
    unset = str(-(2**63))
    assert defaults == {
        "schema_version": "1",
        "attempt": "1",
        **dict.fromkeys(("seq", "time_ns", "agent_time_ns", *PLANNED), unset),
        "role": '"primary"',
    }


def test_a_bag_with_that_definition_is_read_as_our_own(tmp_path: Path) -> None:
    ours = write(tmp_path / "a.mcap", run())
    definition = ROS_DEFINITION.read_text(encoding="utf-8")
    theirs = with_definition(ours, tmp_path / "b.mcap", definition)
    one, other = read_logs(ours), read_logs(theirs)
    assert other.diagnostics == []
    assert other.events.drop("path").equals(one.events.drop("path"))
    assert Definition(definition).decoder()(encode_row(to_row(run()[0].event))).kind == "run_started"
