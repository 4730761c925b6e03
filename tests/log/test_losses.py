"""A recovered log says for good what its source had lost, and never looks cleaner than it."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest
from folders import names_in
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

import hrclog.log.writing.writer
from hrclog.diagnostic import Diagnostic, loses_data
from hrclog.errors import LogReadError
from hrclog.event_rows import from_row, parse_details
from hrclog.events import AnnotationAdded, Event, Heartbeat, RunEnded, RunStarted
from hrclog.log.logs import Logs
from hrclog.log.mcap.records import Walk
from hrclog.log.messages.encode import FloatSignal, event_message, signal_message
from hrclog.log.one_log import read_log
from hrclog.log.reader import read_logs
from hrclog.log.recover import recover
from hrclog.log.remarks import RECOVERED
from hrclog.log.writing.journal import LIBRARY, Journal
from hrclog.log.writing.writer import write_log

N_EVENTS = 40
CODE = "recovered_with_losses"


def events_of(run_id: str, n_events: int = N_EVENTS) -> list[Event]:
    beats = [Heartbeat(time_ns=10 * i, run_id=run_id) for i in range(1, n_events - 1)]
    ended = RunEnded(time_ns=10 * n_events, run_id=run_id)
    return [RunStarted(time_ns=1, run_id=run_id, name=f"run {run_id}"), *beats, ended]


@pytest.fixture
def closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a closed log of two runs in many chunks."""
    monkeypatch.setattr(hrclog.log.writing.writer, "_CHUNK_SIZE", 1000)
    path = tmp_path / "run.mcap"
    write_log(path, [*events_of("a"), *events_of("b", 5)], [FloatSignal("a", "distance", i, 0.5) for i in range(60)])
    return path


def halved(path: Path) -> bytes:
    """Cut a log in the middle; return what is left."""
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    return path.read_bytes()


def told(diagnostics: list[Diagnostic]) -> list[str]:
    return [one.message for one in diagnostics if one.code == CODE]


def test_a_recovered_log_tells_in_its_metadata_what_was_lost(closed: Path) -> None:
    left = halved(closed)
    recovered = recover(closed)
    assert len(recovered.problems) == 1
    (problem,) = recovered.problems
    with recovered.path.open("rb") as stream:
        (record,) = (record for record in make_reader(stream).iter_metadata() if record.name == RECOVERED)
    loss = record.metadata
    assert (loss["version"], loss["source"], loss["source_bytes"]) == (LIBRARY, "run.mcap", str(len(left)))
    assert (loss["n_losses"], loss["lost_bytes"]) == ("1", str(len(left) - problem.offset))
    (place,) = json.loads(loss["losses"])
    assert (place["offset"], place["bytes"]) == (problem.offset, len(left) - problem.offset)
    (text,) = told(read_log(recovered.path).diagnostics)
    assert LIBRARY in text
    assert f"run.mcap of {len(left):,} bytes" in text
    assert f"byte {problem.offset}: {problem.message}" in text


def test_every_run_of_a_recovered_log_has_an_annotation_at_its_last_event(closed: Path) -> None:
    data = closed.read_bytes()
    chunks = [record for record in Walk(data, []) if record[0] == Opcode.CHUNK]
    at = chunks[3][2] + 40
    closed.write_bytes(data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :])
    before = read_log(closed)
    after = read_log(recover(closed).path)
    remarks = after.events.filter(pl.col("kind") == "annotation_added")
    ends = before.events.group_by("run_id").agg(pl.col("seq").max(), pl.col("time_ns").max()).sort("run_id")
    assert remarks.select("run_id", "seq", "time_ns").sort("run_id").equals(ends)
    assert after.events.height == before.events.height + 2
    remark = from_row(remarks.row(0, named=True))
    assert isinstance(remark, AnnotationAdded)
    assert "run.mcap" in remark.reason
    assert parse_details(remarks["details"][0])[RECOVERED]["version"] == LIBRARY
    with recover(closed).path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert [channel.topic for channel in summary.channels.values()] == ["/hrc/events", "/hrc/signals/distance"]


def test_a_recovery_of_a_recovered_log_keeps_what_was_lost(closed: Path) -> None:
    halved(closed)
    first = recover(closed).path
    data = first.read_bytes()
    again = recover(first)
    assert (again.path, again.problems) == (first, [])
    assert again.earlier == told(read_log(first).diagnostics)
    assert first.read_bytes() == data
    first.write_bytes(data[:-30])  # the metadata lie before that
    second = recover(first)
    texts = told(read_log(second.path).diagnostics)
    assert len(texts) == 2
    assert again.earlier[0] in texts
    assert second.earlier == again.earlier


