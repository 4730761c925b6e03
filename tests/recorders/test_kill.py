"""SIGKILL at random moments: every event that was acknowledged is in the log, recovered or not."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest
from sizes import many

from hrclog.errors import LogReadError
from hrclog.log.journal import journal_path
from hrclog.log.reader import Logs, read_logs
from hrclog.log.recover import recover

pytestmark = [pytest.mark.slow, pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork and SIGKILL")]

SERVER = """
import os, sys, time
from pathlib import Path
from hrclog.recorders.recorder import Recorder

def work(folder, pace, count):
    acknowledged = os.open(folder / "acknowledged", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    acknowledge = lambda kind, handle: os.write(acknowledged, f"{kind} {handle.execution_id}\\n".encode())
    recorder = Recorder(folder / "run.mcap", agents=["robot"])
    for i in range(count):
        handle = recorder.start("robot", f"task {i % 7}", details={"text": "x" * (i % 5 * 1000)})
        acknowledge("task_started", handle)
        time.sleep(pace) if pace else None
        handle.end()
        acknowledge("task_ended", handle)
        recorder.signal("distance", i)
    recorder.close()
    os.write(acknowledged, b"run_ended \\n")

for line in sys.stdin:
    folder, pace, count = line.rstrip("\\n").split("\\t")
    child = os.fork()
    if not child:
        work(Path(folder), float(pace), int(count))
        os._exit(0)
    print(child, flush=True)
    sys.stdin.readline()  # until then a child that has ended keeps its number
    os.waitpid(child, 0)
    print("reaped", flush=True)
"""


class Server:
    """A process that forks recorders, so that none has to import anything."""

    def __init__(self) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", SERVER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def record_and_kill(self, folder: Path, pace_s: float, count: int, after_s: float) -> None:
        """Let a process record `count` tasks, and kill it after a time."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(f"{folder}\t{pace_s}\t{count}\n")
        self.process.stdin.flush()
        child = int(self.process.stdout.readline())
        time.sleep(after_s)
        os.kill(child, signal.SIGKILL)
        self.process.stdin.write("reap\n")
        self.process.stdin.flush()
        assert self.process.stdout.readline() == "reaped\n"

    def close(self) -> None:
        """Let the process end."""
        self.process.communicate()


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    server = Server()
    yield server
    server.close()


def _acknowledged(folder: Path) -> list[tuple[str, str]]:
    path = folder / "acknowledged"
    # the kill may tear this file's last line too
    lines = path.read_text().split("\n")[:-1] if path.exists() else []
    return [(kind, execution_id) for kind, _, execution_id in (line.partition(" ") for line in lines)]


def _holds(logs: Logs, acknowledged: list[tuple[str, str]]) -> None:
    """Assert that the log holds what was acknowledged, in that order, and at most one event more."""
    events = [row for row in logs.events.sort("seq").select("kind", "execution_id").rows() if row[0] != "run_started"]
    assert events[: len(acknowledged)] == acknowledged
    assert len(events) <= len(acknowledged) + 1
    assert logs.events["seq"].sort().to_list() == list(range(logs.events.height))


def _check(folder: Path) -> str:
    """Check what a killed recorder left, before and after recovery; return the state in which it was."""
    acknowledged = _acknowledged(folder)
    finished, journal = folder / "run.mcap", journal_path(folder / "run.mcap")
    state = "+".join(path.name for path in (finished, journal) if path.exists()) or "nothing"
    if state == "nothing":
        assert acknowledged == []
        return state
    before = read_logs(folder)
    _holds(before, acknowledged)
    errors = {diagnostic.code for diagnostic in before.diagnostics if diagnostic.severity == "error"}
    assert errors <= {"truncated", "no_header", "no_events"}
    if errors:  # said only where bytes are torn, or nothing is there
        assert not finished.exists()
        assert "truncated" in errors or before.events.is_empty()
    if journal.exists():
        try:
            recovered = recover(journal)
        except LogReadError:
            assert before.events.is_empty()
            return "no header"
        assert bool(recovered.problems) is ("truncated" in errors)
    after = read_logs(finished)
    events = after.events.filter(pl.col("kind") != "annotation_added")  # a recovery remarks on what was torn
    _holds(replace(after, events=events), acknowledged)
    assert events.drop("path").equals(before.events.drop("path"))
    codes = {diagnostic.code for diagnostic in after.diagnostics}
    assert codes <= {"no_events", "recovered_with_losses"}
    assert ("recovered_with_losses" in codes) is ("truncated" in errors)
    return state


@pytest.mark.parametrize(("pace_s", "longest_s"), [(0.0, 0.04), (0.003, 0.15)])
def test_kills_lose_nothing_that_was_acknowledged(
    server: Server, tmp_path: Path, pace_s: float, longest_s: float
) -> None:
    chance = random.Random(f"{pace_s}")
    states: set[str] = set()
    n_events = 0
    kills = many(40, fuzz=400)
    for number in range(kills):
        folder = tmp_path / str(number)
        folder.mkdir()
        server.record_and_kill(folder, pace_s, 10**6, chance.uniform(0.0, longest_s))
        states.add(_check(folder))
        n_events += len(_acknowledged(folder))
    assert "run.mcap.partial" in states
    assert n_events > 10 * kills


def test_kills_around_the_end_of_a_run_leave_its_journal_or_its_log(server: Server, tmp_path: Path) -> None:
    chance = random.Random(0)
    states: set[str] = set()
    for number in range(many(40, fuzz=600)):
        folder = tmp_path / str(number)
        folder.mkdir()
        server.record_and_kill(folder, 0.0, chance.randrange(1, 60), chance.uniform(0.0, 0.03))
        states.add(_check(folder))
    assert {"run.mcap.partial", "run.mcap"} <= states
