"""Whole records that are removed, doubled, swapped, put in or spliced: the same facts, or an error."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer
from sizes import many

from hrclog.diagnostic import Diagnostic, loses_data
from hrclog.errors import LogReadError
from hrclog.events import Event, RunEnded, RunStarted, TaskEnded, TaskStarted
from hrclog.log.limits import Budget
from hrclog.log.mcap import indexed, records
from hrclog.log.mcap.indexed import read_contents, read_indexed
from hrclog.log.mcap.records import MAGIC, Problem, Record, Span, Walk
from hrclog.log.mcap.streamed import read_streamed
from hrclog.log.messages.decode import is_event_channel
from hrclog.log.messages.encode import (
    FloatSignal,
    JointSignal,
    Message,
    Signal,
    event_message,
    run_metadata,
    signal_message,
)
from hrclog.log.reader import read_logs
from hrclog.log.writing.journal import LIBRARY, Journal
from hrclog.log.writing.writer import RUN_METADATA, write_log
from hrclog.wording import counted

N_TASKS: Final = 20
CHUNK_SIZE: Final = 1500


def messages_of(run_id: str, value: float, start_ns: int) -> list[Message]:
    """Return a run's events, and behind them its signals."""
    events: list[Event] = [RunStarted(time_ns=start_ns, run_id=run_id, name="run")]
    for i in range(N_TASKS):
        at, who = start_ns + 10 * i, {"agent": "robot", "task": f"pick {i % 5}", "execution_id": f"{run_id}-{i:02}"}
        events += [
            TaskStarted(time_ns=at + 1, run_id=run_id, **who),
            TaskEnded(time_ns=at + 6, run_id=run_id, outcome="succeeded", **who),
        ]
    events.append(RunEnded(time_ns=start_ns + 1000, run_id=run_id))
    signals: list[Signal] = [FloatSignal(run_id, "distance", start_ns + i, value + i) for i in range(40)]
    signals += [JointSignal(run_id, "robot", start_ns + i, ("a", "b"), (value, i)) for i in range(40)]
    return [
        *(event_message(replace(event, seq=seq), event.time_ns) for seq, event in enumerate(events)),
        *(signal_message(signal, signal.time_ns) for signal in signals),
    ]


def closed_log(run_id: str, compression: CompressionType, value: float, start_ns: int, *, crcs: bool = True) -> bytes:
    """Return a closed log, laid out as hrclog does."""
    stream = BytesIO()
    writer = Writer(stream, CHUNK_SIZE, compression, enable_crcs=crcs, enable_data_crcs=crcs)
    writer.start("ros2", LIBRARY)
    ids: dict[str, int] = {}
    for message in messages_of(run_id, value, start_ns):
        spec = message.channel
        if spec.topic not in ids:
            schema = writer.register_schema(spec.type_name, "ros2msg", spec.definition)
            ids[spec.topic] = writer.register_channel(spec.topic, "cdr", schema, dict(spec.metadata))
        times = message.log_time, message.data, message.publish_time, message.sequence
        writer.add_message(ids[spec.topic], *times)
    writer.add_metadata(RUN_METADATA, run_metadata(RunStarted(run_id=run_id, time_ns=0, name="run")))
    writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it untyped
    return stream.getvalue()


def journal_log(folder: Path, run_id: str, start_ns: int) -> bytes:
    """Return a journal, as a killed recorder leaves it: events and samples in turns."""
    journal = Journal(folder / f"{run_id}.mcap.partial")
    messages = messages_of(run_id, 0.5, start_ns)
    events = [message for message in messages if message.channel.topic == "/hrc/events"]
    samples = messages[len(events) :]
    journal.append(events[0])
    journal.metadata(RUN_METADATA, run_metadata(RunStarted(run_id=run_id, time_ns=0, name="run")))
    for event, *pair in zip(events[1:], samples[::2], samples[1::2], strict=False):
        journal.append(event)
        journal.append(*pair)
    journal.close()
    return journal.path.read_bytes()


