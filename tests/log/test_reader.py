"""Reading files of any state: one frame, and a diagnostic for whatever is remarkable."""

from __future__ import annotations

import os
import re
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer
from PIL import Image

import hrclog
from hrclog.diagnostic import CODES, Diagnostic, loses_data
from hrclog.errors import LogReadError
from hrclog.event_rows import to_row
from hrclog.events import Event, Heartbeat, RunEnded, RunStarted, TaskEnded, TaskStarted, UnknownEvent
from hrclog.log.logs import ORDER, Logs
from hrclog.log.messages.encode import event_message
from hrclog.log.messages.message import EVENTS
from hrclog.log.one_log import read_log
from hrclog.log.reader import read_events, read_logs
from hrclog.log.recover import recover
from hrclog.log.writing.journal import Journal
from hrclog.log.writing.writer import write_atomically, write_log

RUN: list[Event] = [
    RunStarted(time_ns=0, run_id="r", name="run"),
    TaskStarted(time_ns=5, run_id="r", agent="robot", task="pick", execution_id="e"),
    TaskEnded(time_ns=7, run_id="r", agent="robot", task="pick", execution_id="e"),
    RunEnded(time_ns=9, run_id="r"),
]
NUMBERED = [replace(event, seq=seq) for seq, event in enumerate(RUN)]


def write_raw(path: Path, events: list[Event]) -> Path:
    """Write events as they are: in any order, with any numbers."""
    write_atomically(path, lambda writer: [writer.add(event_message(event, 1)) for event in events])
    return path


def write_journal(path: Path, events: list[Event]) -> Path:
    journal = Journal(path)
    for event in events:
        journal.append(event_message(event, event.time_ns))
    journal.close()
    return path


def codes(logs: Logs) -> list[str]:
    return [diagnostic.code for diagnostic in logs.diagnostics]


def only(logs: Logs) -> Diagnostic:
    (diagnostic,) = logs.diagnostics
    return diagnostic


@pytest.fixture
def good(tmp_path: Path) -> Path:
    path = tmp_path / "good.mcap"
    write_log(path, RUN)
    return path


def test_a_sound_log_has_no_diagnostics_and_the_documented_columns(good: Path) -> None:
    logs = read_logs(good)
    assert logs.diagnostics == []
    assert logs.paths == [good]
    assert dict(logs.events.schema) == dict(EVENTS)
    assert read_events(good).equals(logs.events)
    assert read_events([str(good)]).equals(logs.events)
    assert hrclog.read_events(good).equals(logs.events)


# what cannot be read at all


def test_a_path_that_is_missing_is_said_so(tmp_path: Path) -> None:
    with pytest.raises(LogReadError, match=r"none.mcap: found nothing, expected an event log; check the path"):
        read_logs(tmp_path / "none.mcap")


@pytest.mark.parametrize("name", ["n" * 300, "a\0b", "*.mcap", "nowhere/*.mcap", "[", ""])
def test_an_argument_that_names_no_log_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(LogReadError):
        read_logs(f"{tmp_path}/{name}")


def test_no_argument_at_all_is_refused() -> None:
    with pytest.raises(LogReadError, match="no argument"):
        read_logs([])


def _png(path: Path) -> None:
    Image.new("RGB", (4, 4)).save(path, "png")


def _sqlite(path: Path) -> None:
    database = sqlite3.connect(path)
    database.execute("create table messages (id integer)")
    database.commit()
    database.close()


