"""Read an MCAP file from front to end, past whatever is damaged."""

from __future__ import annotations

import struct
from typing import Final

import numpy as np
from mcap.opcode import Opcode

from hrclog.log.limits import FRAME, RECORDS, Budget, LimitError
from hrclog.log.mcap.chain import check_chain
from hrclog.log.mcap.completeness import count_problems, data_problems, frame_problems, match_chunks
from hrclog.log.mcap.contents import Batch, Contents, ForeignRecordError, channel_counts
from hrclog.log.mcap.doubles import doubled_chunks, without_chunks, without_spans
from hrclog.log.mcap.frame import Frame, Listing, check_said, has_checksum, listing, message_index
from hrclog.log.mcap.records import (
    FIRST_OF_APPLICATIONS,
    MAGIC,
    Problem,
    Record,
    Span,
    Walk,
    expand,
    next_chunk,
    record_at,
)
from hrclog.wording import counted

_MESSAGE: Final = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_BATCH_SPAN: Final = 1 << 28  # bytes; far below what the 32-bit offsets of Arrow's string views reach

_Row = tuple[int, int, int, int, int, int]


def read_streamed(data: bytes, budget: Budget | None = None) -> Contents:
    """Read a file from front to end; `problems` says what is damaged or missing.

    Args:
        data: the file.
        budget: of the file; without one it is that of a file of these bytes.
    """
    contents = _StreamedReader(data, budget or Budget(len(data))).read()
    contents.problems += check_chain(contents, data)
    return contents


