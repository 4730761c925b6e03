"""Read an MCAP file from front to end, past whatever is damaged."""

from __future__ import annotations

import struct
from typing import Final

import numpy as np
from mcap.opcode import Opcode

from hrclog.log.chain import FIRST_OF_APPLICATIONS, check_chain
from hrclog.log.contents import Batch, Contents
from hrclog.log.records import MAGIC, Problem, Record, Span, Walk, expand, next_chunk, record_at
from hrclog.wording import counted

_MESSAGE: Final = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_BATCH_SPAN: Final = 1 << 28  # bytes; far below what the 32-bit offsets of Arrow's string views reach

_Row = tuple[int, int, int, int, int, int]


def read_streamed(data: bytes) -> Contents:
    """Read a file from front to end; `problems` says what is damaged or missing."""
    contents = _StreamedReader(data).read()
    contents.problems += check_chain(contents, data)
    return contents


class _StreamedReader:
    def __init__(self, data: bytes) -> None:
        self._data = data
        self._contents = Contents()
        self._loose: list[_Row] = []  # messages that lie in the file itself, for one large batch

    def read(self) -> Contents:
        contents, problems = self._contents, self._contents.problems
        begin = _begin(self._data, problems)
        if begin is None:
            return contents
        walk = Walk(self._data, problems, begin)
        for record in walk:
            try:
                self._take(record)
            except ValueError as error:
                walk.distrust(record, str(error))
        self._flush(self._data, self._loose)
        if contents.finished and not problems and not self._data.endswith(MAGIC):
            problems.append(Problem("truncated", len(self._data), "the file ends before its closing magic bytes"))
        if contents.header is None and not problems:
            problems.append(Problem("no_header", len(self._data), "the file ends before its header: 0 events"))
        return contents

    def _take(self, record: Record) -> None:
        match record[0]:
            case Opcode.CHUNK:
                self._take_chunk(record)
            case Opcode.MESSAGE:
                self._add_loose([_message(self._data, record)])
            case Opcode.FOOTER:
                self._contents.finished = True
            case _:
                self._contents.keep(self._data, record)

    def _take_chunk(self, chunk: Record) -> None:
        span = expand(self._data, chunk)
        rows: list[_Row] = []
        try:
            self._collect(span, rows)
        finally:  # a chunk without a checksum is good up to its first bad record
            if span[0] is self._data:
                self._add_loose(rows)
            else:
                self._flush(self._data, self._loose)
                self._flush(span[0], rows)

    def _collect(self, span: Span, rows: list[_Row]) -> None:
        buffer, position, end = span
        while position < end:
            record = record_at(buffer, position, end)
            if record is None:
                raise ValueError("a chunk holds bytes that are no record")
            if record[0] == Opcode.MESSAGE:
                rows.append(_message(buffer, record))
            elif record[0] < FIRST_OF_APPLICATIONS:
                self._contents.keep(buffer, record)
            position = record[3]

    def _add_loose(self, rows: list[_Row]) -> None:
        if rows and self._loose and rows[-1][-1] - self._loose[0][-2] > _BATCH_SPAN:
            self._flush(self._data, self._loose)
        self._loose += rows

    def _flush(self, data: bytes, rows: list[_Row]) -> None:
        """Move rows into a batch."""
        if rows:
            self._contents.batches.append(Batch(data, *np.array(rows, np.uint64).astype(np.int64).T))
            rows.clear()


def _begin(data: bytes, problems: list[Problem]) -> int | None:
    """Return where the records begin, None where there are none."""
    if data.startswith(MAGIC):
        return len(MAGIC)
    chunk = next_chunk(data, 0, len(data), len(data))
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
