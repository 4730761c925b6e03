"""The recorder: what it says is what is in the log, and nothing is lost or invented on the way."""

from __future__ import annotations

import os
import resource
import threading
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import polars as pl
import pytest
from folders import names_in
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.reader import make_reader
from scenes import ARM_URDF, cell_scene

import hrclog
from hrclog import Recorder, intervals
from hrclog.errors import IllegalEventError, InvalidEventError, LogExistsError, LogReadError, LogWriteError
from hrclog.event_rows import from_row, parse_details
from hrclog.events import Event, Heartbeat, RunEnded, RunStarted, TaskDispatched, TaskStarted
from hrclog.files import lock
from hrclog.log.begun import Cleared, clear
from hrclog.log.logs import Logs
from hrclog.log.mcap.records import Walk
from hrclog.log.messages.encode import Message
from hrclog.log.reader import read_logs
from hrclog.log.recover import recover
from hrclog.log.writing.journal import Journal, journal_path
from hrclog.recorders.event_recorder import EventRecorder, steady_clock
from hrclog.recorders.segments import next_segment, segment_path
from hrclog.state import Phase


def logged(path: Path, *allowed: str) -> list[Event]:
    """Return the events of a log, which must be sound but for the diagnostics that are allowed."""
    logs = read_logs(path)
    assert {diagnostic.code for diagnostic in logs.diagnostics} <= set(allowed)
    events = logs.events.sort("seq")
    assert events["seq"].to_list() == list(range(events.height))
    return [from_row(row) for row in events.iter_rows(named=True)]


def rows(path: Path, *names: str) -> list[tuple[Any, ...]]:
    return read_logs(path).events.sort("seq").select(names).rows()


def kinds(path: Path) -> list[str]:
    return [kind for (kind,) in rows(path, "kind")]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


def abandon(recorder: Recorder) -> None:
    """Leave a recorder as a kill would: its journal is on the disk, its lock is free."""
    assert recorder._journal is not None
    recorder._journal.close()
    recorder._journal = None


# a run from start to end


def test_a_block_is_recorded_from_its_start_to_its_end(path: Path) -> None:
    with Recorder(path, run="demo") as recorder:
        with recorder.task("robot", "pick_blue_box") as task:
            assert task.phase is Phase.STARTED
        assert task.phase is Phase.ENDED
        assert recorder.run_id
    assert names_in(path.parent) == ["run.mcap"]
    assert kinds(path) == ["run_started", "task_started", "task_ended", "run_ended"]
    started, ended = (event for event in logged(path) if isinstance(event, TaskStarted | hrclog.events.TaskEnded))
    assert (started.agent, started.task, started.execution_id) == ("robot", "pick_blue_box", task.execution_id)
    assert ended.execution_id == task.execution_id
    assert ended.outcome == "succeeded"
    assert ended.time_ns >= started.time_ns
    assert started.run_id == recorder.run_id


def test_a_run_says_what_it_knows(path: Path) -> None:
    facts = {"plan": [{"task": "pick"}], "task_properties": {"pick": 1}, "dispatch_mode": "offline", "seed": 7}
    with Recorder(path, "demo", agents=("h", "r"), software={"cell": "1.2"}, **facts):
        pass
    started = logged(path)[0]
    assert isinstance(started, hrclog.events.RunStarted)
    assert {name: getattr(started, name) for name in facts} == facts
    assert (started.name, started.agents, started.software, started.segment) == ("demo", ("h", "r"), {"cell": "1.2"}, 1)


@pytest.mark.parametrize(("given_path", "name"), [("run.mcap", "run"), ("run", "run"), ("run.v2", "run.v2")])
def test_a_run_is_named_after_its_file_unless_told(tmp_path: Path, given_path: str, name: str) -> None:
    with Recorder(str(tmp_path / given_path)) as recorder:
        pass
    assert recorder.path.name == f"{name}.mcap"
    assert parse_details(rows(recorder.path, "details")[0][0])["name"] == name


class OddError(Exception):
    """An exception without a text."""


@pytest.mark.parametrize(
    ("error", "outcome", "reason"),
    [
        (ValueError("too hot"), "failed", "ValueError: too hot"),
        (OddError(), "failed", "OddError"),
        (KeyboardInterrupt(), "canceled", "KeyboardInterrupt"),
        (SystemExit(3), "canceled", "SystemExit: 3"),
        (OSError("name \udcff"), "failed", "OSError: name \\udcff"),
    ],
)
def test_an_exception_ends_task_and_run_with_its_reason_and_goes_on(
    path: Path, error: BaseException, outcome: str, reason: str
) -> None:
    with pytest.raises(type(error)) as caught, Recorder(path) as recorder, recorder.task("robot", "pick"):
        raise error
    assert caught.value is error
    assert rows(path, "kind", "outcome", "reason")[-2:] == [
        ("task_ended", outcome, reason),
        ("run_ended", outcome, reason),
    ]


