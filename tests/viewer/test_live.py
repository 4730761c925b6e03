"""Runs that are being recorded, in a real viewer: they arrive while they go on, and statistics when they have ended."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from rerun.experimental import ViewerClient
from rerun_viewers import PATIENCE_S, asked, colours, complaints, state_of, tabs

from hrclog.analyzers.live.follow import Followed, follow
from hrclog.arrays import ByteArray

pytestmark = pytest.mark.slow

RECORDER = """
import select, sys, time
from hrclog import Recorder
path, rounds = sys.argv[1], int(sys.argv[2])
recorder = Recorder(path, run=sys.argv[3], agents=["human", "robot"])
print(recorder.run_id, flush=True)
number = 0
while number < rounds or not select.select([sys.stdin], [], [], 0)[0]:  # until standard input is closed
    recorder.safety("robot", ("normal", "slow")[number % 2], (1.0, 0.5)[number % 2])
    start = recorder.now_ns()
    other = recorder.start("human", f"assemble {number % 2}", planned_start_ns=start, planned_end_ns=start + 2 * 10**9)
    with recorder.task("robot", f"pick {number % 3}"):
        for at in range(10):
            recorder.signal("min_distance", at / 10)
            time.sleep(0.05)
    other.end("failed" if number == 1 else "succeeded")
    number += 1
recorder.close()
"""


@contextmanager
def recorder(folder: Path, rounds: int, name: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Start a recorder, and give its process and the id of its run; it ends after so many rounds when it is awaited."""
    command = [sys.executable, "-c", RECORDER, str(folder / f"{name}.mcap"), str(rounds), name]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        yield process, process.stdout.readline().strip()
    finally:
        process.kill()
        process.communicate()


@contextmanager
def following(folder: Path, viewer: ViewerClient, told: list[str]) -> Iterator[Followed]:
    """Follow a folder in a thread."""
    stop = threading.Event()
    followed = Followed()
    work = threading.Thread(
        target=follow,
        args=(folder, viewer.url, stop.wait),
        kwargs={"every_s": 0.2, "tell": told.append, "followed": followed},
    )
    work.start()
    try:
        yield followed
    finally:
        stop.set()
        work.join(PATIENCE_S)
    assert not work.is_alive()


def wait_until(holds: Callable[[], bool]) -> None:
    until = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < until, "it did not happen"
        time.sleep(0.2)


def time_of(viewer: ViewerClient, recording: str) -> float:
    """Return where the cursor of a recording stands, s; 0 where it is not there."""
    found = [one.current_time for one in state_of(viewer).recordings if recording in one.store_id]
    return (found[0] or 0) / 1e9 if found else 0.0


def bring_to_front(viewer: ViewerClient, recording: str) -> None:
    (location,) = [one.location for one in state_of(viewer).recordings if recording in one.store_id]
    viewer.set_location(location)
    time.sleep(1.5)


def pixels(viewer: ViewerClient, path: Path) -> ByteArray:
    asked(lambda: viewer.save_screenshot(str(path)))
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


def test_a_run_grows_in_the_viewer_and_statistics_follow_its_end(viewer: ViewerClient, tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    runs.mkdir()
    told: list[str] = []
    with following(runs, viewer, told) as followed:
        with recorder(runs, 12, "first") as (process, run_id):
            wait_until(lambda: time_of(viewer, run_id) > 2)
            seen = time_of(viewer, run_id)
            views = {view.view_class for view in state_of(viewer).views}
            assert views >= {"StateTimeline", "TimeSeries", "TextLog", "TextDocument"}
            wait_until(lambda: time_of(viewer, run_id) > seen + 1)  # the cursor goes with the run
            assert colours(viewer, tmp_path / "live.png") > 100
            assert complaints(viewer) == []
            assert process.poll() is None
            process.communicate(timeout=PATIENCE_S)
        wait_until(lambda: any("campaign" in one.store_id for one in state_of(viewer).recordings))
        bring_to_front(viewer, "campaign")
        wait_until(lambda: "2D" in {view.view_class for view in state_of(viewer).views})
        time.sleep(2)
        before = pixels(viewer, tmp_path / "before.png")
        with recorder(runs, 4, "second") as (process, second):
            process.communicate(timeout=PATIENCE_S)
        wait_until(lambda: second in followed.ended)
        time.sleep(4)
        bring_to_front(viewer, "campaign")
        assert (pixels(viewer, tmp_path / "after.png") != before).any(axis=-1).mean() > 0.005
        assert complaints(viewer) == []
        bring_to_front(viewer, run_id)
        assert not any(complaints(viewer) for _ in tabs(viewer))
    assert (followed.runs, followed.ended) == ({run_id, second}, {run_id, second})
    assert told == []


@pytest.mark.skipif(not Path("/proc/locks").exists(), reason="lists locks as Linux does")
def test_a_run_whose_recorder_is_killed_stands_still(viewer: ViewerClient, tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    runs.mkdir()
    told: list[str] = []
    with following(runs, viewer, told) as followed, recorder(runs, 100, "first") as (process, run_id):
        wait_until(lambda: time_of(viewer, run_id) > 1.5)
        os.kill(process.pid, signal.SIGKILL)
        wait_until(lambda: bool(told))
        time.sleep(1)
        stands = time_of(viewer, run_id)
        time.sleep(1.5)
        assert time_of(viewer, run_id) == stands
        assert complaints(viewer) == []
    assert "its recorder has gone" in told[0]
    assert (followed.runs, followed.ended) == ({run_id}, set())