def parts(data: bytes) -> list[bytes]:
    """Return a file in pieces: magic bytes, records, magic bytes."""
    problems: list[Problem] = []
    records = [data[offset:end] for _, offset, _, end in Walk(data, problems)]
    assert not problems
    tail = len(data) - len(MAGIC) - sum(map(len, records))
    return [MAGIC, *records, *([data[-tail:]] if tail else [])]


def is_chunk(record: bytes) -> bool:
    return record[0] == Opcode.CHUNK


class Mutant:
    """Changes of whole records; `own` are a file's, `other` those of another one, `i` and `j` places in `own`."""

    @staticmethod
    def remove(own: list[bytes], other: list[bytes], i: int, j: int) -> list[bytes]:  # noqa: ARG004 - all are alike
        """Leave one out."""
        return own[:i] + own[i + 1 :]

    @staticmethod
    def remove_some(own: list[bytes], other: list[bytes], i: int, j: int) -> list[bytes]:  # noqa: ARG004 - every change takes the same
        """Leave some out that follow each other."""
        return own[: min(i, j)] + own[max(i, j) :]

    @staticmethod
    def double(own: list[bytes], other: list[bytes], i: int, j: int) -> list[bytes]:  # noqa: ARG004 - every change takes the same
        """Put one in again, anywhere."""
        return [*own[:j], own[i], *own[j:]]

    @staticmethod
    def swap(own: list[bytes], other: list[bytes], i: int, j: int) -> list[bytes]:  # noqa: ARG004 - every change takes the same
        """Let two change places."""
        return [own[{i: j, j: i}.get(k, k)] for k in range(len(own))]

    @staticmethod
    def insert(own: list[bytes], other: list[bytes], i: int, j: int) -> list[bytes]:
        """Put one of the other file in."""
        return [*own[:i], other[j % len(other)], *own[i:]]

    @staticmethod
    def replace(own: list[bytes], other: list[bytes], i: int, j: int) -> list[bytes]:  # noqa: ARG004 - every change takes the same
        """Put the one of the other file in its place."""
        return [*own[:i], other[i % len(other)], *own[i + 1 :]]

    @staticmethod
    def splice(own: list[bytes], other: list[bytes], i: int, j: int) -> list[bytes]:
        """Go on with the other file, anywhere."""
        return own[:i] + other[j % len(other) :]

    @staticmethod
    def splice_there(own: list[bytes], other: list[bytes], i: int, j: int) -> list[bytes]:  # noqa: ARG004 - every change takes the same
        """Go on with the other file at the same place."""
        return own[:i] + other[i % len(other) :]


CHANGES: Final = [name for name in vars(Mutant) if not name.startswith("_")]


def facts(path: Path, data: bytes) -> tuple[object, list[Diagnostic]]:
    """Return what a file says, and what is said of it."""
    path.write_bytes(data)
    logs = read_logs(path, signals=True)
    events = logs.events.drop("path", "log_time_ns")
    return (events.rows(), logs.signals.rows()), logs.diagnostics


def codes(diagnostics: Iterable[Diagnostic]) -> set[str]:
    return {diagnostic.code for diagnostic in diagnostics if diagnostic.severity == "error"}


@pytest.fixture(scope="module", params=list(CompressionType), ids=lambda kind: kind.name.lower())
def pair(request: pytest.FixtureRequest) -> tuple[bytes, bytes]:
    """Return two closed logs that differ in run and values only, so that their records are as long."""
    own, other = (closed_log(run_id, request.param, value, 0) for run_id, value in (("r", 0.5), ("q", 0.25)))
    return own, other


