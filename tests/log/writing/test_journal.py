"""Journals: whatever was appended is in the file, all of it or nothing."""

from __future__ import annotations

import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from hrclog.errors import InvalidEventError, LogExistsError, LogWriteError
from hrclog.events import Heartbeat, TaskStarted
from hrclog.log.mcap.streamed import read_streamed
from hrclog.log.messages.channels import EVENTS, lane
from hrclog.log.messages.encode import FloatSignal, Message, event_message, signal_message
from hrclog.log.reader import read_logs
from hrclog.log.writing.journal import Journal, journal_path
from hrclog.log.writing.lanes import Lanes

STARTED = TaskStarted(time_ns=5, run_id="r", agent="robot", task="pick", execution_id="e")


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[Journal]:
    journal = Journal(tmp_path / "run.mcap.partial")
    yield journal
    journal.close()


@contextmanager
def full_disk(journal: Journal, room: int) -> Iterator[None]:
    """Let the operating system take only `room` more bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (journal.path.stat().st_size + room, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def _seqs(journal: Journal) -> list[int]:
    logs = read_logs(journal.path)
    assert {diagnostic.code for diagnostic in logs.diagnostics} <= {"unfinished_log"}
    return logs.events["seq"].to_list()


def _beat(seq: int, **fields: str) -> Message:
    return event_message(Heartbeat(time_ns=seq, run_id="r", seq=seq, **fields), seq)


def test_every_message_is_in_the_file_when_append_has_returned(journal: Journal) -> None:
    for seq in range(5):
        journal.append(_beat(seq))
        assert _seqs(journal) == list(range(seq + 1))
        assert journal.size == journal.path.stat().st_size


def test_messages_of_one_append_share_one_write(journal: Journal, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []
    write_all = Journal._write_all
    monkeypatch.setattr(Journal, "_write_all", lambda self, data: (calls.append(len(data)), write_all(self, data)))
    journal.append(event_message(STARTED, 1), *Lanes().after(STARTED, 1))
    assert len(calls) == 1


@pytest.mark.parametrize("room", [0, 1, 100, 1000, 3000])
def test_a_disk_that_is_full_leaves_nothing_of_the_message_behind(journal: Journal, room: int) -> None:
    journal.append(_beat(0))
    whole = journal.path.read_bytes()
    with full_disk(journal, room), pytest.raises(LogWriteError, match=r"could not be written \(File too large\)"):
        journal.append(_beat(1, agent="x" * 5000))
    assert journal.path.read_bytes() == whole
    journal.append(_beat(1))
    assert _seqs(journal) == [0, 1]


@pytest.mark.parametrize("room", [0, 50, 2500])
def test_a_channel_whose_declaration_was_not_written_is_declared_by_the_next_message(
    journal: Journal, room: int
) -> None:
    with full_disk(journal, room), pytest.raises(LogWriteError):
        journal.append(_beat(0))
    journal.append(signal_message(FloatSignal("r", "distance", 3, 0.5), 3))
    journal.append(_beat(0))
    contents = read_streamed(journal.path.read_bytes())
    assert contents.problems == []
    assert {channel.topic for channel in contents.channels.values()} == {"/hrc/events", "/hrc/signals/distance"}
    assert _seqs(journal) == [0]


def test_an_interrupt_in_the_middle_of_a_write_leaves_nothing_behind(
    journal: Journal, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal.append(_beat(0))
    write = os.write

    def interrupted(fd: int, data: bytes) -> int:
        write(fd, data[:20])
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(os, "write", interrupted)
        with pytest.raises(KeyboardInterrupt):
            journal.append(_beat(1))
    journal.append(_beat(1))
    assert _seqs(journal) == [0, 1]


def test_a_write_that_the_system_takes_in_pieces_is_completed(
    journal: Journal, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = os.write
    monkeypatch.setattr(os, "write", lambda fd, data: write(fd, data[:7]))
    journal.append(_beat(0))
    assert _seqs(journal) == [0]


def test_each_message_is_synced_if_wished(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[int] = []
    fsync = os.fsync
    monkeypatch.setattr(os, "fsync", lambda fd: (synced.append(fd), fsync(fd)))
    journal = Journal(tmp_path / "a.partial", fsync=True)
    assert len(synced) == 2  # the file and the name in its folder
    journal.append(_beat(0), _beat(1))
    journal.close()
    assert len(synced) == 3


def test_a_journal_is_not_overwritten(journal: Journal) -> None:
    with pytest.raises(LogExistsError, match="hrclog recover"):
        Journal(journal.path)


@pytest.mark.parametrize("name", ["nowhere/run.partial", "n" * 300, "a\0b"])
def test_a_journal_that_cannot_be_created_is_said_so(tmp_path: Path, name: str) -> None:
    with pytest.raises(LogWriteError, match="cannot be created"):
        Journal(tmp_path / name)


def test_a_journal_may_be_closed_twice(journal: Journal) -> None:
    journal.close()
    journal.close()


def test_a_time_outside_the_format_is_refused_and_costs_nothing(journal: Journal) -> None:
    with pytest.raises(InvalidEventError, match="found times"):
        journal.append(Message(EVENTS, 2**64, 0, b""))
    with pytest.raises(InvalidEventError, match="found times"):
        journal.append(Message(lane("robot"), 0, -1, b""))
    journal.append(_beat(0))
    assert _seqs(journal) == [0]


def test_a_journal_has_as_many_channels_as_the_format_numbers(
    journal: Journal, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hrclog.log.writing.journal._MAX_CHANNELS", 2)
    journal.append(_beat(0))
    journal.append(signal_message(FloatSignal("r", "a", 3, 0.5), 3))
    with pytest.raises(InvalidEventError, match="has 2 channels already"):
        journal.append(signal_message(FloatSignal("r", "b", 3, 0.5), 3))


def test_a_journal_lies_beside_its_log() -> None:
    assert journal_path(Path("logs/run.mcap")) == Path("logs/run.mcap.partial")
