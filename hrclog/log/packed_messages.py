"""Undo the compression of single messages, which rosbag2's mode MESSAGE leaves; messages themselves never begin so."""

from __future__ import annotations

from typing import Final

import numpy as np

from hrclog.arrays import BoolArray
from hrclog.log.contents import Batch
from hrclog.log.formats import ZSTD_MAGIC, Format
from hrclog.log.unpack import TooLargeError, bound, unpack

_SIZE: Final = len(ZSTD_MAGIC)


def without_compression(part: Batch) -> Batch:
    """Return messages with those unpacked that are compressed; one that cannot be unpacked stays as it is."""
    is_packed = _is_packed(part)
    if not is_packed.any():
        return part
    limit = bound(len(part.data))
    messages: list[bytes] = []
    n_bytes = 0
    for packed, start, end in zip(is_packed.tolist(), part.start.tolist(), part.end.tolist(), strict=True):
        data = part.data[start:end]
        messages.append(_unpacked(data, limit - n_bytes) if packed else data)
        n_bytes += len(messages[-1])
    ends = np.cumsum([len(data) for data in messages])
    starts = ends - [len(data) for data in messages]
    data = b"".join(messages)
    return Batch(data, part.channel, part.sequence, part.log_time, part.publish_time, starts, ends)


def _unpacked(data: bytes, limit: int) -> bytes:
    try:
        unpacked = unpack(data, Format.ZSTD, limit)
    except TooLargeError:
        return data
    return data if unpacked.trouble else unpacked.data


def _is_packed(part: Batch) -> BoolArray:
    is_packed: BoolArray = part.end - part.start > _SIZE
    if is_packed.any():
        windows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(part.data, np.uint8), _SIZE)
        heads = windows[part.start[is_packed]]
        is_packed[is_packed] = (heads == np.frombuffer(ZSTD_MAGIC, np.uint8)).all(axis=1)
    return is_packed
