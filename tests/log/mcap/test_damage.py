"""Damaged files: reading never breaks, gives all that lies outside the damage, and says that something was lost."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode

import hrclog.log.writing.writer
from hrclog.diagnostic import Diagnostic, loses_data
from hrclog.errors import LogReadError
from hrclog.events import Event, RunEnded, RunStarted, TaskEnded, TaskStarted
from hrclog.log.mcap.records import Walk, expand, record_at
from hrclog.log.messages.encode import FloatSignal, event_message, run_metadata, signal_message
from hrclog.log.one_log import read_log
from hrclog.log.reader import read_logs
from hrclog.log.writing.journal import Journal
from hrclog.log.writing.writer import RUN_METADATA, write_log

if TYPE_CHECKING:
    from collections.abc import Iterator

Row = tuple[Any, ...]

N_TASKS = 12
EVENTS = [
    RunStarted(time_ns=0, run_id="r", name="run"),
    *(
        event
        for i in range(N_TASKS)
        for event in (
            TaskStarted(time_ns=10 * i + 1, run_id="r", agent="robot", task=f"pick {i}", execution_id=f"e{i}"),
            TaskEnded(time_ns=10 * i + 6, run_id="r", agent="robot", task=f"pick {i}", execution_id=f"e{i}"),
        )
    ),
    RunEnded(time_ns=1000, run_id="r"),
]


class File:
    """A whole file, its rows by seq, and the spans of bytes in which each event and each declaration lies."""

    def __init__(self, path: Path, n_events: int = len(EVENTS)) -> None:
        self.path = path
        self.data = path.read_bytes()
        self.rows = _rows(path)[0]
        self.spans: dict[int, tuple[int, int]] = {}
        self.declarations: list[tuple[int, int]] = []
        for record in Walk(self.data, []):
            if record[0] == Opcode.CHUNK:
                self._take(record)
        assert set(self.rows) == set(self.spans) == set(range(n_events))

    def _take(self, chunk: tuple[int, int, int, int]) -> None:
        buffer, position, end = expand(self.data, chunk)
        while position < end:
            record = record_at(buffer, position, end)
            assert record is not None
            position = record[3]
            if record[0] == Opcode.CHANNEL and b"/hrc/events" in buffer[record[2] : record[3]]:
                self.declarations.append((chunk[1], chunk[3]))
            if record[0] == Opcode.MESSAGE and record[3] - record[2] > 100:
                self.spans[len(self.spans)] = (chunk[1], chunk[3])


@pytest.fixture(scope="module")
def journal(tmp_path_factory: pytest.TempPathFactory) -> File:
    path = tmp_path_factory.mktemp("journal") / "run.mcap.partial"
    journal = Journal(path)
    for seq, event in enumerate(EVENTS):
        journal.append(event_message(_numbered(event, seq), event.time_ns))
        if isinstance(event, RunStarted):
            journal.metadata(RUN_METADATA, run_metadata(event))
        if seq % 4 == 0:
            journal.append(signal_message(FloatSignal("r", "distance", event.time_ns, 0.5), event.time_ns))
    journal.close()
    return File(path)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Iterator[File]:
    path = tmp_path_factory.mktemp("finished") / "run.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hrclog.log.writing.writer, "_CHUNK_SIZE", 1500)
        write_log(path, EVENTS, [FloatSignal("r", "distance", i, 0.5) for i in range(100)])
    file = File(path)
    assert len(set(file.spans.values())) > 4
    return file


def _numbered(event: Event, seq: int) -> Event:

    return replace(event, seq=seq)


def _rows(path: Path) -> tuple[dict[int, Row], list[Diagnostic]]:
    logs = read_logs(path)
    return {row[2]: row for row in logs.events.rows()}, logs.diagnostics


def _check(file: File, damaged: bytes, hurt: set[int], *, visible: bool = True) -> list[Diagnostic]:
    """Assert that all events but the hurt ones are there and no others, and that a loss is said to be one."""
    file.path.write_bytes(damaged)
    found, diagnostics = _rows(file.path)
    assert found.items() <= file.rows.items()
    assert set(file.rows) - set(found) <= hurt
    assert not visible or len(found) == len(file.rows) or loses_data(diagnostics)
    return diagnostics


def _hurt(file: File, begin: int, end: int) -> set[int]:
    """Return the events that bytes belong to: all, if these hold all declarations of the event channel."""
    if all(first < end and begin < last for first, last in file.declarations):
        return set(file.rows)
    return {seq for seq, (first, last) in file.spans.items() if first < end and begin < last}


def _flip(data: bytes, bit: int) -> bytes:
    damaged = bytearray(data)
    damaged[bit // 8] ^= 1 << bit % 8
    return bytes(damaged)


many = settings(max_examples=40)


@many
@given(st.floats(0, 1, exclude_max=True))
@example(0.0)
def test_a_journal_cut_off_anywhere_holds_all_before_and_says_what_it_lost(journal: File, where: float) -> None:
    size = int(where * len(journal.data))
    whole = size in {record[3] for record in Walk(journal.data, [])}
    diagnostics = _check(journal, journal.data[:size], _hurt(journal, size, len(journal.data)), visible=not whole)
    codes = {diagnostic.code for diagnostic in diagnostics}
    assert codes <= {"truncated", "no_header", "no_events", "unfinished_log"}
    assert loses_data(diagnostics) is (not whole or size <= journal.spans[0][0])


@many
@given(st.floats(0, 1, exclude_max=True))
def test_a_finished_log_cut_off_anywhere_holds_all_before_and_says_that_its_end_is_missing(
    finished: File, where: float
) -> None:
    size = int(where * len(finished.data))
    diagnostics = _check(finished, finished.data[:size], _hurt(finished, size, len(finished.data)))
    assert {"truncated", "no_header"} & {diagnostic.code for diagnostic in diagnostics}


@many
@given(st.floats(0, 1, exclude_max=True))
def test_a_flipped_bit_in_a_journal_costs_no_event_but_the_one_it_lies_in(journal: File, where: float) -> None:
    bit = int(where * len(journal.data) * 8)
    _check(journal, _flip(journal.data, bit), _hurt(journal, bit // 8, bit // 8 + 1))


@many
@given(st.floats(0, 1, exclude_max=True))
def test_a_flipped_bit_in_a_finished_log_costs_no_chunk_but_the_one_it_lies_in(finished: File, where: float) -> None:
    bit = int(where * len(finished.data) * 8)
    _check(finished, _flip(finished.data, bit), _hurt(finished, bit // 8, bit // 8 + 1))


def test_a_flipped_bit_in_the_records_of_a_chunk_is_reported_as_corrupt_data(finished: File) -> None:
    begin, end = finished.spans[5]
    diagnostics = _check(finished, _flip(finished.data, (begin + end) * 4), _hurt(finished, begin, end))
    assert {"corrupt_data", "events_missing", "records_missing"} == {diagnostic.code for diagnostic in diagnostics}
    assert diagnostics[0].offset == begin
    assert "chunk" in diagnostics[0].message


@pytest.mark.slow
def test_every_bit_of_the_head_of_a_chunk_may_flip_without_harm_to_the_others(journal: File, finished: File) -> None:
    for file in (journal, finished):
        begin, end = file.spans[9]
        for bit in range(begin * 8, (begin + 50) * 8, 7):
            _check(file, _flip(file.data, bit), _hurt(file, begin, end))


@many
@given(st.floats(0, 1), st.integers(1, 800))
def test_bytes_that_are_missing_in_a_journal_cost_no_event_but_those_they_belong_to(
    journal: File, where: float, size: int
) -> None:
    begin = int(where * (len(journal.data) - size))
    damaged = journal.data[:begin] + journal.data[begin + size :]
    _check(journal, damaged, _hurt(journal, begin, begin + size))


@many
@given(st.floats(0, 1), st.integers(1, 800))
def test_bytes_that_are_missing_in_a_finished_log_cost_no_chunk_but_those_they_belong_to(
    finished: File, where: float, size: int
) -> None:
    begin = int(where * (len(finished.data) - size))
    damaged = finished.data[:begin] + finished.data[begin + size :]
    # the tail repeats the declarations that the first chunk holds, so only one of the two may be lost
    _check(finished, damaged, _hurt(finished, begin, begin + size))


@many
@given(st.floats(0, 1), st.binary(min_size=1, max_size=300))
def test_bytes_that_are_overwritten_cost_no_event_but_those_they_hit(journal: File, where: float, junk: bytes) -> None:
    begin = 16 + int(where * (len(journal.data) - len(junk) - 16))  # the first bytes tell the kind of file
    damaged = journal.data[:begin] + junk + journal.data[begin + len(junk) :]
    _check(journal, damaged, _hurt(journal, begin, begin + len(junk)))


@pytest.mark.parametrize("tail", [b"\0", b"\0" * 4096, b"\xff" * 100, b"\x06" * 5000, b"\x89MCAP0\r\n" * 3])
def test_bytes_that_were_appended_cost_nothing_and_are_reported(journal: File, finished: File, tail: bytes) -> None:
    for file in (journal, finished):
        assert "truncated" in {diagnostic.code for diagnostic in _check(file, file.data + tail, set())}


def test_the_first_bytes_may_be_lost(journal: File, finished: File) -> None:
    for file in (journal, finished):
        for size in (1, 8, 20):
            diagnostics = _check(file, b"\0" * size + file.data[size:], set())
            assert "corrupt_data" in {diagnostic.code for diagnostic in diagnostics}


def test_the_event_channel_is_declared_twice_in_a_journal(journal: File) -> None:
    assert len(journal.declarations) == 2
    for begin, end in journal.declarations:
        diagnostics = _check(journal, journal.data[:begin] + b"\0" * (end - begin) + journal.data[end:], set())
        assert "corrupt_data" in {diagnostic.code for diagnostic in diagnostics}


def test_a_long_journal_declares_its_channels_again(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "long.mcap.partial")
    for seq in range(200):
        journal.append(event_message(_numbered(EVENTS[1], seq), 1))
    journal.close()
    file = File(journal.path, 200)
    assert len(file.declarations) == 5
    first, last = file.declarations[0][0], file.declarations[1][1]
    _check(file, file.data[:first] + file.data[last:], set())


def test_messages_whose_declaration_is_lost_are_counted(journal: File) -> None:
    begin, end = journal.declarations[0][0], journal.declarations[-1][1]
    diagnostics = _check(journal, journal.data[:begin] + journal.data[end:], set(journal.rows))
    text = f"{len(EVENTS)} messages are on channel 1, which is not declared"
    assert any(found.message.startswith(text) for found in diagnostics)


@given(st.binary(max_size=200), st.booleans())
def test_any_bytes_are_read_or_refused_as_no_log(tmp_path: Path, junk: bytes, magic: bool) -> None:
    path = tmp_path / "junk.mcap"
    path.write_bytes((b"\x89MCAP0\r\n" if magic else b"") + junk)
    try:
        logs = read_log(path, signals=True)
    except LogReadError:
        assert not magic
        return
    assert loses_data(logs.diagnostics)


def test_an_index_that_leads_to_one_message_twice_is_not_believed(finished: File) -> None:
    damaged = bytearray(finished.data)
    index = next(
        record for record in Walk(finished.data, []) if record[0] == Opcode.MESSAGE_INDEX and record[3] - record[2] > 40
    )
    first, second = index[2] + 14, index[2] + 30  # the offsets of the first two entries
    damaged[second : second + 8] = damaged[first : first + 8]
    _check(finished, bytes(damaged), set())
