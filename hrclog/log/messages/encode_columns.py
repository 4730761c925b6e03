"""Columns of events into messages: the counterpart of `decode_columns`, equal to `encode_row` of each row."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any, Final

import numpy as np
import polars as pl

from hrclog.arrays import ByteArray, IntArray
from hrclog.errors import InvalidEventError
from hrclog.event_rows import check_row
from hrclog.events import (
    COLUMNS,
    FLOAT_COLUMNS,
    INT_COLUMNS,
    LATEST_NS,
    STRING_COLUMNS,
    TASK_KINDS,
    Cause,
    Outcome,
    Role,
)
from hrclog.log.messages.message import ENCAPSULATION, EVENTS, FIXED_DTYPE, UNSET_INT

_BLOCK: Final = 20_000  # rows that are laid out at once
_NAMED: Final = ("agent", "task", "execution_id")
_SPACES: Final = "".join(filter(str.isspace, map(chr, range(0x3001))))  # what `str.strip` takes off
_HEAD: Final = len(ENCAPSULATION) + FIXED_DTYPE.itemsize


def encode_columns(events: pl.DataFrame) -> Iterator[bytes]:
    """Yield the rows of an events frame as little-endian CDR, in order.

    Args:
        events: the columns `COLUMNS` as `hrclog.log.messages.message.EVENTS` types them; texts are not null.

    Raises:
        InvalidEventError: a row says something that the vocabulary forbids; an end may lack its outcome.
    """
    rows = events.select(COLUMNS).cast({name: EVENTS[name] for name in COLUMNS})
    check_columns(rows)
    for begin in range(0, rows.height, _BLOCK):
        yield from _encode_block(rows[begin : begin + _BLOCK])


def check_columns(events: pl.DataFrame) -> None:
    """Raise the error of `check_row` for the first row that has one."""
    kind, scale = pl.col("kind"), pl.col("speed_scale")
    is_task = kind.is_in(TASK_KINDS)
    is_end = kind == "task_ended"
    outcome = pl.col("outcome")
    allowed = [
        pl.col("time_ns").is_between(0, LATEST_NS).fill_null(value=False),
        *(pl.col(name).is_null() | pl.col(name).is_between(-LATEST_NS, LATEST_NS) for name in INT_COLUMNS),
        *(~is_task | (pl.col(name).str.strip_chars(_SPACES) != "") for name in _NAMED),
        ~is_task | pl.col("role").is_in([role.value for role in Role]),
        ~(is_end | (kind == "run_ended"))
        | (is_end & (outcome == ""))
        | outcome.is_in([outcome.value for outcome in Outcome]),
        (kind != "task_paused") | pl.col("cause").is_in([cause.value for cause in Cause]),
        scale.is_null() | scale.is_between(0.0, 1.0),
    ]
    refused = events.filter(~pl.all_horizontal(allowed))
    for row in refused.head(1).iter_rows(named=True):
        check_row(row, may_lack_outcome=True)
        raise InvalidEventError(f"{row['kind']}: a field is not of the form the vocabulary asks for: {row}")


def _encode_block(rows: pl.DataFrame) -> Iterator[bytes]:
    # where each text begins: behind what comes before it, its padding, and four bytes for its length
    ends: IntArray = np.full(rows.height, FIXED_DTYPE.itemsize, np.int64)
    begins: list[IntArray] = []
    lengths: list[IntArray] = []
    for name in STRING_COLUMNS:
        begin = (ends + 3 & ~3) + 4
        length = rows[name].str.len_bytes().cast(pl.Int64).to_numpy()
        begins.append(begin)
        lengths.append(length)
        ends = begin + length + 1
    # as in `encode_row`, the last text is padded too
    sizes = len(ENCAPSULATION) + (ends + 3 & ~3)
    starts = np.concatenate(([0], np.cumsum(sizes)))
    raw: ByteArray = np.zeros(int(starts[-1]), np.uint8)
    head = raw[starts[:-1, None] + np.arange(_HEAD)]
    head[:, : len(ENCAPSULATION)] = np.frombuffer(ENCAPSULATION, np.uint8)
    head[:, len(ENCAPSULATION) :] = _fixed(rows).view(np.uint8).reshape(rows.height, -1)
    raw[starts[:-1, None] + np.arange(_HEAD)] = head
    bodies = starts[:-1] + len(ENCAPSULATION)
    for name, begin, length in zip(STRING_COLUMNS, begins, lengths, strict=True):
        at = bodies + begin
        raw[at[:, None] + np.arange(-4, 0)] = (length + 1).astype("<u4").view(np.uint8).reshape(-1, 4)
        _put_texts(raw, at, length, rows[name])
    data = raw.tobytes()
    places = starts.tolist()
    for begin_byte, end_byte in pairwise(places):
        yield data[begin_byte:end_byte]


def _fixed(rows: pl.DataFrame) -> Any:  # noqa: ANN401 - a structured array
    fixed = np.empty(rows.height, FIXED_DTYPE)
    for name in ("schema_version", "attempt", "seq"):
        fixed[name] = rows[name].to_numpy()
    for name in INT_COLUMNS:
        fixed[name] = rows[name].fill_null(UNSET_INT).to_numpy()
    for name in FLOAT_COLUMNS:
        fixed[name] = rows[name].fill_null(np.nan).to_numpy()
    return fixed


def _put_texts(raw: ByteArray, at: IntArray, length: IntArray, texts: pl.Series) -> None:
    total = int(length.sum())
    if not total:
        return
    joined = np.frombuffer("".join(texts).encode(), np.uint8)
    before = np.cumsum(length) - length
    raw[np.repeat(at - before, length) + np.arange(total)] = joined
