"""Following a journal while it is written: in whatever pieces it is seen, the rows are those of the finished log."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import ARM_URDF, cell_scene

from hrclog.errors import LogReadError
from hrclog.log import follow
from hrclog.log.follow import JournalFollower, News, is_being_written
from hrclog.log.messages.recorded_scene import merged
from hrclog.log.one_log import read_log
from hrclog.log.watch import finished_log, list_folder
from hrclog.log.writing.journal import journal_path
from hrclog.recorders.recorder import Recorder

RECORDER = """
import sys, time
from hrclog import Recorder
recorder = Recorder(sys.argv[1], run="by a process", agents=["robot"])
print("ready", flush=True)
for number in range(int(sys.argv[2])):
    recorder.signal("distance", number)
    with recorder.task("robot", f"task {number % 3}", details={"text": "x" * (number % 50)}):
        time.sleep(0.002)
print("done", flush=True)
sys.stdin.readline()
recorder.close()
"""


@dataclass(frozen=True)
class Recorded:
    """A run as a journal and as the finished log."""

    journal: bytes
    log: Path


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    path = tmp_path_factory.mktemp("recorded") / "run.mcap"
    recorder = Recorder(path, run="a run", agents=["human", "robot"])
    recorder.scene(cell_scene())
    recorder.describe("robot", ARM_URDF)
    for number in range(12):
        with recorder.task("robot", f"task {number % 3}", item_id="é" * number):
            recorder.joints("robot", ["turn"], [number / 10])
            recorder.signal("distance", number)
            recorder.pose("cube", (0.5, number / 20, 0.1))
        recorder.safety("robot", "slow", 0.5)
    journal = journal_path(path).read_bytes()
    recorder.close()
    return Recorded(journal, path)


def looks(follower: JournalFollower, data: bytes, cuts: Iterable[int]) -> list[News]:
    """Let the file grow up to each cut and then whole, and return what is found each time."""
    found: list[News] = []
    for cut in (*sorted(cuts), len(data)):
        with follower.path.open("ab") as stream:
            stream.write(data[stream.tell() : cut])
        more = True
        while more:
            news = follower.look()
            assert news is not None
            found.append(news)
            more = news.more
    return found


def rows(events: pl.DataFrame) -> pl.DataFrame:
    return events.filter(pl.col("kind") != "run_ended").drop("path").sort("seq")


def samples(signals: pl.DataFrame) -> pl.DataFrame:
    return signals.sort("run_id", "name", "time_ns", "value")


def is_as_read(found: list[News], path: Path) -> None:
    """Assert that all looks together have found what is read from a log at once."""
    whole = read_log(path, signals=True)
    assert rows(pl.concat([news.events for news in found])).equals(rows(whole.events))
    assert samples(pl.concat([news.signals for news in found])).equals(samples(whole.signals))
    scene = merged(news.scene for news in found)
    assert scene.scenes == whole.scene.scenes
    assert scene.descriptions == whole.scene.descriptions
    assert scene.poses.equals(whole.scene.poses.sort("run_id", "name", "time_ns"))


@settings(max_examples=25)
@given(data=st.data())
def test_a_journal_that_is_seen_in_any_pieces_gives_the_rows_of_its_finished_log(
    data: st.DataObject, recorded: Recorded, tmp_path_factory: pytest.TempPathFactory
) -> None:
    cuts = data.draw(st.lists(st.integers(0, len(recorded.journal)), max_size=6))
    follower = JournalFollower(tmp_path_factory.mktemp("seen") / "run.mcap.partial")
    found = looks(follower, recorded.journal, cuts)
    is_as_read(found, recorded.log)
    assert follower.position == len(recorded.journal)
    assert not any(news.restarted or news.diagnostics for news in found)


@settings(max_examples=25)
@given(data=st.data())
def test_damage_in_a_journal_loses_what_reading_it_at_once_loses(
    data: st.DataObject, recorded: Recorded, tmp_path_factory: pytest.TempPathFactory
) -> None:
    at = data.draw(st.integers(8, len(recorded.journal) - 1))
    damaged = bytearray(recorded.journal)
    damaged[at] ^= 1 << data.draw(st.integers(0, 7))
    cuts = data.draw(st.lists(st.integers(0, len(damaged)), max_size=4))
    path = tmp_path_factory.mktemp("seen") / "run.mcap.partial"
    found = looks(JournalFollower(path), bytes(damaged), cuts)
    is_as_read(found, path)


def test_a_look_reads_no_more_than_a_block_and_says_that_there_is_more(
    recorded: Recorded, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(follow, "BLOCK", 500)  # less than the scene, which is one message
    found = looks(JournalFollower(tmp_path / "run.mcap.partial"), recorded.journal, [])
    assert len(found) > 10
    is_as_read(found, recorded.log)


def test_the_events_of_a_look_keep_nothing_of_the_signals_between_them(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "run.mcap")
    recorder.annotate("a remark that is longer than twelve bytes")
    recorder.describe("robot", "<!-- " + "x" * 1_000_000 + " -->")
    recorder.annotate("another remark that is longer than twelve bytes")
    news = JournalFollower(journal_path(recorder.path)).look()
    recorder.close()
    assert news is not None
    columns = news.events.to_arrow(compat_level=pl.CompatLevel.newest()).columns  # texts as views into what they keep
    sizes = [buffer.size for column in columns for buffer in column.chunk(0).buffers() if buffer]
    assert max(sizes) < 100_000


def test_a_journal_that_was_cut_or_replaced_is_read_anew(recorded: Recorded, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap.partial"
    follower = JournalFollower(path)
    looks(follower, recorded.journal, [])
    cut = recorded.journal[:20_000]
    with path.open("r+b") as stream:
        stream.truncate(20_000)
    news = follower.look()
    assert news is not None
    assert news.restarted
    (tmp_path / "same").write_bytes(cut)
    cut_events = read_log(tmp_path / "same").events
    assert cut_events.height > 2
    assert news.events.drop("path").equals(cut_events.drop("path"))
    other = Recorder(tmp_path / "other.mcap")
    other.annotate("x" * 30_000)
    shutil.copyfile(journal_path(other.path), path)  # into the same file, which is longer than what was read of it
    news = follower.look()
    assert news is not None
    assert news.restarted
    assert news.events["run_id"].unique().to_list() == [other.run_id]
    journal_path(other.path).replace(path)
    again = follower.look()
    assert again is not None
    assert again.restarted
    assert again.events.height == news.events.height


def test_a_look_at_a_journal_that_is_gone_or_closed_to_us_says_so(tmp_path: Path) -> None:
    follower = JournalFollower(tmp_path / "run.mcap.partial")
    assert follower.look() is None
    (tmp_path / "folder").mkdir()
    with pytest.raises(LogReadError, match=r"folder.*cannot be opened"):
        JournalFollower(tmp_path / "folder").look()


def test_what_is_no_journal_gives_no_rows_and_says_why_once_something_good_follows(
    recorded: Recorded, tmp_path: Path
) -> None:
    follower = JournalFollower(tmp_path / "run.mcap.partial")
    found = looks(follower, b"no journal at all" + recorded.journal[8:], [3, 17])
    assert [news.events.height for news in found[:2]] == [0, 0]
    assert [one.code for news in found for one in news.diagnostics] == ["corrupt_data"]
    assert rows(found[-1].events).equals(rows(read_log(recorded.log).events))


def test_a_folder_lists_journals_without_a_log_and_logs_apart(tmp_path: Path) -> None:
    for name in ("a.mcap", "b.mcap.partial", "a.mcap.partial", "c.bag", "notes.txt", ".hrclog-1-2.tmp"):
        (tmp_path / name).write_bytes(b"x")
    (tmp_path / "ros").mkdir()
    (tmp_path / "ros" / "metadata.yaml").write_text("x")
    (tmp_path / "other").mkdir()
    found = list_folder(tmp_path)
    assert [path.name for path in found.journals] == ["b.mcap.partial"]
    assert [path.name for path in found.logs] == ["a.mcap", "c.bag", "ros"]
    assert finished_log(tmp_path / "b.mcap.partial") == tmp_path / "b.mcap"
    (tmp_path / "a.mcap").write_bytes(b"xx")
    assert list_folder(tmp_path).logs[tmp_path / "a.mcap"] != found.logs[tmp_path / "a.mcap"]


@pytest.mark.parametrize(("name", "what"), [("missing", "found nothing"), ("file", "found a file")])
def test_what_is_no_folder_is_one_clear_error(name: str, what: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(LogReadError, match=rf"{name}: {what}, expected a folder"):
        list_folder(tmp_path / name)


def started(folder: Path, count: int) -> subprocess.Popen[str]:
    """Start a recorder, and wait until it has begun."""
    process = subprocess.Popen(
        [sys.executable, "-c", RECORDER, str(folder / "run.mcap"), str(count)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


@pytest.mark.slow
def test_a_recorder_is_followed_from_another_process_while_it_writes(tmp_path: Path) -> None:
    recorder = started(tmp_path, 300)
    follower = JournalFollower(tmp_path / "run.mcap.partial")
    found: list[News] = []
    while sum(news.events.height for news in found) < 601:
        news = follower.look()
        assert news is not None
        found.append(news)
        time.sleep(0.02)
    assert sum(news.events.height > 0 for news in found) > 10
    recorder.communicate("\n", timeout=20)
    assert follower.look() is None
    is_as_read(found, tmp_path / "run.mcap")


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/locks").exists(), reason="lists locks as Linux does")
def test_a_killed_recorder_leaves_all_that_it_acknowledged_and_lets_go_of_its_journal(tmp_path: Path) -> None:
    recorder = started(tmp_path, 100_000)
    path = tmp_path / "run.mcap.partial"
    follower = JournalFollower(path)
    found = [follower.look()]
    assert is_being_written(path)
    time.sleep(0.3)
    os.kill(recorder.pid, signal.SIGKILL)
    recorder.communicate(timeout=20)
    assert is_being_written(path) is False
    found.append(follower.look())
    assert follower.look() is not None
    is_as_read([news for news in found if news is not None], path)
    assert is_being_written(tmp_path / "nothing") is None
