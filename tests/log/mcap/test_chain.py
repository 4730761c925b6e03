"""The chain of a journal: what is taken out, doubled, moved or put in before its last message is told."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader

from hrclog.diagnostic import Diagnostic, loses_data
from hrclog.events import Event, Heartbeat, RunStarted, TaskEnded, TaskStarted
from hrclog.log.logs import Logs
from hrclog.log.mcap.records import Walk
from hrclog.log.messages.encode import FloatSignal, Message, event_message, run_metadata, signal_message
from hrclog.log.one_log import read_log
from hrclog.log.recover import recover
from hrclog.log.writing.journal import Journal
from hrclog.log.writing.lanes import Lanes
from hrclog.log.writing.writer import RUN_METADATA

N_TASKS = 6


def write_journal(path: Path, run_id: str = "r", *, level: float = 0.5) -> bytes:
    """Leave the journal of a run of a few tasks and samples; return its bytes."""
    journal, lanes = Journal(path), Lanes()
    started = RunStarted(time_ns=1, run_id=run_id, name="run")
    events: list[Event] = [started]
    for number in range(N_TASKS):
        identity = {"run_id": run_id, "agent": "robot", "task": f"pick {number}", "execution_id": f"{run_id}{number}"}
        events.append(TaskStarted(time_ns=10 * number + 2, **identity))
        events.append(TaskEnded(time_ns=10 * number + 8, **identity))
    for seq, event in enumerate(events):
        numbered = replace(event, seq=seq)
        journal.append(event_message(numbered, event.time_ns), *lanes.after(numbered, event.time_ns))
        if not seq:
            journal.metadata(RUN_METADATA, run_metadata(started))
        journal.append(sample(run_id, event.time_ns, level + seq))
    for late in range(5):
        journal.append(sample(run_id, 200 + late, level))
    journal.close()
    return path.read_bytes()


def sample(run_id: str, time_ns: int, value: float) -> Message:
    return signal_message(FloatSignal(run_id, "distance", time_ns, value), time_ns)


class Facts(NamedTuple):
    """What a file says, apart from what is remarkable about it."""

    events: list[tuple[object, ...]]
    samples: list[tuple[object, ...]]

    @classmethod
    def of(cls, logs: Logs) -> Facts:
        """Return what was read, without what a recovery remarked."""
        remarks = pl.col("kind") == "annotation_added"
        return cls(
            logs.events.filter(~remarks).drop("path").sort("run_id", "seq").rows(),
            logs.signals.drop("run_id").sort("name", "time_ns", "value").rows(),
        )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("chain")


@pytest.fixture(scope="module")
def pieces(folder: Path) -> list[bytes]:
    """Return the records of a journal, the magic bytes first."""
    return records_of(write_journal(folder / "whole.mcap.partial"))


@pytest.fixture(scope="module")
def strange(folder: Path) -> list[bytes]:
    """Return the records of a journal of as many messages of another run."""
    return records_of(write_journal(folder / "strange.mcap.partial", "s", level=7.0))


def records_of(data: bytes) -> list[bytes]:
    return [data[:8], *(data[record[1] : record[3]] for record in Walk(data, []))]


def read(folder: Path, pieces: Iterable[bytes]) -> Logs:
    path = folder / "run.mcap.partial"
    path.write_bytes(b"".join(pieces))
    return read_log(path, signals=True)


def is_told(folder: Path, pieces: list[bytes], whole: list[bytes]) -> list[Diagnostic]:
    """Assert that a changed journal says what the whole one does, or that data was lost, as its recovery does too."""
    changed = read(folder, pieces)
    told = loses_data(changed.diagnostics)
    assert told or Facts.of(changed) == Facts.of(read(folder, whole))
    for path in folder.glob("run.*mcap*"):
        if path.name != "run.mcap.partial":
            path.unlink()
    if changed.events.height or changed.signals.height:
        recovered = recover(folder / "run.mcap.partial")
        after = read_log(recovered.path, signals=True)
        assert Facts.of(after) == Facts.of(changed)
        assert loses_data(after.diagnostics) is bool(recovered.problems)
        assert recovered.problems or not told or "no_events" in {one.code for one in changed.diagnostics}
    return changed.diagnostics


def messages(pieces: list[bytes]) -> list[int]:
    """Return which records are chunks of a message."""
    return [i for i, piece in enumerate(pieces) if piece[0] == Opcode.CHUNK and piece[49] == Opcode.MESSAGE]


some = settings(max_examples=20)


@some
@given(data=st.data())
def test_a_record_that_is_taken_out_is_told_with_its_count(
    data: st.DataObject, folder: Path, pieces: list[bytes]
) -> None:
    places = messages(pieces)
    first = data.draw(st.integers(0, len(places) - 2))
    n_gone = data.draw(st.integers(1, len(places) - 1 - first))
    gone = places[first : first + n_gone]
    found = is_told(folder, [piece for i, piece in enumerate(pieces) if i not in gone], pieces)
    texts = [(one.message, one.offset) for one in found if one.code == "broken_chain"]
    before = sum(len(piece) for i, piece in enumerate(pieces[: places[first + n_gone]]) if i not in gone)
    words = "message is" if n_gone == 1 else "messages are"
    assert texts == [(f"{n_gone} {words} missing before this one, number {first + n_gone}", before)]


@some
@given(data=st.data())
def test_a_record_that_is_doubled_is_told_and_counted_once(
    data: st.DataObject, folder: Path, pieces: list[bytes]
) -> None:
    place = data.draw(st.sampled_from(messages(pieces)))
    at = data.draw(st.integers(place + 1, len(pieces)))
    found = is_told(folder, [*pieces[:at], pieces[place], *pieces[at:]], pieces)
    begins = sum(map(len, pieces[:place])), sum(map(len, pieces[:at]))  # of either of the two
    text = "1 message is there twice and was counted once"
    (told_at,) = (one.offset for one in found if one.message.startswith(text))
    assert told_at is not None
    assert any(begin <= told_at < begin + len(pieces[place]) for begin in begins)
    assert Facts.of(read(folder, [*pieces[:at], pieces[place], *pieces[at:]])) == Facts.of(read(folder, pieces))


@some
@given(data=st.data())
def test_records_that_change_places_are_told(data: st.DataObject, folder: Path, pieces: list[bytes]) -> None:
    one, other = sorted(data.draw(st.lists(st.integers(1, len(pieces) - 1), min_size=2, max_size=2, unique=True)))
    swapped = list(pieces)
    swapped[one], swapped[other] = swapped[other], swapped[one]
    found = is_told(folder, swapped, pieces)
    if {one, other} <= set(messages(pieces)):
        assert "broken_chain" in {diagnostic.code for diagnostic in found}


@some
@given(data=st.data())
def test_records_of_another_journal_are_told(
    data: st.DataObject, folder: Path, pieces: list[bytes], strange: list[bytes]
) -> None:
    # behind the first message: before that, a tail of the other journal is all of it
    at = data.draw(st.integers(messages(pieces)[0] + 1, len(pieces) - 1))
    other = data.draw(st.integers(2, len(pieces) - 1))
    changes = {
        "put in": [*pieces[:at], strange[other], *pieces[at:]],
        "put in place": [*pieces[:at], strange[at], *pieces[at + 1 :]],
        "tail": [*pieces[:at], *strange[other:]],
    }
    is_told(folder, changes[data.draw(st.sampled_from(sorted(changes)))], pieces)


def test_a_sample_of_another_journal_with_the_same_number_is_told(
    folder: Path, pieces: list[bytes], strange: list[bytes]
) -> None:
    place = messages(pieces)[-3]
    found = read(folder, [*pieces[:place], strange[place], *pieces[place + 1 :]]).diagnostics
    assert {one.code for one in found} == {"broken_chain", "unfinished_log"}
    assert "the journal was pieced together" in " ".join(one.message for one in found)


def test_a_channel_that_is_declared_otherwise_is_told(folder: Path, pieces: list[bytes], strange: list[bytes]) -> None:
    declarations = [piece for piece in pieces if piece[0] == Opcode.CHUNK and b"distance" in piece]
    foreign = [piece for piece in strange if piece[0] == Opcode.CHUNK and b"distance" in piece]
    assert len(declarations) == len(foreign) == 2
    changed = [foreign[0] if piece == declarations[0] else piece for piece in pieces]
    found = read(folder, changed).diagnostics
    text = f"{2 * N_TASKS + 6} messages were written to a channel that is declared otherwise here"
    assert [one.message.partition(";")[0] for one in found if one.code == "broken_chain"] == [text]


@pytest.mark.parametrize("n_cut", [1, 2, 7])
def test_a_journal_that_ends_earlier_is_only_unfinished(n_cut: int, folder: Path, pieces: list[bytes]) -> None:
    found = read(folder, pieces[:-n_cut]).diagnostics
    assert [one.code for one in found] == ["unfinished_log"]
    path = folder / "run.mcap.partial"
    assert recover(path, folder / f"ended{n_cut}.mcap").problems == []
    assert read_log(folder / f"ended{n_cut}.mcap").diagnostics == []


def test_a_journal_without_links_says_nothing_of_a_record_that_is_gone(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hrclog.log.writing.journal.link", lambda *_: b"")
    pieces = records_of(write_journal(folder / "old.mcap.partial"))
    whole = read(folder, pieces)
    assert [one.code for one in whole.diagnostics] == ["unfinished_log"]
    place = messages(pieces)[-3]
    less = read(folder, [*pieces[:place], *pieces[place + 1 :]])
    assert [one.code for one in less.diagnostics] == ["unfinished_log"]
    assert less.signals.height == whole.signals.height - 1


def test_a_message_without_a_link_is_a_stranger_among_those_that_have_one(
    folder: Path, pieces: list[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hrclog.log.writing.journal.link", lambda *_: b"")
    old = records_of(write_journal(folder / "old2.mcap.partial", level=3.0))
    place = messages(old)[-1]
    found = read(folder, [*pieces, old[place]]).diagnostics
    assert found[0].code == "broken_chain"
    assert found[0].offset == sum(map(len, pieces)) + 49
    assert "not of this journal" in found[0].message


def test_an_interrupt_or_a_full_disk_does_not_break_the_chain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    journal = Journal(tmp_path / "run.mcap.partial")
    beats = [event_message(Heartbeat(time_ns=seq, run_id="r", seq=seq), seq) for seq in range(3)]
    write_all = Journal._write_all
    for error in (OSError(28, "No space left on device"), KeyboardInterrupt()):

        def fail(self: Journal, data: bytes, error: BaseException = error) -> None:
            write_all(self, data)
            raise error

        with monkeypatch.context() as patch:
            patch.setattr(Journal, "_write_all", fail)
            with pytest.raises(Exception if isinstance(error, OSError) else KeyboardInterrupt):
                journal.append(beats[0])
    for beat in beats:
        journal.append(beat)
    journal.close()
    assert [one.code for one in read_log(journal.path).diagnostics] == ["unfinished_log"]


def test_other_readers_read_a_journal_past_its_links(folder: Path, pieces: list[bytes]) -> None:
    path = folder / "whole.mcap.partial"
    with path.open("rb") as stream:
        reader = NonSeekingReader(stream, validate_crcs=True)
        read_by_mcap: list[bytes] = []
        try:
            read_by_mcap.extend(message.data for _, _, message in reader.iter_messages(log_time_order=False))
        except Exception as error:  # noqa: BLE001 - a journal has no end, which mcap says in ways of its own
            assert "end" in type(error).__name__.lower() + str(error).lower()  # noqa: PT017 - it may also say nothing
    assert len(read_by_mcap) == len(messages(pieces))
