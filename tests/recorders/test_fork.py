"""A process that is forked while other threads record goes on, and leaves the run of its parent alone."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from hrclog import Recorder
from hrclog.errors import IllegalEventError
from hrclog.ids import Uuid7Generator
from hrclog.log.reader import read_logs
from hrclog.log.recover import recover

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")

HUNG = -1


def forked(work: Callable[[], int], wait_s: float = 20.0) -> int:
    """Return the exit code of a forked process that does some work, `HUNG` where it does not end."""
    child = os.fork()
    if not child:
        code = 99
        try:
            code = work()
        finally:
            os._exit(code)
    until = time.monotonic() + wait_s
    while time.monotonic() < until:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.01)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return HUNG


class Busy:
    """A clock that holds a thread, and with it the lock of whoever asks for the time."""

    def __init__(self) -> None:
        self.entered, self.go_on = threading.Event(), threading.Event()
        self.holds = False

    def __call__(self) -> int:
        """Return the time, as soon as nothing holds the clock."""
        if self.holds:
            self.entered.set()
            self.go_on.wait(60)
        return time.time_ns()


def own_run(folder: Path) -> int:
    """Record another run in a forked process; return 7."""
    with Recorder(folder / "child.mcap") as own, own.task("human", "screw"):
        pass
    return 7


def test_a_fork_while_another_thread_holds_the_lock_does_not_hang(tmp_path: Path) -> None:
    clock = Busy()
    recorder = Recorder(tmp_path / "run.mcap", clock_ns=clock)

    def work() -> int:
        clock.holds = False
        recorder.close()
        try:
            recorder.start("robot", "pick")
        except IllegalEventError:
            return own_run(tmp_path)
        return 1

    clock.holds = True
    thread = threading.Thread(target=recorder.now_ns)
    thread.start()
    assert clock.entered.wait(20)
    code = forked(work, 10.0)
    clock.holds = False
    clock.go_on.set()
    thread.join()
    recorder.start("robot", "pick").end()
    recorder.close()
    assert code == 7
    kinds = read_logs(tmp_path / "run.mcap").events["kind"].to_list()
    assert kinds == ["run_started", "task_started", "task_ended", "run_ended"]
    assert read_logs(tmp_path / "child.mcap").events.height == 4


def test_a_fork_while_another_thread_makes_an_id_does_not_hang() -> None:
    clock = Busy()
    make_id = Uuid7Generator(clock)

    def work() -> int:
        clock.holds = False
        return 7 if make_id() else 1

    clock.holds = True
    thread = threading.Thread(target=make_id)
    thread.start()
    assert clock.entered.wait(20)
    code = forked(work, 10.0)
    clock.go_on.set()
    thread.join()
    assert code == 7


def test_a_child_that_outlives_a_killed_recorder_does_not_keep_its_journal(tmp_path: Path) -> None:
    path, read_end = tmp_path / "run.mcap", os.pipe()

    def parent() -> int:
        recorder = Recorder(path)
        recorder.start("robot", "pick")
        ready = os.pipe()
        if not os.fork():
            os.write(ready[1], b"x")
            os.read(read_end[0], 1)  # until the test has closed the other end
            os._exit(0)
        os.read(ready[0], 1)  # a child that runs has put the journal away
        os.kill(os.getpid(), signal.SIGKILL)
        return 1

    child = os.fork()
    if not child:
        os.close(read_end[1])
        os._exit(parent())
    os.close(read_end[0])
    try:
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
        assert recover(path.with_name("run.mcap.partial")).n_messages > 0
    finally:
        os.close(read_end[1])


@pytest.mark.slow
def test_forks_at_any_time_among_threads_that_record_end(tmp_path: Path) -> None:
    done = threading.Event()
    recorder = Recorder(tmp_path / "run.mcap")

    def record(agent: str) -> None:
        while not done.is_set():
            with recorder.task(agent, "pick"):
                recorder.signal("distance", 1.0)

    threads = [threading.Thread(target=record, args=(agent,)) for agent in ("robot", "human")]
    for thread in threads:
        thread.start()
    codes = []
    for number in range(60):
        folder = tmp_path / str(number)
        folder.mkdir()
        codes.append(forked(lambda folder=folder: own_run(folder)))  # type: ignore[misc]  # a default of its own
    done.set()
    for thread in threads:
        thread.join()
    recorder.close()
    assert codes == [7] * 60
    logs = read_logs(tmp_path / "run.mcap")
    assert logs.diagnostics == []
    assert logs.events["seq"].to_list() == list(range(logs.events.height))
