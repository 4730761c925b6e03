"""Records, one by one: what is too short or longer than it need be."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, ChunkIndex, McapRecord, MessageIndex, Metadata, Schema

from hrclog.log.mcap.indexed import _entries
from hrclog.log.mcap.records import MAGIC, Problem, Walk, expand, next_chunk, parse, record_at
from hrclog.log.writing.journal import _chunk

CHUNK = _chunk(b"\x05" + struct.pack("<QHIQQ", 22, 1, 2, 3, 4), 3)
RECORDS = [
    Schema(1, b"string data", "ros2msg", "std_msgs/msg/String"),
    Channel(1, "/topic", "cdr", {"agent": "robot"}, 1),
    Metadata("hrclog.run", {"name": "run"}),
]


def _bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]  # mcap leaves it untyped


def _padded(data: bytes, padding: bytes) -> bytes:
    """Return a record with bytes behind its known fields, as later versions of the format may have."""
    return data[:1] + struct.pack("<Q", len(data) - 9 + len(padding)) + data[9:] + padding


@pytest.mark.parametrize("record", RECORDS)
def test_a_record_that_is_cut_short_anywhere_is_damaged(record: McapRecord) -> None:
    whole = _bytes(record)
    for size in range(9, len(whole)):
        cut = whole[:1] + struct.pack("<Q", size - 9) + whole[9:size]
        found = record_at(cut, 0, len(cut))
        assert found is not None
        with pytest.raises(ValueError, match=f"a {type(record).__name__} record is damaged"):
            parse(type(record), cut, found)


@pytest.mark.parametrize("record", RECORDS)
def test_bytes_behind_the_known_fields_are_passed_over(record: McapRecord) -> None:
    data = _padded(_bytes(record), b"later")
    found = record_at(data, 0, len(data))
    assert found is not None
    assert parse(type(record), data, found) == record


def test_a_message_index_may_be_padded() -> None:
    data = _padded(_bytes(MessageIndex(7, [(5, 31), (6, 0)])), b"x" * 16)
    index = ChunkIndex(0, 0, "", 0, 0, 0, {7: 0}, 0, 0)
    channels, starts, times = _entries(data, index)
    assert (channels.tolist(), starts.tolist()) == ([7, 7], [0, 31])
    assert times.tolist() == [6, 5]
    assert starts.dtype == np.int64


@pytest.mark.parametrize("data", [b"", b"\x05", b"\0" * 20, b"\x05" + b"\xff" * 8, b"\x05\x02" + b"\0" * 8])
def test_what_does_not_fit_is_no_record(data: bytes) -> None:
    assert record_at(data, 0, len(data)) is None


def test_a_chunk_is_found_where_it_begins_behind_others_that_only_look_like_one() -> None:
    data = b"\x06\x06\x06\x06\0\0\0\0\0" + CHUNK + CHUNK
    assert next_chunk(data, 0, len(data), len(data)) == 9
    assert next_chunk(data, 10, len(data), len(data)) == 9 + len(CHUNK)
    assert next_chunk(data, 10, 9 + len(CHUNK), len(data)) is None
    assert next_chunk(data, 10, len(data), len(data) - 1) is None


def test_the_walk_finds_a_chunk_under_another_opcode_or_with_another_length() -> None:
    for damaged in (b"\x07" + CHUNK[1:], _padded(CHUNK, b"")[:1] + struct.pack("<Q", len(CHUNK) * 2 - 9) + CHUNK[9:]):
        problems: list[Problem] = []
        found = list(Walk(damaged + CHUNK + CHUNK, problems, 0))
        assert [offset for _, offset, _, _ in found] == [len(CHUNK), 2 * len(CHUNK)]
        assert [problem.code for problem in problems] == ["corrupt_data"]


def test_an_attachment_may_hold_a_whole_mcap_file_but_not_swallow_the_chunks_behind_it() -> None:
    attachment = _bytes(Attachment(1, 2, "other.mcap", "application/mcap", CHUNK))
    behind = len(attachment)
    of_wrong_checksum = attachment[:-1] + b"?"
    longer, shorter = (_padded(attachment, CHUNK)[:behind], attachment.replace(CHUNK, CHUNK[:-1], 1))
    for first, offsets in (
        (attachment, [0, behind]),
        (of_wrong_checksum, [0, behind]),
        (longer, [behind]),
        (shorter, [behind - 1]),
    ):
        problems: list[Problem] = []
        found = [offset for _, offset, _, _ in Walk(first + CHUNK, problems, 0)]
        assert found == offsets
        assert bool(problems) is (offsets[0] > 0)


def test_records_that_may_hold_anything_may_hold_a_whole_mcap_file() -> None:
    content = MAGIC + CHUNK + MAGIC
    for opcode in (0x10, 0x7F, 0x80, 0xFF):
        holder = struct.pack("<BQ", opcode, len(content)) + content
        for behind in (CHUNK, _bytes(RECORDS[2]) + CHUNK, b"", MAGIC, holder):
            problems: list[Problem] = []
            data = holder + behind
            assert next(iter(Walk(data, problems, 0)))[1:] == (0, 9, len(holder))
            assert problems == []
        swallowing = struct.pack("<BQ", opcode, len(content) + 20) + content
        inside = 9 + len(MAGIC)
        found = [record[1] for record in Walk(swallowing + CHUNK * 2, [], 0)]
        assert found == [inside, len(holder), len(holder) + len(CHUNK)]


def test_a_chunk_of_another_compression_is_refused_by_name() -> None:
    content = CHUNK[9:37] + struct.pack("<I", 3) + b"lzo" + CHUNK[41:]
    data = b"\x06" + struct.pack("<Q", len(content)) + content
    record = (int(Opcode.CHUNK), 0, 9, len(data))
    with pytest.raises(ValueError, match="compressed with 'lzo', expected zstd, lz4 or nothing"):
        expand(data, record)


@pytest.mark.parametrize("name", ["zstd", "lz4"])
def test_a_chunk_that_unpacks_to_more_than_it_says_is_refused(name: str) -> None:
    import lz4.frame
    import zstandard

    packed = zstandard.compress(bytes(10**6)) if name == "zstd" else lz4.frame.compress(bytes(10**6))
    for size, fits in ((10**6, True), (10**6 - 1, False), (0, False)):
        head = struct.pack("<QQQI", 0, 0, size, 0) + struct.pack("<I", len(name)) + name.encode()
        content = head + struct.pack("<Q", len(packed)) + packed
        data = b"\x06" + struct.pack("<Q", len(content)) + content
        record = (int(Opcode.CHUNK), 0, 9, len(data))
        if fits:
            assert expand(data, record)[2] == size
        else:
            with pytest.raises(ValueError, match="a chunk"):
                expand(data, record)