FOREIGN = {
    "a text": (lambda path: path.write_text("time,agent\n1,robot\n"), "a file that begins with b'time,age'"),
    "a PNG": (_png, r"a file that begins with b'\\x89PNG"),
    "an SQLite file": (_sqlite, "an SQLite file that is no part of a bag, expected a log"),
    "a Rerun recording": (lambda path: path.write_bytes(b"RRF2 and so on"), "a Rerun recording.*hrclog view"),
    "zeros": (lambda path: path.write_bytes(bytes(5000)), "a file that begins with b'"),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_a_file_of_another_kind_is_refused_with_what_it_is(tmp_path: Path, name: str) -> None:
    write, message = FOREIGN[name]
    path = tmp_path / "file.mcap"
    write(path)
    with pytest.raises(LogReadError, match=message):
        read_logs(path)


@pytest.mark.parametrize("name", FOREIGN)
def test_a_bad_file_never_hides_the_good_ones(tmp_path: Path, good: Path, name: str) -> None:
    path = tmp_path / "file.mcap"
    FOREIGN[name][0](path)
    logs = read_logs(tmp_path)
    assert logs.events.height == len(RUN)
    assert only(logs).code == "unreadable_file"
    assert only(logs).path == str(path)
    assert logs.paths == [good]
    with pytest.raises(LogReadError, match=re.escape(f"{path}: {only(logs).message}")):
        read_events(tmp_path)


def test_several_files_none_of_which_can_be_read_are_refused_together(tmp_path: Path) -> None:
    for name in "ab":
        (tmp_path / f"{name}.mcap").write_text("nonsense")
    with pytest.raises(LogReadError, match=r"found 2 files that cannot be read, the first: .*a\.mcap"):
        read_logs(tmp_path)


def test_a_file_that_may_not_be_read_is_said_so(good: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        log = Path(folder, "closed.mcap")
        log.write_bytes(good.read_bytes())
        log.chmod(0)
        with not_root(), pytest.raises(LogReadError, match="Permission denied"):
            read_logs(log)


@contextmanager
def not_root() -> Iterator[None]:
    """Give up root's right to read everything for a while."""
    user = os.geteuid()
    if user == 0:
        os.seteuid(65534)
    try:
        yield
    finally:
        if user == 0:
            os.seteuid(0)


def test_a_folder_without_logs_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("hello")
    with pytest.raises(LogReadError, match="found no log, expected paths, folders or globs"):
        read_logs(tmp_path)


# what is read, with a diagnostic


@pytest.mark.parametrize("content", [b"", b"\x89MC", b"\x89MCAP0\r\n"])
def test_a_kill_before_the_header_leaves_no_events_and_an_error(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "run.mcap.partial"
    path.write_bytes(content)
    logs = read_logs(path)
    assert logs.events.is_empty()
    assert only(logs).code == "no_header"
    assert "0 events" in only(logs).message
    assert loses_data(logs.diagnostics)


def test_a_file_without_our_topic_is_said_to_carry_no_events(tmp_path: Path) -> None:
    path = tmp_path / "foreign.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel(
            "/chatter", "cdr", writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        )
        writer.add_message(channel, 1, b"\0\1\0\0\2\0\0\0a\0", 1)
        writer.finish()
    logs = read_logs(path, signals=True)
    assert logs.events.is_empty()
    assert codes(logs) == ["no_events"]


def test_a_journal_is_read_as_it_is(tmp_path: Path, good: Path) -> None:
    logs = read_logs(write_journal(tmp_path / "run.mcap.partial", NUMBERED))
    assert codes(logs) == ["unfinished_log"]
    assert not loses_data(logs.diagnostics)
    assert logs.events.drop("path", "log_time_ns").equals(read_logs(good).events.drop("path", "log_time_ns"))


def test_a_journal_beside_its_finished_log_counts_once(tmp_path: Path) -> None:
    journal = write_journal(tmp_path / "run.mcap.partial", NUMBERED)
    whole = journal.read_bytes()
    recover(journal)
    journal.write_bytes(whole)
    logs = read_logs(tmp_path)
    assert logs.events.height == len(RUN)
    assert codes(logs) == ["unfinished_log", "duplicate_events"]
    assert logs.diagnostics[1].message.startswith("4 events")
    assert logs.diagnostics[1].path == str(journal)


def test_a_log_that_is_given_twice_counts_once(tmp_path: Path, good: Path) -> None:
    (tmp_path / "folder").mkdir()
    copy = tmp_path / "folder" / "copy.mcap"
    copy.write_bytes(good.read_bytes())
    assert read_logs([good, good, tmp_path / "folder" / ".." / "good.mcap", good]).events.height == len(RUN)
    logs = read_logs([good, copy])
    first, second = sorted([good, copy])
    assert logs.events["path"].unique().to_list() == [str(first)]
    assert only(logs).code == "duplicate_events"
    assert only(logs).path == str(second)
    assert read_logs([copy, good]).events.equals(logs.events)


def test_an_event_that_is_in_one_file_twice_counts_once(tmp_path: Path) -> None:
    logs = read_logs(write_raw(tmp_path / "a.mcap", [*NUMBERED, NUMBERED[1], NUMBERED[1]]))
    assert logs.events.height == len(RUN)
    assert codes(logs) == ["duplicate_events"]
    assert only(logs).message.startswith("2 events")


def test_two_different_events_with_one_number_are_both_kept(tmp_path: Path) -> None:
    logs = read_logs(write_raw(tmp_path / "a.mcap", [*NUMBERED, Heartbeat(time_ns=8, run_id="r", seq=2)]))
    assert logs.events.height == len(RUN) + 1
    assert only(logs).code == "conflicting_seq"
    assert only(logs).severity == "warning"


@pytest.mark.parametrize(
    ("missing", "text"),
    [
        ({0}, "1 event between seq 0 and 3 is missing"),
        ({1}, "1 event between seq 0 and 3 is missing"),
        ({1, 2}, "2 events between seq 0 and 3 are missing"),
    ],
)
def test_numbers_that_are_missing_tell_of_lost_events(tmp_path: Path, missing: set[int], text: str) -> None:
    rest = [event for event in NUMBERED if event.seq not in missing]
    logs = read_logs(write_raw(tmp_path / "a.mcap", rest))
    assert only(logs).code == "events_missing"
    assert only(logs).message == text
    assert only(logs).run_id == "r"
    assert loses_data(logs.diagnostics)


def test_the_segments_of_a_run_are_numbered_through(tmp_path: Path) -> None:
    first, second = write_raw(tmp_path / "run.mcap", NUMBERED[:2]), write_raw(tmp_path / "run.2.mcap", NUMBERED[2:])
    assert read_logs([second, first]).diagnostics == []
    assert read_logs([second, first]).events["seq"].to_list() == [0, 1, 2, 3]
    assert codes(read_logs(second)) == ["events_missing"]


def test_an_event_of_an_unknown_kind_is_kept(tmp_path: Path) -> None:
    strange = UnknownEvent(time_ns=6, row=to_row(NUMBERED[1]) | {"kind": "task_teleported", "seq": 4, "time_ns": 6})
    logs = read_logs(
        write_raw(tmp_path / "a.mcap", [*NUMBERED, strange, replace(strange, row={**strange.row, "seq": 5})])
    )
    assert logs.events.filter(kind="task_teleported").height == 2
    unknown = next(diagnostic for diagnostic in logs.diagnostics if diagnostic.code == "unknown_event")
    assert unknown.message == "2 events are of the unknown kind 'task_teleported'"
    assert (unknown.run_id, unknown.seq) == ("r", 4)


def test_an_event_of_a_newer_version_is_read_with_a_warning(tmp_path: Path) -> None:
    newer = UnknownEvent(time_ns=5, row=to_row(NUMBERED[1]) | {"schema_version": 7})
    logs = read_logs(write_raw(tmp_path / "a.mcap", [NUMBERED[0], newer, *NUMBERED[2:]]))
    assert logs.events["task"].to_list() == ["", "pick", "pick", ""]
    assert only(logs).code == "newer_schema"
    assert only(logs).severity == "warning"


@pytest.mark.parametrize("value", [float("inf"), float("-inf")])
def test_an_infinite_number_counts_as_unset(tmp_path: Path, value: float) -> None:
    events = [*NUMBERED[:2], replace(NUMBERED[2], path_length=value, planning_time_s=float("nan")), NUMBERED[3]]
    logs = read_logs(write_raw(tmp_path / "a.mcap", events))
    assert logs.events["path_length"].null_count() == logs.events["planning_time_s"].null_count() == len(RUN)
    assert only(logs).code == "non_finite_value"
    assert only(logs).seq == 2


def test_events_without_a_run_are_one_run_of_their_file(tmp_path: Path) -> None:
    for name in "ab":
        write_raw(tmp_path / f"{name}.mcap", [replace(event, run_id="") for event in NUMBERED])
    logs = read_logs(tmp_path)
    assert codes(logs) == ["no_run_id"] * 2
    assert logs.events["run_id"].n_unique() == 2
    assert logs.events["run_id"].to_list() == read_logs(tmp_path).events["run_id"].to_list()


def test_several_runs_may_share_a_file(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write_log(path, [event for pair in zip(RUN, (replace(e, run_id="q") for e in RUN), strict=True) for event in pair])
    logs = read_logs(path)
    assert logs.diagnostics == []
    assert logs.events["run_id"].to_list() == ["q"] * 4 + ["r"] * 4
    assert logs.events["seq"].to_list() == [0, 1, 2, 3] * 2


def test_times_that_run_backwards_are_believed(tmp_path: Path) -> None:
    events = [replace(event, time_ns=10**6 - event.time_ns) for event in NUMBERED]
    logs = read_logs(write_raw(tmp_path / "a.mcap", events))
    assert logs.events["seq"].to_list() == [3, 2, 1, 0]
    assert only(logs).code == "time_not_monotonic"
    assert only(logs).message.startswith("2 times")  # one of the agent's, one of the run's


@settings(max_examples=40)
@given(st.permutations(NUMBERED), st.integers(0, 4))
def test_neither_order_nor_distribution_over_files_matters(tmp_path: Path, events: list[Event], cut: int) -> None:
    expected = read_logs(write_raw(tmp_path / "ordered.mcap", NUMBERED))
    write_raw(tmp_path / "a.mcap", events[:cut])
    write_raw(tmp_path / "b.mcap", events[cut:])
    logs = read_logs([tmp_path / "a.mcap", tmp_path / "b.mcap"])
    assert logs.events.drop("path").equals(expected.events.drop("path"))
    assert logs.events.select(ORDER).equals(logs.events.select(ORDER).sort(ORDER))
    assert set(codes(logs)) <= {"no_events"}


def test_log_and_publish_times_do_not_matter(tmp_path: Path) -> None:
    def fill(writer: hrclog.log.writing.writer.FinishedWriter) -> None:
        for event in NUMBERED:
            message = event_message(event, 10**18 - event.seq)
            writer.add(replace(message, publish_time=77))

    path = tmp_path / "a.mcap"
    write_atomically(path, fill)
    assert read_logs(path).events["time_ns"].to_list() == [0, 5, 7, 9]
    assert read_logs(path).events["log_time_ns"].to_list() == [10**18 - seq for seq in range(4)]


def test_a_mixed_folder_gives_what_there_is(tmp_path: Path, good: Path) -> None:
    (tmp_path / "empty.mcap.partial").touch()
    (tmp_path / "text.mcap").write_text("hello")
    (tmp_path / "cut.mcap").write_bytes(good.read_bytes()[:-100])
    (tmp_path / "ignored.txt").write_text("hello")
    seen: list[Path] = []
    logs = read_logs(tmp_path, on_file=seen.append)
    assert logs.events.height == len(RUN)
    assert sorted(codes(logs)) == ["duplicate_events", "no_header", "truncated", "unreadable_file"]
    assert [path.name for path in seen] == ["cut.mcap", "empty.mcap.partial", "good.mcap", "text.mcap"]


def test_globs_and_folders_may_be_mixed_and_name_each_file_once(tmp_path: Path, good: Path) -> None:
    (tmp_path / "sub").mkdir()
    write_raw(tmp_path / "sub" / "[odd] name.mcap", [replace(event, run_id="q") for event in NUMBERED])
    logs = read_logs([f"{tmp_path}/*.mcap", tmp_path, tmp_path / "sub", tmp_path / "sub" / "[odd] name.mcap"])
    assert logs.paths == [good, tmp_path / "sub" / "[odd] name.mcap"]
    assert read_logs(f"{tmp_path}/**/*.mcap").events.height == 2 * len(RUN)
    assert read_logs(str(tmp_path / "sub" / "[odd] name.mcap")).events.height == len(RUN)


def test_signals_of_a_nameless_channel_belong_to_the_only_run(tmp_path: Path) -> None:
    from hrclog.log.messages.encode import FloatSignal

    path = tmp_path / "a.mcap"
    write_log(path, RUN, [FloatSignal("", "distance", 3, 0.5)])
    assert read_log(path, signals=True).signals.rows() == [("r", "distance", 3, 0.5)]


def test_every_diagnostic_has_a_severity_and_says_where() -> None:
    for code, (severity, meaning) in CODES.items():
        diagnostic = Diagnostic(code, meaning, "run.mcap", "r", seq=4)
        assert diagnostic.severity == severity
        assert str(diagnostic) == f"{severity}: run.mcap (seq 4): {meaning} [{code}]"
    assert str(Diagnostic("truncated", "cut", "run.mcap", offset=7)) == "error: run.mcap (byte 7): cut [truncated]"
    assert str(Diagnostic("truncated", "cut")) == "error: cut [truncated]"
    assert Diagnostic("truncated", "cut").as_dict()["severity"] == "error"


def test_a_frame_of_no_events_has_all_columns(tmp_path: Path) -> None:
    (tmp_path / "run.mcap.partial").touch()
    assert read_logs(tmp_path).events.schema == pl.Schema(EVENTS)


@pytest.mark.parametrize("argument", [5, None, [None], pl.DataFrame({"a": [1]}), ["sample_logs", 2.5]])
def test_what_is_no_path_is_one_clear_error(argument: object) -> None:
    for read in (read_logs, read_events):
        with pytest.raises(LogReadError, match="expected paths, folders or globs"):
            read(argument)