def test_a_failed_task_does_not_fail_the_run_that_went_on(path: Path) -> None:
    with Recorder(path) as recorder:
        with pytest.raises(ValueError, match="x"), recorder.task("robot", "pick"):
            raise ValueError("x")
        with recorder.task("robot", "pick", attempt=2):
            pass
    assert rows(path, "outcome", "attempt")[2:] == [("failed", 1), ("", 2), ("succeeded", 2), ("succeeded", 0)]


def test_a_block_that_ended_its_task_has_the_last_word(path: Path) -> None:
    with Recorder(path) as recorder, recorder.task("robot", "pick") as task:
        task.end("timed_out", "slow", path_length=2.5, planning_time_s=0.5, planned_duration_s=3.0, target="left")
    assert rows(path, "outcome", "reason", "path_length", "planning_time_s", "planned_duration_s", "target")[2] == (
        "timed_out", "slow", 2.5, 0.5, 3.0, "left",
    )  # fmt: skip


def test_a_task_that_is_still_open_stays_open(path: Path) -> None:
    with Recorder(path) as recorder:
        task = recorder.start("robot", "pick")
        assert [handle.execution_id for handle in recorder.open_executions()] == [task.execution_id]
    assert kinds(path) == ["run_started", "task_started", "run_ended"]


def test_start_and_end_take_all_their_fields(path: Path) -> None:
    with Recorder(path) as recorder:
        task = recorder.start(
            "robot", "pick", time_ns=50, agent_time_ns=49, execution_id="mine", task_type="pick", role="auxiliary",
            attempt=2, item_id="item", parent_execution_id="parent", planned_start_ns=40, planned_end_ns=60,
            details={"grip": [1, None]},
        )  # fmt: skip
        recorder.end("mine", "failed", "slipped", time_ns=70, details={"force": 1.5})
    assert task.execution_id == "mine"
    names = ("time_ns", "agent_time_ns", "task_type", "role", "attempt", "item_id", "parent_execution_id", "details")
    found = read_logs(path).events.filter(execution_id="mine").select(names).rows()
    assert found == [
        (50, 49, "pick", "auxiliary", 2, "item", "parent", '{"grip":[1,null]}'),
        (70, None, "pick", "auxiliary", 2, "item", "parent", '{"force":1.5}'),
    ]


def test_a_dispatched_task_is_started_by_its_handle(path: Path) -> None:
    with Recorder(path) as recorder:
        task = recorder.dispatch("robot", "pick", planned_start_ns=5, planned_end_ns=9, command_id="c", item_id="i")
        assert task.phase is Phase.DISPATCHED
        assert task.start().phase is Phase.STARTED
        recorder.end(task)
        recorder.dispatch("robot", "place").end("skipped")
    assert kinds(path)[1:4] == ["task_dispatched", "task_started", "task_ended"]
    assert set(rows(path, "execution_id", "item_id", "command_id")[1:4]) == {(task.execution_id, "i", "c")}
    assert rows(path, "kind", "outcome")[4:6] == [("task_dispatched", ""), ("task_ended", "skipped")]


def test_pauses_are_recorded_with_their_cause(path: Path) -> None:
    with Recorder(path) as recorder, recorder.task("robot", "pick") as task:
        task.pause("safety", "hand in zone")
        assert task.phase is Phase.PAUSED
        task.resume()
        recorder.pause(task.execution_id, "dependency")
        recorder.resume(task)
        recorder.pause(task)
    assert rows(path, "kind", "cause", "reason")[2:8] == [
        ("task_paused", "safety", "hand in zone"),
        ("task_resumed", "", ""),
        ("task_paused", "dependency", ""),
        ("task_resumed", "", ""),
        ("task_paused", "operator", ""),
        ("task_ended", "", ""),
    ]


def test_all_other_events_have_a_method(path: Path) -> None:
    with Recorder(path) as recorder:
        task = recorder.start("robot", "pick")
        recorder.safety("robot", "reduced", 0.25, "table", time_ns=11)
        recorder.annotate("looks fine")
        recorder.annotate("a bit slow", task)
        recorder.annotate("very slow", task.execution_id)
        recorder.reject("c1", "busy", agent="robot", task="place", execution_id="x")
        recorder.sync_clock("robot", 12345)
        recorder.change_plan({"a": []}, "delay")
        recorder.heartbeat("robot")
    events = logged(path, "time_not_monotonic", "log_times_untimely")
    by_kind = {event.kind: event for event in events}
    safety: Any = by_kind["safety_state_changed"]
    assert (safety.agent, safety.mode, safety.speed_scale, safety.zone, safety.time_ns) == (
        "robot", "reduced", 0.25, "table", 11,
    )  # fmt: skip
    remarks: Any = [event for event in events if event.kind == "annotation_added"]
    assert [(remark.reason, remark.task, remark.execution_id) for remark in remarks] == [
        ("looks fine", "", ""),
        ("a bit slow", "pick", task.execution_id),
        ("very slow", "pick", task.execution_id),
    ]
    rejected: Any = by_kind["command_rejected"]
    assert (rejected.command_id, rejected.reason, rejected.task, rejected.execution_id) == ("c1", "busy", "place", "x")
    assert by_kind["clock_synced"].agent_time_ns == 12345
    changed: Any = by_kind["plan_changed"]
    assert (changed.plan, changed.reason) == ({"a": []}, "delay")
    beat: Any = by_kind["heartbeat"]
    assert beat.agent == "robot"