def test_the_annotation_tells_of_the_loss_where_the_metadata_are_gone(closed: Path, tmp_path: Path) -> None:
    halved(closed)
    recovered = recover(closed).path
    known = told(read_log(recovered).diagnostics)
    events = [from_row(row) for row in read_log(recovered).events.iter_rows(named=True)]
    write_log(tmp_path / "copy.mcap", events)
    copied = read_logs(tmp_path / "copy.mcap")
    assert told(copied.diagnostics) == known
    both = read_logs([recovered, tmp_path / "copy.mcap"])
    assert told(both.diagnostics) == known


def test_a_recovery_that_forgot_the_loss_is_written_anew(closed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    halved(closed)
    with monkeypatch.context() as patch:
        patch.setattr("hrclog.log.recover.loss_of", lambda *_: None)
        target = recover(closed).path
    assert read_log(target).diagnostics == []
    recover(closed)
    assert len(told(read_log(target).diagnostics)) == 1
    lossy = target.read_bytes()
    recover(closed)
    assert target.read_bytes() == lossy


def test_an_undamaged_journal_is_recovered_without_a_word(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "run.mcap.partial")
    journal.append(event_message(Heartbeat(time_ns=1, run_id="r"), 1))
    journal.close()
    recovered = recover(journal.path)
    assert (recovered.problems, recovered.earlier) == ([], [])
    assert RECOVERED.encode() not in recovered.path.read_bytes()


def test_a_file_that_lost_all_its_events_tells_of_it_in_metadata_alone(closed: Path) -> None:
    data = closed.read_bytes()
    chunks = [record for record in Walk(data, []) if record[0] == Opcode.CHUNK]
    hurt = bytearray(data)
    for chunk in chunks:
        if b"distance" not in data[chunk[1] : chunk[3]] and chunk is not chunks[-1]:
            hurt[chunk[2] + 40] ^= 1
    closed.write_bytes(bytes(hurt))
    before = read_log(closed, signals=True)
    after = read_log(recover(closed).path, signals=True)
    assert after.events.filter(pl.col("kind") != "annotation_added").height == before.events.height
    assert len(told(after.diagnostics)) == 1


def unprotected_journal(folder: Path, data: bytes) -> Path:
    """Return the messages of a log as a journal that has no checksum."""
    path = folder / "bare.mcap.partial"
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=False, compression=CompressionType.NONE, enable_crcs=False)
        writer.start("ros2", "another recorder")
        ids: dict[int, int] = {}
        for schema, channel, message in make_reader(io.BytesIO(data)).iter_messages(log_time_order=False):
            assert schema is not None
            if channel.id not in ids:
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schema_id, channel.metadata
                )
            times = message.log_time, message.data, message.publish_time, message.sequence
            writer.add_message(ids[channel.id], *times)
        writer.finish()
    data = path.read_bytes()
    end = next(record[1] for record in Walk(data, []) if record[0] == Opcode.DATA_END)
    path.write_bytes(data[:end])
    return path


@pytest.mark.parametrize("n_cut", [0, 3])
def test_a_log_recovered_from_a_file_without_checksums_says_so(closed: Path, tmp_path: Path, n_cut: int) -> None:
    journal = unprotected_journal(tmp_path, closed.read_bytes())
    data = journal.read_bytes()
    journal.write_bytes(data[: len(data) - n_cut])
    before = read_log(journal)
    recovered = recover(journal)
    after = read_log(recovered.path)
    (remark,) = (finding for finding in after.diagnostics if finding.code == "unprotected")
    assert "bare.mcap.partial" in remark.message
    assert remark.severity == "info"
    assert bool(told(after.diagnostics)) is bool(n_cut)
    assert loses_data(after.diagnostics) is loses_data(before.diagnostics) is bool(n_cut)
    write_log(tmp_path / "copy.mcap", [from_row(row) for row in after.events.iter_rows(named=True)])
    copied = read_logs(tmp_path / "copy.mcap").diagnostics
    assert [finding.message for finding in copied if finding.code == "unprotected"] == [remark.message]
    assert told(copied) == told(after.diagnostics)
    journal.write_bytes(data[: len(data) - n_cut])
    assert recover(journal).path.read_bytes() == recovered.path.read_bytes()


@pytest.mark.parametrize("n_lost", [0, 1, 2, 5])
def test_the_annotation_takes_no_number_of_an_event(tmp_path: Path, n_lost: int) -> None:
    events = [replace(event, seq=seq) for seq, event in enumerate(events_of("a", 20))]
    write_parts(tmp_path, events[: 12 - n_lost], events[12:])
    whole = read_logs(tmp_path).diagnostics
    source = tmp_path / "a.mcap"
    source.write_bytes(source.read_bytes()[:-30])
    recovered = recover(source)
    assert recovered.problems
    source.unlink()
    both = read_logs(tmp_path).diagnostics
    missing = [finding.message for finding in whole if finding.code == "events_missing"]
    assert len(missing) == bool(n_lost)
    assert [finding.message for finding in both if finding.code != CODE] == missing