@pytest.fixture(scope="module")
def journal(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return journal_log(tmp_path_factory.mktemp("journal"), "r", 10**9)


def check_law(path: Path, own: bytes, other: bytes, change: str, i: int, j: int) -> None:
    """Assert that a changed file gives the same facts, or an error, and by its index the same as without."""
    truth, _ = facts(path, own)
    mutant = b"".join(getattr(Mutant, change)(parts(own), parts(other), i, j))
    if mutant == other:
        return
    try:
        found, diagnostics = facts(path, mutant)
    except LogReadError:  # it is no log at all
        return
    assert found == truth or loses_data(diagnostics), diagnostics
    with suppress(ValueError):
        read_indexed(mutant)
        assert read_streamed(mutant).problems == []


@settings(max_examples=15)
@given(st.sampled_from(CHANGES), st.floats(0, 1, exclude_max=True), st.floats(0, 1, exclude_max=True))
def test_records_that_are_lost_or_foreign_to_a_closed_log_are_told(
    tmp_path: Path, pair: tuple[bytes, bytes], change: str, first: float, second: float
) -> None:
    n_parts = len(parts(pair[0]))
    check_law(tmp_path / "run.mcap", *pair, change, int(first * n_parts), int(second * n_parts))


@pytest.mark.slow
@pytest.mark.parametrize("change", CHANGES)
def test_records_all_over_a_closed_log_may_be_lost_or_foreign(
    tmp_path: Path, pair: tuple[bytes, bytes], change: str
) -> None:
    n_parts = len(parts(pair[0]))
    step = many(4, fuzz=1)
    for i in range(CHANGES.index(change) % step, n_parts, step):
        check_law(tmp_path / "run.mcap", *pair, change, i, (7 * i + 3) % n_parts)


@settings(max_examples=15)
@given(st.sampled_from(["double", "swap"]), st.floats(0, 1, exclude_max=True), st.floats(0, 1, exclude_max=True))
def test_records_of_a_journal_that_are_doubled_or_swapped_cost_nothing(
    tmp_path: Path, journal: bytes, change: str, first: float, second: float
) -> None:
    n_parts = len(parts(journal))
    check_law(tmp_path / "changed.mcap.partial", journal, journal, change, int(first * n_parts), int(second * n_parts))


def test_events_of_another_journal_are_told(tmp_path: Path) -> None:
    own, other = journal_log(tmp_path, "r", 10**9), journal_log(tmp_path, "q", 10**9)
    started = next(record for record in parts(other) if is_chunk(record) and b"run_started\0" in record)
    _, diagnostics = facts(tmp_path / "changed.mcap.partial", own + started)
    assert "foreign_records" in codes(diagnostics)


def test_a_doubled_sample_of_a_journal_counts_once(tmp_path: Path) -> None:
    own = journal_log(tmp_path, "r", 10**9)
    pieces = parts(own)
    path = tmp_path / "changed.mcap.partial"
    truth, _ = facts(path, own)
    for doubled in (pieces[-1], pieces[-2]):
        found, diagnostics = facts(path, b"".join([*pieces, doubled]))
        assert found == truth
        assert codes(diagnostics) & {"records_doubled", "broken_chain"}


def _chunk_rows(pieces: list[bytes]) -> list[int]:
    return [row for row, piece in enumerate(pieces) if is_chunk(piece)]


def test_a_chunk_that_is_not_there_is_named_with_its_messages(tmp_path: Path, pair: tuple[bytes, bytes]) -> None:
    pieces = parts(pair[0])
    path = tmp_path / "run.mcap"
    for row in _chunk_rows(pieces)[:3]:
        kept, diagnostics = facts(path, b"".join(pieces[:row] + pieces[row + 1 :]))
        n_lost = 2 + 2 * N_TASKS - len(kept[0])  # type: ignore[index]  # it is there in these files
        missing = next(diagnostic for diagnostic in diagnostics if diagnostic.code == "records_missing")
        assert missing.message.startswith(f"1 chunk of {counted(n_lost, 'message')} ({n_lost} on /hrc/events")
        assert missing.offset == sum(map(len, pieces[:row]))
        assert "damaged_index" in codes(diagnostics)


def test_the_samples_behind_a_first_chunk_that_is_gone_are_read_with_the_channels_of_the_summary(
    tmp_path: Path, pair: tuple[bytes, bytes]
) -> None:
    pieces = parts(pair[0])
    first = _chunk_rows(pieces)[0]
    path = tmp_path / "run.mcap"
    path.write_bytes(b"".join(pieces[:first] + pieces[first + 1 :]))
    logs = read_logs(path, signals=True)
    assert logs.signals.height == 120
    assert "records_missing" in codes(logs.diagnostics)


def test_a_chunk_whose_head_is_zero_is_damage(tmp_path: Path) -> None:
    own = journal_log(tmp_path, "r", 10**9)
    path = tmp_path / "changed.mcap.partial"
    offset = 0
    for piece in parts(own):
        if is_chunk(piece):
            for n_zeros in (28, 36, 40):
                zeroed = own[: offset + 9] + bytes(n_zeros) + own[offset + 9 + n_zeros :]
                assert "corrupt_data" in codes(facts(path, zeroed)[1])
            if offset > 3000:
                break
        offset += len(piece)


def test_a_chunk_without_a_checksum_among_others_is_told(tmp_path: Path) -> None:
    own = journal_log(tmp_path, "r", 10**9)
    path = tmp_path / "changed.mcap.partial"
    at = own.rindex(parts(own)[-1]) + 9 + 24
    truth, _ = facts(path, own)
    found, diagnostics = facts(path, own[:at] + bytes(4) + own[at + 4 :])
    assert found == truth
    assert "corrupt_data" in codes(diagnostics)


@pytest.mark.parametrize(
    ("value", "crcs"), [(1 << 20, True), (1, False), ((1 << 63) - 1, False), (1 << 63, False), ((1 << 64) - 1, False)]
)
def test_an_offset_that_does_not_fit_costs_nothing_and_is_told(tmp_path: Path, value: int, crcs: bool) -> None:
    own = closed_log("r", CompressionType.NONE, 0.5, 0, crcs=crcs)
    path = tmp_path / "run.mcap"
    truth, _ = facts(path, own)
    places = {
        Opcode.MESSAGE_INDEX: [14],
        Opcode.CHUNK_INDEX: [16, 24],
        Opcode.FOOTER: [0, 8],
        Opcode.METADATA_INDEX: [0],
    }
    first = {opcode: record for opcode, *record in reversed(list(Walk(own, [])))}
    for opcode, (offset, begin, _) in first.items():
        for at in places.get(opcode, []):  # type: ignore[call-overload]  # it is there in these files
            changed = own[: begin + at] + value.to_bytes(8, "little") + own[begin + at + 8 :]
            with warnings.catch_warnings(action="error"):
                found, diagnostics = facts(path, changed)
            assert found == truth, (opcode, offset)
            assert codes(diagnostics) & {"damaged_index", "corrupt_data", "records_missing"}, (opcode, offset, at)


def test_a_file_without_any_checksum_says_so_once(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    for crcs in (True, False):
        path.write_bytes(closed_log("r", CompressionType.ZSTD, 0.5, 0, crcs=crcs))
        for signals in (True, False):
            found = [diagnostic.code for diagnostic in read_logs(path, signals=signals).diagnostics]
            assert found == ([] if crcs else ["unprotected"])
        assert read_streamed(path.read_bytes()).unprotected is not crcs


def test_samples_of_another_run_stay_that_runs_and_are_told(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    write_log(path, [RunStarted(time_ns=0, run_id="r", name="run")], [FloatSignal("q", "distance", 3, 0.5)])
    logs = read_logs(path, signals=True)
    assert logs.signals.rows() == [("q", "distance", 3, 0.5)]
    assert codes(logs.diagnostics) == {"foreign_records"}
    assert logs.diagnostics[0].message.startswith("1 sample is of run 'q', the first of 'distance'")


def test_a_channel_that_is_declared_otherwise_is_of_another_file(tmp_path: Path) -> None:
    own, other = (journal_log(tmp_path, run_id, 10**9) for run_id in ("r", "q"))
    declaration = next(piece for piece in parts(other) if is_chunk(piece) and b"distance" in piece)
    _, diagnostics = facts(tmp_path / "changed.mcap.partial", own + declaration)
    assert "corrupt_data" in codes(diagnostics)


def test_chunks_of_signals_are_not_read_for_events(monkeypatch: pytest.MonkeyPatch, pair: tuple[bytes, bytes]) -> None:
    expanded: list[int] = []

    def expand(data: bytes, record: Record, budget: Budget) -> Span:
        expanded.append(record[1])
        return records.expand(data, record, budget)

    monkeypatch.setattr(indexed, "expand", expand)
    read_contents(pair[0], is_event_channel)
    assert 0 < len(expanded) < len(_chunk_rows(parts(pair[0]))) - 3