def test_signals_and_joints_are_recorded_beside_the_events(path: Path) -> None:
    with Recorder(path) as recorder:
        recorder.signal("distance to hand", 1)
        recorder.signal("distance to hand", 0.5, time_ns=77)
        recorder.joints("robot", ["a", "b"], [1, 2.5], time_ns=78)
        with pytest.raises(InvalidEventError, match="2 names and 1 positions"):
            recorder.joints("robot", ["a", "b"], [1.0])
        with pytest.raises(InvalidEventError, match="valid Unicode"):
            recorder.signal("\ud800", 1.0)
        with pytest.raises(InvalidEventError, match="joint state: a field cannot be written"):
            recorder.joints("robot", ["a"], [1.0], time_ns=2**62)
    signals = read_logs(path, signals=True).signals
    assert signals.filter(pl.col("time_ns") < 100).select("name", "value").rows() == [
        ("distance to hand", 0.5), ("robot/a", 1.0), ("robot/b", 2.5),
    ]  # fmt: skip
    assert signals.height == 4
    assert set(signals["run_id"]) == {recorder.run_id}
    assert kinds(path) == ["run_started", "run_ended"]


def test_the_cell_is_recorded_beside_the_events(path: Path) -> None:
    with Recorder(path) as recorder:
        recorder.scene(cell_scene())
        recorder.describe("robot", ARM_URDF)
        recorder.pose("cube", [1, 2, 3], time_ns=77)
        with pytest.raises(InvalidEventError, match="position of 2 numbers, expected 3"):
            recorder.pose("cube", [1, 2])
        with pytest.raises(InvalidEventError, match="expected a number"):
            recorder.pose("cube", ["x", 2, 3])  # type: ignore[list-item]  # the error is the point
        with pytest.raises(InvalidEventError, match="scene: schema_version"):
            recorder.scene({})
    cell = read_logs(path, signals=True).scene.of_run(recorder.run_id)
    assert cell is not None
    assert cell.descriptions == {"robot": ARM_URDF}
    assert [box.name for box in cell.scene.boxes] == ["cube"]
    assert cell.poses.rows() == [(recorder.run_id, "cube", 77, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)]
    assert kinds(path) == ["run_started", "run_ended"]


# what is not allowed


def test_an_illegal_step_raises_and_records_nothing(path: Path) -> None:
    with Recorder(path) as recorder:
        task = recorder.start("robot", "pick")
        steps = [
            (task.resume, "resume_without_pause"),
            (task.start, "duplicate_start"),
            (lambda: recorder.start("human", "pick", execution_id=task.execution_id), "duplicate_start"),
            (lambda: recorder.dispatch("robot", "pick", execution_id=task.execution_id), "dispatch_after_start"),
            (lambda: recorder.dispatch("robot", "pick").end(), "end_without_start"),
        ]
        for step, problem in steps:
            with pytest.raises(IllegalEventError, match=problem):
                step()
        task.end()
        for step in (task.end, task.pause, task.resume):
            with pytest.raises(IllegalEventError, match=r"event_after_end.*the execution is ended"):
                step()
    assert kinds(path) == ["run_started", "task_started", "task_dispatched", "task_ended", "run_ended"]


def test_an_unknown_execution_is_refused(path: Path) -> None:
    with Recorder(path) as recorder, pytest.raises(IllegalEventError, match="found execution 'nobody'"):
        recorder.end("nobody")
    assert kinds(path) == ["run_started", "run_ended"]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda recorder: recorder.start("", "pick"), "agent is empty"),
        (lambda recorder: recorder.start("robot", ""), "task is empty"),
        (lambda recorder: recorder.start("robot", "pick", attempt=-1), "a field cannot be written"),
        (lambda recorder: recorder.start("robot", "pick", time_ns=1.5), "expected whole nanoseconds"),
        (lambda recorder: recorder.start("robot", "\ud800"), "a field cannot be written"),
        (lambda recorder: recorder.start("robot", 7), "a field cannot be written"),
        (lambda recorder: recorder.start("robot", "pick", details={"x": {1, 2}}), "cannot be written as JSON"),
        (lambda recorder: recorder.start("robot", "pick").end("aborted"), "outcome is 'aborted'"),
        (lambda recorder: recorder.start("robot", "pick").pause("lunch"), "cause is 'lunch'"),
        (lambda recorder: recorder.safety("robot", "stop", float("nan")), "speed_scale is nan"),
        (lambda recorder: recorder.safety("robot", "stop", "slow"), "a field cannot be written"),
        (lambda recorder: recorder.change_plan(object()), "cannot be written as JSON"),
    ],
)
def test_a_field_that_the_vocabulary_forbids_is_refused_and_costs_nothing(
    path: Path, call: Callable[[Recorder], object], message: str
) -> None:
    with Recorder(path) as recorder:
        with pytest.raises(InvalidEventError, match=message):
            call(recorder)
        recorder.heartbeat()
    assert kinds(path)[-2:] == ["heartbeat", "run_ended"]
    logged(path)


