"""Recovery: every message that can be read, nothing invented, nothing overwritten."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import polars as pl
import pytest
import zstandard
from folders import names_in
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer

from hrclog.diagnostic import loses_data
from hrclog.errors import LogExistsError, LogReadError
from hrclog.events import Heartbeat, RunStarted, TaskStarted
from hrclog.log.mcap.indexed import read_indexed
from hrclog.log.mcap.streamed import read_streamed
from hrclog.log.messages.encode import FloatSignal, event_message, run_metadata, signal_message
from hrclog.log.reader import read_logs
from hrclog.log.recover import finished_path, recover
from hrclog.log.writing.journal import Journal
from hrclog.log.writing.lanes import Lanes
from hrclog.log.writing.writer import RUN_METADATA, write_log

N_EVENTS = 22


def write_journal(folder: Path, name: str = "run.mcap.partial") -> Journal:
    """Leave a journal of 22 events, a lane and two signals, as a killed recorder does."""
    journal, lanes = Journal(folder / name), Lanes()
    started = RunStarted(time_ns=1, run_id="r", name="run")
    task = TaskStarted(time_ns=2, run_id="r", seq=1, agent="robot", task="pick", execution_id="e")
    journal.append(event_message(started, 1))
    journal.metadata(RUN_METADATA, run_metadata(started))
    journal.append(event_message(task, 2), *lanes.after(task, 2))
    journal.append(signal_message(FloatSignal("r", "distance", 3, 0.5), 3))
    for seq in range(2, N_EVENTS):
        journal.append(event_message(Heartbeat(time_ns=seq, run_id="r", seq=seq), seq))
    journal.append(signal_message(FloatSignal("r", "distance", 30, 0.25), 30))
    journal.close()
    return journal


def without_remarks(events: pl.DataFrame) -> pl.DataFrame:
    """Return events without what a recovery says of its loss."""
    return events.filter(pl.col("kind") != "annotation_added").drop("path")


def test_a_recovered_journal_is_a_finished_log_of_the_same_messages(tmp_path: Path) -> None:
    journal = write_journal(tmp_path)
    before = read_logs(journal.path, signals=True)
    recovered = recover(journal.path)
    assert (recovered.n_messages, recovered.problems) == (N_EVENTS + 3, [])
    assert recovered.path == tmp_path / "run.mcap"
    assert names_in(tmp_path) == ["run.mcap"]
    after = read_logs(recovered.path, signals=True)
    assert after.events.drop("path").equals(before.events.drop("path"))
    assert after.signals.equals(before.signals)
    assert after.diagnostics == []
    contents = read_indexed(recovered.path.read_bytes())
    assert contents.metadata[0].metadata["name"] == "run"
    assert [channel.topic for channel in contents.channels.values()] == [
        "/hrc/events", "/hrc/agents/robot/active_task", "/hrc/signals/distance",
    ]  # fmt: skip


@settings(max_examples=25)
@given(st.floats(0, 1))
def test_a_torn_journal_is_recovered_up_to_the_tear_and_kept(tmp_path: Path, where: float) -> None:
    for path in tmp_path.iterdir():
        path.unlink()
    journal = write_journal(tmp_path)
    whole = journal.path.read_bytes()
    torn = whole[: 50 + int(where * (len(whole) - 50))]
    journal.path.write_bytes(torn)
    before = read_logs(journal.path)
    if before.events.is_empty():
        with pytest.raises(LogReadError, match="without a readable message"):
            recover(journal.path)
        assert names_in(tmp_path) == ["run.mcap.partial"]
        return
    recovered = recover(journal.path)
    after = read_logs(recovered.path)
    assert without_remarks(after.events).equals(before.events.drop("path"))
    assert loses_data(after.diagnostics) is loses_data(before.diagnostics)
    kept = tmp_path / "run.mcap.partial.damaged"
    assert kept.exists() is bool(recovered.problems)
    assert not journal.path.exists()
    if kept.exists():
        assert kept.read_bytes() == torn


def test_every_damaged_journal_is_kept_under_a_name_of_its_own(tmp_path: Path) -> None:
    journal = write_journal(tmp_path)
    whole = journal.path.read_bytes()
    for cut in (10, 20, 30):
        journal.path.write_bytes(whole[:-cut])
        recover(journal.path, tmp_path / f"{cut}.mcap")
    kept = {path.name: len(path.read_bytes()) - len(whole) for path in tmp_path.glob("*.damaged*")}
    name = "run.mcap.partial.damaged"
    assert kept == {name: -10, f"{name}.2": -20, f"{name}.3": -30}


def test_recovery_goes_where_it_is_told(tmp_path: Path) -> None:
    journal = write_journal(tmp_path)
    assert recover(journal.path, tmp_path / "other.mcap").path == tmp_path / "other.mcap"
    assert names_in(tmp_path) == ["other.mcap"]


def test_a_journal_that_a_recorder_holds_is_left_alone(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "run.mcap.partial")
    journal.append(event_message(Heartbeat(time_ns=1, run_id="r"), 1))
    with pytest.raises(LogReadError, match="a journal that a recorder still writes"):
        recover(journal.path)
    assert names_in(tmp_path) == ["run.mcap.partial"]
    journal.close()
    recover(journal.path)
    assert names_in(tmp_path) == ["run.mcap"]


def test_a_journal_beside_the_finished_log_of_the_same_messages_is_only_removed(tmp_path: Path) -> None:
    journal = write_journal(tmp_path)
    left = journal.path.read_bytes()
    finished = recover(journal.path).path.read_bytes()
    journal.path.write_bytes(left)
    recover(journal.path)
    assert names_in(tmp_path) == ["run.mcap"]
    assert (tmp_path / "run.mcap").read_bytes() == finished


@pytest.mark.parametrize("content", [b"", b"something else", None])
def test_a_target_that_holds_something_else_is_not_overwritten(tmp_path: Path, content: bytes | None) -> None:
    journal = write_journal(tmp_path)
    target = tmp_path / "run.mcap"
    if content is None:
        write_log(target, [Heartbeat(time_ns=9, run_id="r")])
    else:
        target.write_bytes(content)
    before = target.read_bytes()
    with pytest.raises(LogExistsError, match="it differs from"):
        recover(journal.path)
    assert target.read_bytes() == before
    assert journal.path.exists()


def test_a_folder_in_the_way_is_not_overwritten(tmp_path: Path) -> None:
    journal = write_journal(tmp_path)
    (tmp_path / "run.mcap").mkdir()
    with pytest.raises(LogExistsError):
        recover(journal.path)


def test_a_damaged_finished_log_is_kept_beside_its_recovery_and_may_be_recovered_again(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    write_log(path, [Heartbeat(time_ns=time_ns, run_id="r") for time_ns in range(5)])
    damaged = path.read_bytes()[:-30]
    path.write_bytes(damaged)
    recovered = recover(path)
    assert recovered.path == tmp_path / "run.recovered.mcap"
    assert path.read_bytes() == damaged
    assert without_remarks(read_logs(recovered.path).events).height == 5
    assert read_indexed(recovered.path.read_bytes()).finished
    first = recovered.path.read_bytes()
    assert recover(path).path.read_bytes() == first


@pytest.mark.parametrize("content", [b"", b"\x89MCAP", b"no log at all", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n\x01\x18\0"])
def test_a_file_without_a_header_is_refused_and_kept(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "run.mcap.partial"
    path.write_bytes(content)
    with pytest.raises(LogReadError, match="0 events can be recovered"):
        recover(path)
    assert path.read_bytes() == content
    assert names_in(tmp_path) == [path.name]


@pytest.mark.parametrize(
    ("content", "is_nothing"),
    [
        (b"", True),
        (bytes(4096), True),
        (b"\x89MCAP", True),
        (b"\x89MCAP0\r\n", True),
        (b"\x89MCAP0\r\n\x01\x18\0\0\0\0\0\0\0\4\0\0\0ros2", True),
        (b"\x89MCAP0\r\n" + b"?" * 900, False),
        (b"a text", False),
        (b'{"kind": "task_started"}', False),
        (b"PK\3\4 an archive", False),
    ],
)
def test_only_what_holds_nothing_may_be_deleted(tmp_path: Path, content: bytes, is_nothing: bool) -> None:
    path = tmp_path / "run.mcap.partial"
    path.write_bytes(content)
    with pytest.raises(LogReadError) as refusal:
        recover(path)
    assert ("delete it" in str(refusal.value)) is is_nothing


@pytest.mark.parametrize(
    ("name", "content"),
    [("a.db3", b"SQLite format 3\0" + bytes(90)), ("a.bag.active", b"#ROSBAG V2.0\n"), ("b.mcap", b"#ROSBAG V2.0\n")],
)
@pytest.mark.parametrize("packed", [bytes, gzip.compress, zstandard.compress])
def test_logs_of_other_formats_are_named_and_left_alone(
    tmp_path: Path, name: str, content: bytes, packed: Callable[[bytes], bytes]
) -> None:
    path = tmp_path / name
    path.write_bytes(packed(content))
    with pytest.raises(LogReadError, match=r"found a(n SQLite file| ROS 1 bag), .* read it as it is"):
        recover(path)
    assert names_in(tmp_path) == [name]


@pytest.mark.parametrize("packed", [gzip.compress, zstandard.compress])
@pytest.mark.parametrize(
    ("name", "target"),
    [("run.mcap.gz", "run.recovered.mcap"), ("run.mcap.partial.zst", "run.mcap"), ("run", "run.recovered.mcap")],
)
def test_a_compressed_log_is_recovered_beside_it(
    tmp_path: Path, name: str, target: str, packed: Callable[[bytes], bytes]
) -> None:
    journal = write_journal(tmp_path)
    path = tmp_path / name
    whole = packed(journal.path.read_bytes())
    path.write_bytes(whole)
    journal.path.unlink()
    before = read_logs(path, signals=True)
    recovered = recover(path)
    assert bool(recovered.problems) is ("partial" not in name)
    assert names_in(tmp_path) == sorted([name, target])
    after = read_logs(tmp_path / target, signals=True)
    assert without_remarks(after.events).equals(before.events.drop("path"))
    assert after.signals.equals(before.signals)
    closed = tmp_path / "closed.mcap.gz"
    closed.write_bytes(packed(closed_log(tmp_path)))
    assert recover(closed).path == closed


def test_of_a_compressed_log_that_breaks_off_the_loss_is_told(tmp_path: Path) -> None:
    whole = gzip.compress(write_journal(tmp_path).path.read_bytes())
    path = tmp_path / "torn.mcap.partial.gz"
    path.write_bytes(whole[: len(whole) * 3 // 4])
    torn = recover(path)
    assert "the compressed file is damaged" in torn.problems[0].message
    assert loses_data(read_logs(torn.path).diagnostics)


def closed_log(folder: Path) -> bytes:
    """Return the bytes of a closed log."""
    path = folder / "whole.mcap"
    write_log(path, [Heartbeat(time_ns=time_ns, run_id="r") for time_ns in range(5)])
    data = path.read_bytes()
    path.unlink()
    return data


@pytest.mark.parametrize("name", ["missing.mcap.partial", "a\0b", "n" * 300, "."])
def test_a_file_that_cannot_be_opened_is_said_so(tmp_path: Path, name: str) -> None:
    with pytest.raises(LogReadError, match="a file that cannot be opened"):
        recover(tmp_path / name)


def test_a_log_of_another_writer_keeps_its_schemas_and_channels(tmp_path: Path, data_dir: Path) -> None:
    source = tmp_path / "ten.mcap"
    source.write_bytes((data_dir / "mcap_conformance" / "TenMessages" / "TenMessages.mcap").read_bytes())
    before, after = (read_streamed(path.read_bytes()) for path in (source, recover(source).path))
    assert [list(batch.sequence) for batch in after.batches] == [list(batch.sequence) for batch in before.batches]
    assert [vars(schema) for schema in after.schemas.values()] == [vars(schema) for schema in before.schemas.values()]
    assert [channel.topic for channel in after.channels.values()] == ["example"]


def test_names_of_journals_lead_to_those_of_their_logs() -> None:
    assert finished_path(Path("a/run.2.mcap.partial")) == Path("a/run.2.mcap")
    assert finished_path(Path("a/run.2.mcap.partial.gz")) == Path("a/run.2.mcap")
    assert finished_path(Path("a/run.mcap.zstd")) == Path("a/run.recovered.mcap")
    assert finished_path(Path("a/run.mcap")) == Path("a/run.recovered.mcap")
    assert finished_path(Path("a/run.mcap.partial.damaged")) == Path("a/run.mcap.partial.recovered.mcap")


@given(st.integers(0, 2**64 - 1), st.integers(0, 2**64 - 1))
@example(2**63, 2**64 - 1)
@settings(max_examples=20)
def test_any_times_that_the_format_has_survive_a_recovery(tmp_path: Path, log_time: int, publish_time: int) -> None:
    source, target = tmp_path / "cut.mcap", tmp_path / "whole.mcap"
    target.unlink(missing_ok=True)
    with source.open("wb") as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start("ros2", "another recorder")
        channel = writer.register_channel("/other", "cdr", 0)
        writer.add_message(channel, log_time, b"data", publish_time)
        writer.finish()
    source.write_bytes(source.read_bytes()[:-8])
    recover(source, target)
    with target.open("rb") as stream:
        times = [(message.log_time, message.publish_time) for _, _, message in make_reader(stream).iter_messages()]
    assert times == [(log_time, publish_time)]
