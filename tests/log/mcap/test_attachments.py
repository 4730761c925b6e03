"""Attachments: checked when a file is read, copied when it is recovered, and free to hold anything."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer

from hrclog.diagnostic import loses_data
from hrclog.log.mcap.attachments import attachment_at
from hrclog.log.mcap.contents import Contents
from hrclog.log.mcap.describe import describe
from hrclog.log.mcap.indexed import read_contents, read_indexed
from hrclog.log.mcap.records import MAGIC, Record, Walk
from hrclog.log.mcap.streamed import read_streamed
from hrclog.log.one_log import read_log
from hrclog.log.recover import recover

Attached = tuple[str, str, bytes]
ATTACHED = st.lists(st.tuples(st.text(max_size=9), st.text(max_size=9), st.binary(max_size=90)), min_size=1, max_size=3)
PLAIN = {"use_statistics": False, "index_types": IndexType.NONE}


def log_of(attached: list[Attached], *, inner: bytes = b"{}", **options: object) -> bytes:
    """Return a log of twelve messages in several chunks with attachments between them."""
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=100, compression=CompressionType.NONE, **options)  # type: ignore[arg-type]  # options of many types
    writer.start("", "another recorder")
    channel = writer.register_channel("/a", "json", 0)
    for time in range(12):
        writer.add_message(channel, time, inner, time)
        for name, media_type, content in attached[time : time + 1]:
            writer.add_attachment(time + 1, time, name, media_type, content)
    writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it untyped
    return stream.getvalue()


def records(data: bytes, opcode: int) -> list[Record]:
    return [record for record in Walk(data, []) if record[0] == opcode]


def attached_to(contents: Contents, data: bytes) -> list[Attached]:
    return [(one.name, one.media_type, data[one.start : one.end]) for one in contents.attachments]


def flipped(data: bytes, at: int, bit: int = 1) -> bytes:
    return data[:at] + bytes([data[at] ^ bit]) + data[at + 1 :]


@settings(max_examples=12)
@given(ATTACHED, st.booleans())
def test_attachments_are_read_with_or_without_an_index(attached: list[Attached], indexed: bool) -> None:
    data = log_of(attached, **({} if indexed else PLAIN))
    for contents in (read_contents(data), read_streamed(data)):
        assert contents.problems == []
        assert attached_to(contents, data) == attached


@settings(max_examples=60)
@given(ATTACHED, st.booleans(), st.floats(0, 1, exclude_max=True), st.sampled_from([1 << bit for bit in range(8)]))
def test_a_bit_of_an_attachment_that_is_flipped_is_told(
    attached: list[Attached], indexed: bool, where: float, bit: int
) -> None:
    whole = log_of(attached, **({} if indexed else PLAIN))
    record = records(whole, Opcode.ATTACHMENT)[-1]
    data = flipped(whole, record[2] + int(where * (record[3] - record[2])), bit)
    contents, described = read_contents(data), describe(data)
    assert contents.problems
    assert described is not None
    assert described.problems
    assert attached_to(contents, data) == attached[:-1]
    assert sum(len(batch.start) for batch in contents.batches) == 12


@pytest.mark.parametrize("options", [{}, PLAIN])
def test_a_recovery_copies_what_is_whole_and_tells_of_what_is_not(tmp_path: Path, options: dict[str, object]) -> None:
    attached = [("a.yaml", "text/yaml", b"a: 1"), ("b", "", b""), ("c.bin", "x/y", bytes(50))]
    whole = log_of(attached, **options)
    third = records(whole, Opcode.ATTACHMENT)[2]
    path = tmp_path / "cut.mcap"
    path.write_bytes(flipped(whole, third[3] - 10)[:-30])
    recovered = recover(path)
    texts = [problem.message for problem in recovered.problems]
    assert texts[0] == "the attachment 'c.bin' fails its checksum"
    assert (recovered.problems[0].offset, recovered.problems[0].n_bytes) == (third[1], third[3] - third[1])
    assert not any("attachment" in text for text in texts[1:])
    with recovered.path.open("rb") as stream:
        copied = [
            (one.name, one.media_type, one.data, one.create_time - one.log_time)
            for one in make_reader(stream).iter_attachments()
        ]
    assert copied == [(*one, 1) for one in attached[:2]]
    assert read_indexed(recovered.path.read_bytes()).problems == []


def test_a_recovery_without_the_attachments_is_written_anew(tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    path.write_bytes(log_of([])[:-30])
    without = recover(path).path.read_bytes()
    path.write_bytes(log_of([("a", "b", b"c")])[:-30])
    target = recover(path).path
    assert target.read_bytes() != without
    assert len(read_contents(target.read_bytes()).attachments) == 1


def test_a_log_of_attachments_alone_is_recovered(tmp_path: Path) -> None:
    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start("", "")
    writer.add_attachment(1, 2, "a", "b", b"c")
    writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it untyped
    path = tmp_path / "cut.mcap"
    path.write_bytes(stream.getvalue()[:-30])
    assert len(read_contents(recover(path).path.read_bytes()).attachments) == 1


@pytest.mark.parametrize("options", [{}, PLAIN])
def test_an_attachment_that_holds_a_log_gives_no_messages_even_if_it_is_damaged(options: dict[str, object]) -> None:
    whole = log_of([("inner.mcap", "application/mcap", log_of([], inner=b"[]"))], **options)
    (record,) = records(whole, Opcode.ATTACHMENT)
    for data in (whole, flipped(whole, record[3] - 20)):
        contents = read_streamed(data)
        assert [problem.code for problem in contents.problems] == ["corrupt_data"] * (data is not whole)
        assert sum(len(batch.start) for batch in contents.batches) == 12


def test_an_attachment_without_a_checksum_is_believed() -> None:
    data = log_of([("a", "b", b"content")])
    (record,) = records(data, Opcode.ATTACHMENT)
    content = bytearray(data[record[2] : record[3]])
    content[-4:] = bytes(4)
    assert attachment_at(bytes(content), 0, len(content)).is_intact


def with_private_record(content: bytes, opcode: int = 0x90) -> bytes:
    """Return a log without index with a record of an application in front of its chunks."""
    data = log_of([], **PLAIN, repeat_channels=False, use_summary_offsets=False)
    at = records(data, Opcode.HEADER)[0][3]
    return data[:at] + struct.pack("<BQ", opcode, len(content)) + content + data[at:]


@pytest.mark.parametrize("opcode", [0x7F, 0x80, 0xFF])
def test_a_private_record_may_hold_a_log(opcode: int) -> None:
    data = with_private_record(log_of([]), opcode)
    described, contents = describe(data), read_contents(data)
    assert described is not None
    assert described.problems == contents.problems == []
    assert described.n_messages == sum(len(batch.start) for batch in contents.batches) == 12


@pytest.mark.parametrize("options", [{"index_types": IndexType.NONE}, PLAIN])
def test_chunks_that_are_alike_are_none_of_them_doubled_in_a_closed_log_that_counts_them(
    tmp_path: Path, options: dict[str, object]
) -> None:
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=1, **options)  # type: ignore[arg-type]  # options of many types
    writer.start("", "")
    channel = writer.register_channel("/a", "json", 0)
    for _ in range(6):
        writer.add_message(channel, 7, b"{}", 7)
    writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it untyped
    data = stream.getvalue()
    contents = read_contents(data)
    assert contents.problems == []
    assert sum(len(batch.start) for batch in contents.batches) == 6
    chunk = records(data, Opcode.CHUNK)[-1]
    doubled = data[: chunk[3]] + data[chunk[1] : chunk[3]] + data[chunk[3] :]
    path = tmp_path / "doubled.mcap"
    for damaged in (doubled, data[: chunk[3]], doubled[: -len(MAGIC) - 1]):
        path.write_bytes(damaged)
        assert loses_data(read_log(path).diagnostics)