def test_a_run_that_cannot_begin_leaves_nothing_behind(path: Path) -> None:
    with pytest.raises(InvalidEventError, match="cannot be written as JSON"):
        Recorder(path, plan=object())
    assert names_in(path.parent) == []
    Recorder(path).close()


def test_a_name_is_never_overwritten(path: Path) -> None:
    first = Recorder(path)
    with pytest.raises(LogExistsError, match=r"run.mcap.partial: exists already.*resume=True"):
        Recorder(path)
    first.close()
    with pytest.raises(LogExistsError, match=r"run.mcap: exists already"):
        Recorder(path)
    assert kinds(path) == ["run_started", "run_ended"]


@pytest.mark.parametrize("name", ["nowhere/run.mcap", "n" * 300 + ".mcap", "a\0b.mcap"])
def test_a_place_that_cannot_be_written_is_said_so(tmp_path: Path, name: str) -> None:
    with pytest.raises(LogWriteError, match="cannot be created"):
        Recorder(tmp_path / name)


_NAMES = st.text(min_size=1, max_size=12).filter(str.strip)  # blank ones are refused


@pytest.mark.slow
@settings(max_examples=30)
@given(_NAMES, _NAMES, st.text(max_size=12))
def test_any_text_may_be_a_name(tmp_path: Path, agent: str, task: str, run: str) -> None:
    path = tmp_path / "run.mcap"
    path.unlink(missing_ok=True)
    with Recorder(path, run, agents=[agent]) as recorder:
        with recorder.task(agent, task):
            recorder.joints(agent, [task], [1.0])
        recorder.signal(task, 1.0)
    assert rows(path, "agent", "task")[1:3] == [(agent, task)] * 2
    assert parse_details(rows(path, "details")[0][0])["name"] == (run or "run")
    assert set(read_logs(path, signals=True).signals["name"]) == {f"{agent}/{task}", task} or "\0" in task


HOSTILE = [
    "../../etc/passwd",
    "a/b",
    "-rf",
    "$(reboot)",
    "'; drop table",
    "a\n\r\tb",
    "\0",
    "🦾" * 40,
    "x" * 5000,
    " a ",
    "__",
    "1",
]


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_name_is_just_a_name(path: Path, name: str) -> None:
    with Recorder(path, name) as recorder, recorder.task(name, name) as task:
        recorder.safety(name, name, 0.5, name)
        recorder.annotate(name, task)
        recorder.signal(name, 1.0)
    assert rows(path, "agent", "task", "reason")[3] == (name, name, name)
    assert names_in(path.parent) == ["run.mcap"]


# its end


def test_closing_twice_does_nothing(path: Path) -> None:
    with Recorder(path) as recorder:
        recorder.close("canceled", "enough")
        recorder.close()
    recorder.close("failed")
    assert rows(path, "kind", "outcome", "reason")[-1] == ("run_ended", "canceled", "enough")


@pytest.mark.parametrize(
    "call",
    [
        lambda recorder: recorder.start("robot", "pick"),
        lambda recorder: recorder.heartbeat(),
        lambda recorder: recorder.signal("x", 1.0),
        lambda recorder: recorder.joints("robot", ["a"], [1.0]),
        lambda recorder: recorder.task("robot", "pick").__enter__(),
    ],
)
def test_a_closed_recorder_takes_nothing_more(path: Path, call: Callable[[Recorder], object]) -> None:
    with Recorder(path) as recorder:
        pass
    with pytest.raises(IllegalEventError, match="the recorder is closed; continue the run with resume=True"):
        call(recorder)
    assert kinds(path) == ["run_started", "run_ended"]


def test_nothing_follows_the_end_of_a_run(path: Path) -> None:
    with Recorder(path) as recorder:
        recorder.record(RunEnded(time_ns=5, outcome="failed"))
        with pytest.raises(IllegalEventError, match="after run_ended"):
            recorder.heartbeat()
    assert rows(path, "kind", "outcome")[1:] == [("run_ended", "failed")]


# its journal


def test_every_event_is_on_the_disk_when_its_method_has_returned(path: Path) -> None:
    partial = path.with_name("run.mcap.partial")
    with Recorder(path) as recorder:
        for count in range(5):
            recorder.heartbeat()
            assert read_logs(partial).events.height == count + 2
        assert not path.exists()
    assert path.exists()


