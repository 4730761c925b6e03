"""The chain of a journal: each message names its number and the chunk before it, so that none can go or come unseen.

A chunk of a journal holds a message and, behind it, its link: a record of an opcode that MCAP leaves to applications
and that readers skip. A chain that ends early is whole: a cut between two chunks looks like a killed recorder.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import McapRecord

from hrclog.arrays import BoolArray, IntArray
from hrclog.log.mcap.contents import Batch, Contents
from hrclog.log.mcap.records import FIRST_OF_APPLICATIONS, Problem
from hrclog.wording import agree, counted

_LINK_OPCODE: Final = FIRST_OF_APPLICATIONS
_LINK: Final = struct.Struct("<BQQII")
_LINK_LENGTH: Final = _LINK.size - 9
_LINK_DTYPE: Final = np.dtype(
    [("opcode", "u1"), ("length", "<u8"), ("number", "<u8"), ("previous", "<u4"), ("declaration", "<u4")]
)
_CHUNK_DTYPE: Final = np.dtype(
    [
        *[("opcode", "u1"), ("length", "<u8"), ("start", "<u8"), ("end", "<u8"), ("size", "<u8"), ("checksum", "<u4")],
        *[("compression", "<u4"), ("records", "<u8")],
    ]
)
_MESSAGE_HEAD: Final = 31  # bytes of a message before its data


def link(number: int, previous: int, declaration: int) -> bytes:
    """Return the link of a message.

    Args:
        number: how many messages the journal holds before this one.
        previous: checksum of the chunk of the message before it, 0 for the first.
        declaration: checksum of the records that declare its channel.
    """
    return _LINK.pack(_LINK_OPCODE, _LINK_LENGTH, number, previous, declaration)


def record_bytes(record: McapRecord) -> bytes:
    """Return a record as it stands in a file."""
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]  # mcap leaves it untyped


@dataclass(frozen=True, slots=True)
class _Links:
    """The links of messages in the order of the file, arrays of shape (n,).

    `offset` is where a message's chunk begins; the other numbers mean nothing where `linked` is false.
    """

    linked: BoolArray
    offset: IntArray
    number: IntArray
    previous: IntArray
    checksum: IntArray
    declaration: IntArray
    channel: IntArray

    def __len__(self) -> int:
        return len(self.number)

    def __getitem__(self, rows: BoolArray | IntArray) -> _Links:
        return _Links(*(getattr(self, field.name)[rows] for field in fields(self)))


def is_chained(contents: Contents, data: bytes) -> bool:
    """Return whether messages of a file have links."""
    return any(_links(batch, data).linked.any() for batch in contents.batches)


def check_chain(contents: Contents, data: bytes) -> list[Problem]:
    """Return what the chain of a journal says of messages that are missing, doubled, moved or not its own.

    Copies of a message are dropped from `contents`. A file whose messages have no links gives no problem.

    Args:
        contents: what was read of the file, from front to end.
        data: the file.
    """
    parts = [_links(batch, data) for batch in contents.batches]
    if not any(part.linked.any() for part in parts):
        return []
    links = _Links(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(_Links)))
    problems = list(_wrong_declarations(links[links.linked], contents))
    if links.linked.all() and _is_unbroken(links):
        return problems
    copies = _copies(links)
    _drop(contents, copies)
    return [*problems, *_strangers(links), *_doubled(links[copies]), *_breaks(links[links.linked & ~copies])]


def _links(batch: Batch, data: bytes) -> _Links:
    """Return the links of a batch; there are none in chunks that were compressed."""
    chunk_at = batch.start - _MESSAGE_HEAD - _CHUNK_DTYPE.itemsize
    inside = (chunk_at >= 0) & (batch.end + _LINK.size <= len(data)) & (batch.data is data)
    heads = _gather(data, np.where(inside, chunk_at, 0), _CHUNK_DTYPE)
    tails = _gather(data, np.where(inside, batch.end, 0), _LINK_DTYPE)
    linked = (
        inside
        & (heads["opcode"] == Opcode.CHUNK)
        & (heads["records"] == (batch.end - batch.start + _MESSAGE_HEAD + _LINK.size).astype(np.uint64))
        & (tails["opcode"] == _LINK_OPCODE)
        & (tails["length"] == _LINK_LENGTH)
    )
    offset = np.where(linked, chunk_at, np.maximum(batch.start - _MESSAGE_HEAD, 0))
    number, previous, declaration = (tails[name].astype(np.int64) for name in ("number", "previous", "declaration"))
    checksum = heads["checksum"].astype(np.int64)
    return _Links(linked, offset, number, previous, checksum, declaration, batch.channel)


def _gather(data: bytes, offsets: IntArray, dtype: np.dtype[np.void]) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    if len(data) < dtype.itemsize:
        return np.zeros(len(offsets), dtype)
    windows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(data, np.uint8), dtype.itemsize)
    return np.ascontiguousarray(windows[offsets]).view(dtype).reshape(-1)


def _is_unbroken(links: _Links) -> bool:
    return bool(
        (links.number == np.arange(len(links))).all()
        and links.previous[0] == 0
        and (links.previous[1:] == links.checksum[:-1]).all()
    )


def _copies(links: _Links) -> BoolArray:
    """Return which messages are there a second time, shape (n,)."""
    keys = np.stack([np.where(links.linked, links.number, -1 - np.arange(len(links))), links.checksum])
    _, first = np.unique(keys, axis=1, return_index=True)
    copies = np.ones(len(links), bool)
    copies[first] = False
    return copies


def _drop(contents: Contents, copies: BoolArray) -> None:
    """Drop messages from the batches."""
    if not copies.any():
        return
    ends = np.cumsum([len(batch.start) for batch in contents.batches])
    kept = np.split(~copies, ends[:-1])
    contents.batches = [_only(batch, rows) for batch, rows in zip(contents.batches, kept, strict=True)]


def _only(batch: Batch, rows: BoolArray) -> Batch:
    arrays = (batch.channel, batch.sequence, batch.log_time, batch.publish_time, batch.start, batch.end)
    return Batch(batch.data, *(array[rows] for array in arrays))


def _wrong_declarations(links: _Links, contents: Contents) -> Iterator[Problem]:
    """Find messages whose channel is not the one that they were written to."""
    declared = np.full(1 << 16, -1)
    for channel in contents.channels.values():
        schema = contents.schemas.get(channel.schema_id)
        if schema is not None:
            declared[channel.id] = zlib.crc32(record_bytes(schema) + record_bytes(channel))
    expected = declared[links.channel]
    wrong = (expected >= 0) & (expected != links.declaration)
    if wrong.any():
        text = counted(int(wrong.sum()), "message was", "messages were")
        yield _problem(links[wrong], f"{text} written to a channel that is declared otherwise here")


def _strangers(links: _Links) -> Iterator[Problem]:
    """Find messages without a link among those that have one."""
    others = links[~links.linked]
    if len(others):
        text = counted(
            len(others), "message is not of this journal: it has", "messages are not of this journal: they have"
        )
        yield _problem(others, f"{text} no link to the message before")


def _doubled(copies: _Links) -> Iterator[Problem]:
    if len(copies):
        text = counted(len(copies), "message is there twice and was", "messages are there twice and were")
        yield _problem(copies, f"{text} counted once")


def _breaks(links: _Links) -> Iterator[Problem]:
    """Find where messages are missing, moved or spliced in."""
    if not len(links):
        return
    moved = links.number < np.maximum.accumulate(links.number)
    if moved.any():
        text = counted(int(moved.sum()), "message does", "messages do")
        yield _problem(
            links[moved], f"{text} not stand where the recorder wrote {agree(int(moved.sum()), 'it', 'them')}"
        )
    ordered = links[np.argsort(links.number, kind="stable")]
    before = np.concatenate([[-1], ordered.number[:-1]])
    missing = ordered.number - before - 1
    for row in np.flatnonzero(missing > 0).tolist():
        n_missing = int(missing[row])
        text = (
            f"{counted(n_missing, 'message is', 'messages are')} missing before this one, number {ordered.number[row]}"
        )
        yield Problem("broken_chain", int(ordered.offset[row]), text, n_messages=n_missing)
    previous = np.concatenate([[0], ordered.checksum[:-1]])
    spliced = ordered[(missing < 0) | ((missing == 0) & (ordered.previous != previous))]
    if len(spliced):
        text = counted(len(spliced), "message follows", "messages follow")
        yield _problem(spliced, f"{text} on another message than the one before: the journal was pieced together")


def _problem(links: _Links, text: str) -> Problem:
    where = "" if len(links) == 1 else "; the first begins at this byte"
    return Problem("broken_chain", int(links.offset[0]), text + where)