class _StreamedReader:
    def __init__(self, data: bytes, budget: Budget) -> None:
        self._data = data
        self._budget = budget
        self._contents = Contents(budget=budget)
        self._frame = Frame()
        self._loose: list[_Row] = []  # messages that lie in the file itself, for one large batch
        self._packed: dict[int, int] = {}  # chunks that were decompressed: the batch that holds each one's messages
        self._last: tuple[int, list[_Row]] | None = None  # where the records of the last chunk begin, and its messages
        self._by_channel: dict[int, list[tuple[int, int]]] = {}  # times and offsets of those, once they are asked for
        self._misfits: list[tuple[int, str]] = []  # where and how the index does not fit

    def read(self) -> Contents:
        contents, problems = self._contents, self._contents.problems
        begin = _begin(self._data, problems, self._budget)
        if begin is None:
            return contents
        walk = Walk(self._data, problems, begin, self._budget)
        for record in walk:
            try:
                self._take(record)
            except LimitError as error:
                walk.refuse(record, error)
            except ValueError as error:
                walk.distrust(record, str(error))
        self._flush(self._data, self._loose)
        self._check_completeness()
        if contents.finished and not problems and not self._data.endswith(MAGIC):
            problems.append(Problem("truncated", len(self._data), "the file ends before its closing magic bytes"))
        if contents.header is None and not problems:
            problems.append(Problem("no_header", len(self._data), "the file ends before its header: 0 events"))
        return contents

    def _check_completeness(self) -> None:
        """Compare what was read with what the file says of itself; drop what is there twice."""
        data, frame, contents = self._data, self._frame, self._contents
        said = listing(data, frame)
        contents.unprotected = bool(contents.batches) and not has_checksum(data, frame)
        contents.problems += self._drop_doubled_chunks(said)
        match = match_chunks(data, frame, said)
        topics = {channel.id: channel.topic for channel in contents.channels.values()}
        counts = channel_counts(contents)
        for _, statistics in said.statistics:
            counts = dict.fromkeys(statistics.channel_message_counts, 0) | counts
        contents.problems += [
            *frame_problems(data, frame, said, match, self._misfits),
            *([] if contents.problems else data_problems(data, said)),
            *count_problems(frame, said, match, counts, topics),
        ]

    def _drop_doubled_chunks(self, said: Listing) -> list[Problem]:
        doubled = doubled_chunks(self._data, self._frame, said)
        if not doubled:
            return []
        batches = self._contents.batches
        n_before = sum(len(batch.start) for batch in batches)
        in_file = [span for span in doubled if span[0] not in self._packed]
        first = next((begin for begin, end in doubled if self._holds_message(begin, end)), doubled[0][0])
        gone = {self._packed[begin] for begin, _ in doubled if begin in self._packed}
        batches = [batch for row, batch in enumerate(batches) if row not in gone]
        batches = [without_spans(batch, in_file) if batch.data is self._data else batch for batch in batches]
        self._contents.batches = [batch for batch in batches if len(batch.start)]
        n_messages = n_before - sum(len(batch.start) for batch in batches)
        if not n_messages:  # declarations are repeated on purpose
            return []
        self._frame.chunks = without_chunks(self._frame, [begin for begin, _ in doubled])
        text = counted(n_messages, "message is there twice and was", "messages are there twice and were")
        return [Problem("records_doubled", first, f"{text} counted once; the first copy is at this byte")]

    def _holds_message(self, begin: int, end: int) -> bool:
        """Return whether a chunk holds a message; others hold declarations."""
        loose = (batch.start for batch in self._contents.batches if batch.data is self._data)
        return begin in self._packed or any(bool(((begin <= start) & (start < end)).any()) for start in loose)

    def _take(self, record: Record) -> None:
        match record[0]:
            case Opcode.CHUNK:
                self._take_chunk(record)
                return
            case Opcode.MESSAGE:
                if self._contents.is_ours:
                    raise ValueError("a message lies outside of a chunk, where hrclog writes none")
                self._add_loose([_message(self._data, record)])
                return
            case Opcode.MESSAGE_INDEX:
                self._compare(record)
            case Opcode.DATA_END:
                self._last = None
            case Opcode.FOOTER:
                self._contents.finished = True
            case Opcode.ATTACHMENT:
                self._contents.attach(self._data, record)
            case _:
                self._contents.keep(self._data, record)
        self._budget.spend(FRAME)
        check_said(self._data, record)
        self._frame.others[record[1]] = record

    def _compare(self, record: Record) -> None:
        """Compare a message index with the chunk before it, if that could be read."""
        if self._last is None:
            return
        entries = sorted(message_index(self._data, record))
        channel = int.from_bytes(self._data[record[2] : record[2] + 2], "little")
        if not self._by_channel:
            begin, rows = self._last
            self._by_channel = {row[0]: [] for row in rows}
            for row in rows:
                self._by_channel[row[0]].append((row[2], row[4] - _MESSAGE.size - 9 - begin))
            for listed in self._by_channel.values():
                listed.sort()
        if entries != self._by_channel.get(channel, []):
            text = f"the message index of channel {channel} at byte {record[1]} does not lead to its messages"
            self._misfits.append((record[1], text))

    def _take_chunk(self, chunk: Record) -> None:
        self._last = None
        rows: list[_Row] = []
        try:
            span = expand(self._data, chunk, self._budget)
            try:
                self._collect(span, rows)
            finally:  # a chunk without a checksum is good up to its first bad record
                last = span[1], list(rows)
                self._add(chunk, span, rows)
        except ValueError:
            self._frame.damaged.append(chunk[1])
            raise
        self._frame.chunks.append(chunk[1])
        self._last, self._by_channel = last, {}

    def _add(self, chunk: Record, span: Span, rows: list[_Row]) -> None:
        if span[0] is self._data:
            self._add_loose(rows)
        elif rows:
            self._flush(self._data, self._loose)
            self._packed[chunk[1]] = len(self._contents.batches)
            self._flush(span[0], rows)

    def _collect(self, span: Span, rows: list[_Row]) -> None:
        buffer, position, end = span
        n_left = self._budget.left(RECORDS)
        while position < end:
            record = record_at(buffer, position, end)
            if record is None:
                raise ValueError("a chunk holds bytes that are no record")
            if not n_left:
                self._budget.spend(RECORDS, self._budget.left(RECORDS) + 1)
            n_left -= 1
            if record[0] == Opcode.MESSAGE:
                rows.append(_message(buffer, record))
            elif record[0] < FIRST_OF_APPLICATIONS:
                self._keep(buffer, record, rows, end)
            position = record[3]
        self._budget.spend(RECORDS, self._budget.left(RECORDS) - n_left)

    def _keep(self, buffer: bytes, record: Record, rows: list[_Row], end: int) -> None:
        try:
            self._contents.keep(buffer, record)
        except ForeignRecordError as error:
            n_messages = len(rows)
            rows.clear()
            position = record[3]
            while position < end and (following := record_at(buffer, position, end)):
                n_messages += following[0] == Opcode.MESSAGE
                position = following[3]
            text = counted(n_messages, "message of this chunk was", "messages of this chunk were")
            raise ValueError(f"{error}; {text} skipped") from error

    def _add_loose(self, rows: list[_Row]) -> None:
        if rows and self._loose and rows[-1][-1] - self._loose[0][-2] > _BATCH_SPAN:
            self._flush(self._data, self._loose)
        self._loose += rows

    def _flush(self, data: bytes, rows: list[_Row]) -> None:
        """Move rows into a batch."""
        if rows:
            self._contents.batches.append(Batch(data, *np.array(rows, np.uint64).astype(np.int64).T))
            rows.clear()


def _begin(data: bytes, problems: list[Problem], budget: Budget) -> int | None:
    """Return where the records begin, None where there are none."""
    if data.startswith(MAGIC):
        return len(MAGIC)
    try:
        chunk = next_chunk(data, 0, len(data), len(data), budget)
    except LimitError as error:
        problems.append(Problem("limit_reached", 0, str(error), len(data)))
        return None
    if chunk is None:
        problems.append(Problem("no_header", 0, "the file ends before its MCAP header: 0 events"))
        return None
    skipped = counted(chunk, "byte is no MCAP header and was", "bytes are no MCAP header and were")
    problems.append(Problem("corrupt_data", 0, f"the first {skipped} skipped", chunk))
    return chunk


def _message(data: bytes, record: Record) -> _Row:
    if record[3] - record[2] < _MESSAGE.size:
        raise ValueError("a message is shorter than its header")
    return (*_MESSAGE.unpack_from(data, record[2]), record[2] + _MESSAGE.size, record[3])