def test_fsync_records_the_same(path: Path) -> None:
    with Recorder(path, fsync=True) as recorder, recorder.task("robot", "pick"):
        recorder.signal("x", 1.0)
    assert kinds(path) == ["run_started", "task_started", "task_ended", "run_ended"]


def test_an_event_that_the_disk_did_not_take_is_not_in_the_run(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with Recorder(path) as recorder:
        task = recorder.start("robot", "pick")
        with monkeypatch.context() as patch:
            patch.setattr(Journal, "_write_all", full)
            with pytest.raises(LogWriteError, match="No space left on device"):
                task.end()
            with pytest.raises(LogWriteError):
                recorder.close()
        assert task.phase is Phase.STARTED
        task.end()
    assert [event.kind for event in logged(path)] == ["run_started", "task_started", "task_ended", "run_ended"]


def test_an_interrupt_just_after_the_write_leaves_recorder_and_log_agreed(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    append = Journal.append

    def interrupted(self: Journal, *messages: Message) -> None:
        append(self, *messages)
        raise KeyboardInterrupt

    with Recorder(path) as recorder:
        with monkeypatch.context() as patch:
            patch.setattr(Journal, "append", interrupted)
            with pytest.raises(KeyboardInterrupt):
                recorder.start("robot", "pick", execution_id="e")
        assert recorder.state("e").phase is Phase.STARTED
        recorder.end("e")
    assert [event.kind for event in logged(path)] == ["run_started", "task_started", "task_ended", "run_ended"]


def test_the_finished_log_cannot_be_written_but_the_journal_stays(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorder = Recorder(path)
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", lambda _: (_ for _ in ()).throw(OSError(5, "Input/output error")))
        with pytest.raises(LogWriteError, match="Input/output error"):
            recorder.close()
    assert names_in(path.parent) == ["run.mcap.partial"]
    hrclog.log.recover.recover(path.with_name("run.mcap.partial"))
    assert kinds(path) == ["run_started", "run_ended"]


# threads


def test_many_threads_share_a_recorder_without_gaps(path: Path) -> None:
    n_threads, n_tasks = 8, 40
    barrier = threading.Barrier(n_threads)
    with Recorder(path) as recorder:

        def work(number: int) -> None:
            barrier.wait()
            for i in range(n_tasks):
                with recorder.task(f"agent {number}", f"task {i}") as task:
                    task.pause()
                    recorder.signal(f"signal {number}", i)
                    task.resume()

        with ThreadPoolExecutor(n_threads) as pool:
            list(pool.map(work, range(n_threads)))
    events = logged(path)  # no gaps, no backward times
    assert len(events) == 2 + n_threads * n_tasks * 4
    assert Counter(event.kind for event in events)["task_ended"] == n_threads * n_tasks
    assert read_logs(path, signals=True).signals.height == n_threads * n_tasks


def test_threads_that_race_for_one_step_agree_on_one_winner(path: Path) -> None:
    barrier = threading.Barrier(8)
    with Recorder(path) as recorder:
        task = recorder.start("robot", "pick")

        def end(_: int) -> bool:
            barrier.wait()
            try:
                task.end()
            except IllegalEventError:
                return False
            return True

        with ThreadPoolExecutor(8) as pool:
            assert sum(pool.map(end, range(8))) == 1
    assert kinds(path).count("task_ended") == 1


def test_the_clock_never_runs_backwards() -> None:
    clock = steady_clock()
    times = [clock() for _ in range(10_000)]
    assert times == sorted(times)


# one more segment


def _segments(folder: Path) -> Logs:
    return read_logs(folder)


def test_a_killed_run_is_resumed_in_a_further_segment(path: Path) -> None:
    first = Recorder(path, "demo")
    first.start("robot", "pick", execution_id="open", item_id="i")
    first.dispatch("human", "place", execution_id="waiting")
    abandon(first)
    with Recorder(path, resume=True) as second:
        assert second.path.name == "run.2.mcap"
        assert second.run_id == first.run_id
        assert [handle.execution_id for handle in second.open_executions()] == ["open"]
        second.end("open", "failed", "power cut")
        second.handle("waiting").start().end()
        with pytest.raises(IllegalEventError, match="duplicate_start"):
            second.start("robot", "pick", execution_id="open")
    assert names_in(path.parent) == ["run.2.mcap", "run.mcap"]
    logs = _segments(path.parent)
    assert logs.diagnostics == []
    assert logs.events.sort("seq")["seq"].to_list() == list(range(8))
    assert set(logs.events["run_id"]) == {first.run_id}
    ended = logs.events.filter(kind="task_ended", execution_id="open")
    assert ended.select("agent", "task", "item_id", "outcome", "reason").rows() == [
        ("robot", "pick", "i", "failed", "power cut"),
    ]
    starts = logs.events.filter(kind="run_started").sort("seq")["details"].to_list()
    assert [(parse_details(text)["name"], parse_details(text).get("segment", 1)) for text in starts] == [
        ("demo", 1), ("demo", 2),
    ]  # fmt: skip


def test_the_lane_of_an_execution_that_outlived_a_kill_ends_with_it(path: Path) -> None:
    first = Recorder(path)
    first.start("robot", "pick", execution_id="open")
    abandon(first)
    with Recorder(path, resume=True) as second:
        second.end("open")
    with second.path.open("rb") as stream:
        lanes = [message.data for _, _, message in make_reader(stream).iter_messages("/hrc/agents/robot/active_task")]
    assert lanes == [b"\0\1\0\0\1\0\0\0\0"]


def test_a_run_may_be_resumed_again_and_again(path: Path) -> None:
    Recorder(path).close()
    for number in range(2, 6):
        recorder = Recorder(path, resume=True)
        assert recorder.path.name == f"run.{number}.mcap"
        if number % 2:
            abandon(recorder)
        else:
            recorder.close()
    logs = _segments(path.parent)
    assert logs.events["run_id"].n_unique() == 1
    assert {diagnostic.code for diagnostic in logs.diagnostics} == {"unfinished_log"}


def test_a_segment_that_was_killed_before_its_first_byte_is_written_anew(path: Path) -> None:
    Recorder(path).close()
    path.with_name("run.2.mcap.partial").touch()
    with Recorder(path, resume=True) as recorder:
        assert recorder.path.name == "run.2.mcap"
    assert _segments(path.parent).diagnostics == []


@settings(max_examples=25)
@given(where=st.floats(0, 1, exclude_max=True), segment=st.integers(1, 2))
def test_a_journal_that_was_cut_before_its_first_event_is_begun_anew(
    where: float, segment: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("cut") / "run.mcap"
    if segment == 2:
        Recorder(path).close()
    recorder = Recorder(path, resume=segment == 2)
    journal = journal_path(recorder.path)
    whole = journal.read_bytes()
    # the message of a journal's chunk follows the chunk's head
    first = next(record for record in Walk(whole, []) if record[0] == Opcode.CHUNK and whole[record[1] + 49] == 5)
    left = whole[: int(where * first[3])]
    abandon(recorder)
    journal.write_bytes(left)
    with Recorder(path, "demo", resume=True) as again:
        assert again.path.name == ("run.mcap" if segment == 1 else "run.2.mcap")
    assert names_in(path.parent) == (["run.mcap"] if segment == 1 else ["run.2.mcap", "run.mcap"])
    logs = _segments(path.parent)
    assert logs.diagnostics == []
    assert logs.events["run_id"].n_unique() == 1
    assert logs.events["seq"].to_list() == list(range(2 * segment))


def _header_end(journal: bytes) -> int:
    return next(iter(Walk(journal, [])))[3]


def _zeroed(journal: bytes) -> bytes:
    return journal[: _header_end(journal)].ljust(len(journal), b"\0")


def _garbled(journal: bytes) -> bytes:
    begin = _header_end(journal)
    return journal[:begin] + bytes(byte ^ 0x5A for byte in journal[begin:])


def _with_longer_first_message(journal: bytes) -> bytes:
    first = next(record for record in Walk(journal, []) if record[0] == Opcode.CHUNK and journal[record[1] + 49] == 5)
    return journal[: first[1] + 7] + b"\xff" + journal[first[1] + 8 :]


@pytest.mark.parametrize(
    "destroyed", [_zeroed, _garbled, _with_longer_first_message, lambda journal: bytes(len(journal))]
)
@pytest.mark.parametrize("segment", [1, 2])
def test_a_journal_whose_events_were_destroyed_is_kept_and_the_run_remembers_it(
    path: Path, segment: int, destroyed: Callable[[bytes], bytes]
) -> None:
    if segment == 2:
        Recorder(path).close()
    recorder = Recorder(path, resume=segment == 2)
    abandon(recorder)
    journal = journal_path(recorder.path)
    rest = destroyed(journal.read_bytes())
    journal.write_bytes(rest)
    with Recorder(path, resume=True) as again:
        assert again.path == recorder.path
    assert journal.with_name(f"{journal.name}.damaged").read_bytes() == rest
    logs = _segments(path.parent)
    assert [finding.code for finding in logs.diagnostics] == ["recovered_with_losses"]
    assert logs.diagnostics[0].severity == "error"
    assert logs.events["run_id"].n_unique() == 1
    assert logs.events["seq"].to_list() == list(range(logs.events.height))


@pytest.mark.parametrize("lost", [1, 2, 3])
def test_a_run_goes_on_behind_all_its_segments_so_that_a_lost_one_stays_missing(path: Path, lost: int) -> None:
    for number in range(1, 4):
        with Recorder(path, resume=number > 1) as recorder:
            recorder.heartbeat("robot")
    segment_path(path, lost).unlink()
    with Recorder(path, resume=True) as recorder:
        # behind the last one that is there
        assert recorder.path.name == ("run.3.mcap" if lost == 3 else "run.4.mcap")
    codes = {finding.code for finding in _segments(path.parent).diagnostics}
    assert ("events_missing" in codes) is (lost != 3)


def test_a_journal_that_was_taken_for_an_abandoned_one_is_created_again(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken: list[int] = []

    def lock_late(fd: int, *, wait: bool) -> bool:
        if not taken:
            taken.append(fd)
            assert clear(journal_path(path)) == Cleared()
        return lock(fd, wait=wait)

    monkeypatch.setattr("hrclog.log.writing.journal.lock", lock_late)
    with Recorder(path) as recorder:
        recorder.heartbeat("robot")
    assert _segments(path.parent).events["seq"].to_list() == [0, 1, 2]


def test_of_two_that_resume_at_once_the_later_one_is_refused(path: Path) -> None:
    Recorder(path).close()
    segment = next_segment(path)
    with Recorder(path, resume=True) as first:
        first.heartbeat("robot")
    with pytest.raises(LogExistsError, match="another recorder has written it"):
        EventRecorder(segment, RunStarted(time_ns=1, segment=2), fsync=False, clock_ns=lambda: 1)
    assert names_in(path.parent) == ["run.2.mcap", "run.mcap"]
    assert _segments(path.parent).diagnostics == []


@pytest.mark.parametrize("is_done", [False, True])
def test_a_run_is_closed_while_another_process_recovers_it(
    path: Path, is_done: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def recover_late(journal: Path, log: Path, *, wait: bool) -> object:
        if is_done:
            recover(journal)
        else:
            held = journal.open("rb")
            assert lock(held.fileno(), wait=False)
            threading.Timer(0.05, held.close).start()
        return recover(journal, log, wait=wait)

    monkeypatch.setattr("hrclog.recorders.event_recorder.recover", recover_late)
    Recorder(path).close()
    assert names_in(path.parent) == ["run.mcap"]
    assert _segments(path.parent).diagnostics == []


@pytest.mark.parametrize("room", [0, 8, 30, 60, 2000, 4500])
def test_a_disk_that_is_full_at_the_start_leaves_no_journal(path: Path, room: int) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))
    try:
        with pytest.raises(LogWriteError, match="could not be written"):
            Recorder(path, plan="x" * 5000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert names_in(path.parent) == []
    Recorder(path).close()


def test_a_journal_beside_its_finished_log_is_removed_on_resuming(path: Path) -> None:
    recorder = Recorder(path)
    journal = path.with_name("run.mcap.partial")
    recorder.record(RunEnded(time_ns=recorder.now_ns()))
    whole = journal.read_bytes()
    recorder.close()
    journal.write_bytes(whole)
    Recorder(path, resume=True).close()
    assert names_in(path.parent) == ["run.2.mcap", "run.mcap"]


def test_there_must_be_a_run_to_resume(path: Path) -> None:
    with pytest.raises(LogReadError, match="found nothing, expected a run to continue"):
        Recorder(path, resume=True)
    assert names_in(path.parent) == []


def test_a_run_that_is_still_being_recorded_cannot_be_resumed(path: Path) -> None:
    with Recorder(path), pytest.raises(LogReadError, match="a recorder still writes"):
        Recorder(path, resume=True)
    assert kinds(path) == ["run_started", "run_ended"]


def test_a_file_of_several_runs_cannot_be_resumed(path: Path) -> None:
    hrclog.log.writing.writer.write_log(path, [Heartbeat(time_ns=1, run_id="a"), Heartbeat(time_ns=1, run_id="b")])
    with pytest.raises(LogReadError, match="found 2 runs, expected one run to continue"):
        Recorder(path, resume=True)


def test_an_event_of_any_class_may_be_recorded(path: Path) -> None:
    with Recorder(path) as recorder:
        event = recorder.record(TaskDispatched(time_ns=3, agent="robot", task="pick", execution_id="e", seq=99))
    assert (event.run_id, event.seq, event.time_ns) == (recorder.run_id, 1, 3)
    assert event in logged(path, "time_not_monotonic", "log_times_shifted")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_forked_child_neither_records_nor_ends_its_parents_run(path: Path) -> None:
    with Recorder(path) as recorder:
        child = os.fork()
        if not child:
            try:
                recorder.start("robot", "pick")
            except IllegalEventError:
                recorder.close()
                os._exit(7)
            os._exit(1)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
        recorder.start("robot", "pick").end()
    events = read_logs(path).events
    assert events["kind"].to_list() == ["run_started", "task_started", "task_ended", "run_ended"]


def test_what_comes_before_the_start_of_an_execution_is_refused(path: Path) -> None:
    with Recorder(path) as recorder:
        task = recorder.start("robot", "pick", time_ns=1000)
        for late in (task.end, task.pause):
            with pytest.raises(IllegalEventError, match="later instant"):
                late(time_ns=999)
        task.pause(time_ns=2000)
        with pytest.raises(IllegalEventError, match="later instant"):
            task.resume(time_ns=1999)
        task.end(time_ns=2000)


def test_a_clock_that_is_set_back_while_the_run_was_stopped_does_not_run_backwards(path: Path) -> None:
    with Recorder(path, clock_ns=lambda: 10**15) as recorder:
        task = recorder.start("robot", "pick")
    with Recorder(path, resume=True, clock_ns=lambda: 10**9) as recorder:
        recorder.end(task.execution_id)
    logs = read_logs([path, path.with_name("run.2.mcap")])
    assert [finding.code for finding in logs.diagnostics] == ["clock_put_back"]
    assert logs.events["time_ns"].to_list() == [10**15] * logs.events.height


@settings(max_examples=10)
@given(st.lists(st.integers(-(10**13), -(10**9)), min_size=1, max_size=3), st.integers(1, 10**11))
def test_however_the_clock_is_put_back_between_tasks_they_keep_their_lengths(shifts: list[int], length_ns: int) -> None:
    now = [10**15]
    with TemporaryDirectory() as folder:
        with Recorder(Path(folder) / "run.mcap", clock_ns=lambda: now[0]) as recorder:
            for shift in [0, *shifts]:
                now[0] += shift
                for _ in range(2):
                    with recorder.task("robot", "fetch"):
                        now[0] += length_ns
                    now[0] += 5
        logs = read_logs(folder)
        executions = intervals(logs.events)
        assert set(executions["end_ns"] - executions["start_ns"]) == {length_ns}
        assert executions["start_ns"].is_sorted()
        assert [finding.code for finding in logs.diagnostics] == ["clock_put_back"] * len(shifts)


@settings(max_examples=10)
@given(st.lists(st.integers(-(10**13), 10**13), min_size=1, max_size=3), st.integers(1, 10**11))
def test_however_the_clock_is_put_while_a_run_is_stopped_its_tasks_keep_their_lengths(
    shifts: list[int], length_ns: int
) -> None:
    now = [10**15]

    def work(recorder: Recorder) -> None:
        for _ in range(2):
            task = recorder.start("robot", "fetch")
            now[0] += length_ns
            task.end()
            now[0] += 5

    with TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        with Recorder(path, clock_ns=lambda: now[0]) as recorder:
            work(recorder)
        true_ns, last_ns = now[0], now[0]
        told: list[int] = []
        for shift in shifts:
            now[0] = true_ns + shift
            told += [last_ns - now[0]] if now[0] < last_ns else []
            last_ns = max(last_ns, now[0])
            with Recorder(path, resume=True, clock_ns=lambda: now[0]) as recorder:
                before = now[0]
                work(recorder)
                last_ns += now[0] - before
        logs = read_logs(folder)
        executions = intervals(logs.events)
        assert set(executions["end_ns"] - executions["start_ns"]) == {length_ns}
        put_back = [finding for finding in logs.diagnostics if finding.code == "clock_put_back"]
        details = logs.events.filter(logs.events["kind"] == "run_started").sort("seq")["details"]
        recorded = [parse_details(text).get("clock_shift_ns") for text in details]
        assert [shift for shift in recorded if shift is not None] == told
        assert {finding.code for finding in logs.diagnostics} <= {"clock_put_back"}
        assert len(put_back) == len(told)


@pytest.mark.parametrize(
    "call",
    [
        lambda recorder: recorder.safety("R", "x", speed_scale="0.4"),
        lambda recorder: recorder.safety("R", "x", speed_scale=50),
        lambda recorder: recorder.signal("x", "y"),
        lambda recorder: recorder.signal(" ", 1.0),
        lambda recorder: recorder.joints("R", ["a"], ["b"]),
        lambda recorder: recorder.start("R", "pick", details=[1, 2]),
        lambda recorder: recorder.start("R", "pick", role="aux"),
        lambda recorder: recorder.start("R", "pick", time_ns=-5),
        lambda recorder: recorder.start("R", "pick", time_ns=2**62),
        lambda recorder: recorder.start("R", " "),
    ],
)
def test_what_cannot_be_right_is_refused_with_an_error_of_ours(call: Callable[[Recorder], object], path: Path) -> None:
    with Recorder(path) as recorder, pytest.raises(InvalidEventError):
        call(recorder)
    assert read_logs(path).events["kind"].to_list() == ["run_started", "run_ended"]


def test_a_run_of_the_past_begins_and_ends_when_it_did(path: Path) -> None:
    recorder = Recorder(path, time_ns=1000)
    recorder.start("robot", "pick", time_ns=2000).end(time_ns=3000)
    recorder.close(time_ns=4000)
    assert read_logs(path).events["time_ns"].to_list() == [1000, 2000, 3000, 4000]