def write_parts(folder: Path, *parts: list[Event]) -> None:
    """Write a run into files a.mcap and b.mcap, each event with the number that it has."""
    for name, events in zip("ab", parts, strict=False):
        journal = Journal(folder / f"{name}.mcap.partial")
        journal.append(*(event_message(event, event.time_ns) for event in events))
        journal.close()
        recover(journal.path)


def test_a_recovered_log_whose_numbers_were_never_set_is_numbered(tmp_path: Path) -> None:
    write_parts(tmp_path, [replace(event, seq=0) for event in events_of("a", 20)])
    source = tmp_path / "a.mcap"
    source.write_bytes(source.read_bytes()[:-30])
    codes = sorted(finding.code for finding in read_logs(recover(source).path).diagnostics)
    assert codes == [CODE, "seq_never_set"]


def test_a_run_of_one_event_is_recovered_without_a_word_on_its_number(tmp_path: Path) -> None:
    write_parts(tmp_path, events_of("a", 2)[:1])
    source = tmp_path / "a.mcap"
    source.write_bytes(source.read_bytes()[:-30])
    assert [finding.code for finding in read_logs(recover(source).path).diagnostics] == [CODE]


def test_the_annotation_says_nothing_of_clocks(tmp_path: Path) -> None:
    day_ns = 86_400 * 10**9
    journal = Journal(tmp_path / "late.mcap.partial")
    for seq in range(30):
        beat = Heartbeat(time_ns=seq * 10**9, run_id="a", seq=seq, agent="robot")
        journal.append(event_message(beat, 3 * day_ns + seq))
    journal.close()
    data = journal.path.read_bytes()
    before = {finding.code for finding in read_logs(journal.path).diagnostics}
    journal.path.write_bytes(data[:-3])
    after = {finding.code for finding in read_logs(recover(journal.path).path).diagnostics}
    assert after == before - {"unfinished_log"} | {CODE}


@settings(max_examples=40)
@given(
    where=st.floats(0, 1, exclude_max=True),
    change=st.sampled_from(["cut", "flip", "zeros", "gap", "record", "double"]),
    is_journal=st.booleans(),
)
def test_a_recovered_log_never_looks_cleaner_than_its_source(
    where: float, change: str, is_journal: bool, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("damaged")
    source = folder / ("run.mcap.partial" if is_journal else "run.mcap")
    source.write_bytes(changed(whole(folder, is_journal=is_journal), where, change))
    before = read_or_none(source)
    try:
        recovered = recover(source)
    except LogReadError:
        assert before is None or loses_data(before.diagnostics)
        assert source.name in names_in(folder)
        return
    after = read_log(recovered.path, signals=True)
    assert before is None or loses_data(after.diagnostics) >= loses_data(before.diagnostics)
    assert bool(told(after.diagnostics)) is bool(recovered.problems)


def whole(folder: Path, *, is_journal: bool) -> bytes:
    """Return the bytes of a journal or a closed log."""
    events = events_of("a")
    if not is_journal:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(hrclog.log.writing.writer, "_CHUNK_SIZE", 1000)
            write_log(folder / "whole.mcap", events, [FloatSignal("a", "distance", i, 0.5) for i in range(30)])
        return (folder / "whole.mcap").read_bytes()
    journal = Journal(folder / "whole")
    for seq, event in enumerate(events):
        journal.append(event_message(replace(event, seq=seq), event.time_ns))
        journal.append(signal_message(FloatSignal("a", "distance", seq, 0.5), event.time_ns))
    journal.close()
    return journal.path.read_bytes()


def changed(data: bytes, where: float, change: str) -> bytes:
    """Return a file with a change at a place."""
    at = int(where * len(data))
    records = [data[record[1] : record[3]] for record in Walk(data, [])]
    place = int(where * len(records))
    match change:
        case "cut":
            return data[:at]
        case "flip":
            return data[:at] + bytes([data[at] ^ 64]) + data[at + 1 :]
        case "zeros":
            return data[:at] + bytes(len(data[at : at + 40])) + data[at + 40 :]
        case "gap":
            return data[:at] + data[at + 300 :]
        case "record":
            return data[:8] + b"".join(records[:place] + records[place + 1 :])
        case _:
            return data[:8] + b"".join(records[:place] + records[place : place + 1] + records[place:])


def read_or_none(path: Path) -> Logs | None:
    try:
        return read_log(path, signals=True)
    except LogReadError:
        return None
