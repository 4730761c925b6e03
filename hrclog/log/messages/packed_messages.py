"""Undo the compression of single messages, which rosbag2's mode MESSAGE leaves; messages themselves never begin so."""

from __future__ import annotations

from typing import Final

import numpy as np

from hrclog.arrays import BoolArray
from hrclog.log.files.formats import ZSTD_MAGIC, Format
from hrclog.log.files.unpack import unpack
from hrclog.log.limits import UNPACKED, Budget, LimitError
from hrclog.log.mcap.contents import Batch

_SIZE: Final = len(ZSTD_MAGIC)


def without_compression(part: Batch, budget: Budget) -> Batch:
    """Return messages with those unpacked that are compressed; one that cannot be unpacked stays as it is.

    Args:
        part: messages of one channel, whose recorder compressed all or none of them; at least one.
        budget: of the file; what messages unpack to is taken off.
    """
    if not any(part.data.startswith(ZSTD_MAGIC, part.start[at]) for at in (0, -1)):
        return part
    is_packed = _is_packed(part)
    left = budget.left(UNPACKED)
    messages: list[bytes] = []
    for packed, start, end in zip(is_packed.tolist(), part.start.tolist(), part.end.tolist(), strict=True):
        data = part.data[start:end]
        unpacked = _unpacked(data, left) if packed and left else data
        spent = left if unpacked is None else min(len(unpacked), left) if packed else 0
        budget.spend(UNPACKED, spent)  # after a bomb, no further message is touched
        left -= spent
        messages.append(data if unpacked is None else unpacked)
    ends = np.cumsum([len(data) for data in messages])
    starts = ends - [len(data) for data in messages]
    data = b"".join(messages)
    return Batch(data, part.channel, part.sequence, part.log_time, part.publish_time, starts, ends)


def _unpacked(data: bytes, limit: int) -> bytes | None:
    """Return a message unpacked, as it is where that fails, or None where it is larger than the limit."""
    try:
        unpacked = unpack(data, Format.ZSTD, limit)
    except LimitError:
        return None
    return data if unpacked.trouble else unpacked.data


def _is_packed(part: Batch) -> BoolArray:
    is_packed: BoolArray = part.end - part.start > _SIZE
    if is_packed.any():
        windows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(part.data, np.uint8), _SIZE)
        heads = windows[part.start[is_packed]]
        is_packed[is_packed] = (heads == np.frombuffer(ZSTD_MAGIC, np.uint8)).all(axis=1)
    return is_packed
