"""TaskEvent <-> CDR: one event at a time when writing, whole columns when reading."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.lib.stride_tricks import sliding_window_view

from hrclog.arrays import BoolArray, ByteArray, IntArray
from hrclog.errors import InvalidEventError
from hrclog.events import COLUMNS, FLOAT_COLUMNS, INT_COLUMNS, STRING_COLUMNS

TYPE_NAME: Final = "hrclog_msgs/msg/TaskEvent"
DEFINITION: Final = Path(__file__).with_name("TaskEvent.msg").read_text(encoding="utf-8")
"""The ROS 2 definition that goes into every log."""

UNSET_INT: Final = -(2**63)

EVENTS: Final = pl.Schema(
    {"schema_version": pl.UInt32(), "attempt": pl.UInt32(), "seq": pl.Int64()}
    | dict.fromkeys(INT_COLUMNS, pl.Int64())
    | dict.fromkeys(FLOAT_COLUMNS, pl.Float64())
    | dict.fromkeys(STRING_COLUMNS, pl.String())
    | {"log_time_ns": pl.Int64(), "path": pl.String()}
)
"""Columns of an events frame: the message's, when it was written, and the file it came from."""

ENCAPSULATION: Final = b"\x00\x01\x00\x00"  # CDR, little endian
_FIXED: Final = struct.Struct("<IIq4q4d")
FIXED_DTYPE: Final = np.dtype(
    [("schema_version", "<u4"), ("attempt", "<u4"), ("seq", "<i8")]
    + [(name, "<i8") for name in INT_COLUMNS]
    + [(name, "<f8") for name in FLOAT_COLUMNS]
)
_PADDING: Final = (b"", b"\0\0\0", b"\0\0", b"\0")
_VIEW_INLINE: Final = 12  # bytes of a string that fit into its 16-byte Arrow view


def encode_row(row: Mapping[str, Any]) -> bytes:
    """Return a flat event row as little-endian CDR.

    Raises:
        InvalidEventError: a number is out of range or a text is not valid Unicode.
    """
    try:
        ints = [UNSET_INT if row[name] is None else row[name] for name in INT_COLUMNS]
        floats = [math.nan if row[name] is None else row[name] for name in FLOAT_COLUMNS]
        parts = [ENCAPSULATION, _FIXED.pack(row["schema_version"], row["attempt"], row["seq"], *ints, *floats)]
        for name in STRING_COLUMNS:
            text = row[name].encode()
            size = len(text) + 1
            parts += (struct.pack("<I", size), text, b"\0", _PADDING[size & 3])
    except (struct.error, UnicodeEncodeError, AttributeError, TypeError) as error:
        raise InvalidEventError(f"{row.get('kind') or 'event'}: a field cannot be written ({error})") from error
    return b"".join(parts)


def decode_columns(data: bytes, starts: IntArray, ends: IntArray) -> tuple[pl.DataFrame, BoolArray]:
    """Decode many little-endian CDR TaskEvents at once.

    Args:
        data: the buffer that holds the messages.
        starts: offset of each message's first byte, shape (n,).
        ends: offset one past each message's last byte, shape (n,).

    Returns:
        The columns of the messages that are well formed, in order, and the mask (n,) of those.
    """
    if not len(starts):
        return pl.DataFrame(schema={name: EVENTS[name] for name in COLUMNS}), np.empty(0, np.bool_)
    first, last = int(starts.min()), int(ends.max())
    padding = np.zeros(_FIXED.size, np.uint8)  # so that no gather reads past the end
    raw = np.concatenate([np.frombuffer(data, np.uint8, last - first, first), padding])
    starts, ends = starts - first, ends - first
    valid = ends - starts >= len(ENCAPSULATION) + _FIXED.size
    valid[valid] &= (_gather(raw, starts[valid], 2) == (0, 1)).all(axis=1)
    bodies = starts + len(ENCAPSULATION)
    positions = bodies + _FIXED.size
    spans: list[tuple[IntArray, IntArray]] = []
    for _ in STRING_COLUMNS:
        positions, begin, length = _next_string(raw, bodies, positions, ends, valid)
        spans.append((begin, length))
    fixed = _gather(raw, bodies[valid], _FIXED.size).view(FIXED_DTYPE)[:, 0]
    columns = {name: pl.Series(name, np.ascontiguousarray(fixed[name])) for name in fixed.dtype.names or ()}
    for name, (begin, length) in zip(STRING_COLUMNS, spans, strict=True):
        columns[name] = _strings(name, raw, begin[valid], length[valid])
    integers = pl.col("seq", *INT_COLUMNS)
    frame = pl.DataFrame(columns).with_columns(
        pl.when(integers != UNSET_INT).then(integers), pl.col(*FLOAT_COLUMNS).fill_nan(None)
    )
    return _drop_invalid_texts(frame, valid)


def _gather(raw: ByteArray, at: IntArray, size: int) -> ByteArray:
    """Return the `size` bytes at each offset, shape (n, size)."""
    return np.ascontiguousarray(sliding_window_view(raw, size)[at])


def _next_string(
    raw: ByteArray, bodies: IntArray, positions: IntArray, ends: IntArray, valid: BoolArray
) -> tuple[IntArray, IntArray, IntArray]:
    """Return (end, first byte, length without NUL) of the strings at `positions`; torn ones unset `valid`."""
    positions = bodies + ((positions - bodies + 3) & ~3)
    valid &= positions + 4 <= ends
    at = np.where(valid, positions, 0)
    size = _gather(raw, at, 4).view("<u4")[:, 0].astype(np.int64)
    begin = at + 4
    valid &= begin + size <= ends
    size = np.where(valid, size, 0)
    last = np.where(size > 0, begin + size - 1, 0)
    terminated = (size > 0) & (raw[last] == 0)
    return begin + size, begin, size - terminated


def _strings(name: str, raw: ByteArray, begin: IntArray, length: IntArray) -> pl.Series:
    """Return texts as a column that points into the buffer (Arrow's string view layout), null where not UTF-8."""
    import pyarrow as pa

    if not length.any():
        return pl.Series(name, [""]).new_from_index(0, len(begin)) if len(begin) else pl.Series(name, [], pl.String)
    views = np.empty((len(begin), 16), np.uint8)
    words = views.view("<i4")
    # the four bytes before a text are its CDR length, which becomes the view's length
    views[:] = _gather(raw, begin - 4, 16)
    views[:, 4:] *= np.arange(_VIEW_INLINE) < length[:, None]
    words[:, 0] = length
    long = length > _VIEW_INLINE
    words[long, 2] = 0
    words[long, 3] = begin[long]
    array = pa.Array.from_buffers(pa.binary_view(), len(begin), [None, pa.py_buffer(views), pa.py_buffer(raw)])
    series = pl.Series(name, array)
    try:
        return series.cast(pl.String)
    except pl.exceptions.ComputeError:  # rare: find out which
        return pl.Series(name, [_utf8(text) for text in series], pl.String)


def _utf8(text: bytes) -> str | None:
    try:
        return text.decode()
    except UnicodeDecodeError:
        return None


def _drop_invalid_texts(frame: pl.DataFrame, decoded: BoolArray) -> tuple[pl.DataFrame, BoolArray]:
    valid = frame.select(pl.all_horizontal(pl.col(STRING_COLUMNS).is_not_null())).to_series()
    if valid.all():
        return frame, decoded
    decoded = decoded.copy()
    decoded[np.flatnonzero(decoded)] = valid.to_numpy()
    return frame.filter(valid), decoded
