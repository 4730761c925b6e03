"""Chunks that are in a file twice, byte for byte: records that were doubled."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Sequence

import numpy as np

from hrclog.log.mcap.completeness import data_problems, section_misfits
from hrclog.log.mcap.contents import Batch
from hrclog.log.mcap.frame import HEAD, Frame, Listing, chunk_key, heads, index_key
from hrclog.log.mcap.records import PREFIX


def doubled_chunks(data: bytes, frame: Frame, said: Listing) -> list[tuple[int, int]]:
    """Return first byte and end of each chunk that is a copy of one before it.

    Copies that the index lists are none: their writer knew of them. Without an index, those of a closed file are none
    where nothing that the file says of itself contradicts them.
    """
    if len(frame.chunks) < 2:
        return []
    keys = heads(data, frame.chunks).view(f"V{HEAD.itemsize}")
    _, group, sizes = np.unique(keys, return_inverse=True, return_counts=True)
    alike = np.flatnonzero(sizes[group.reshape(-1)] > 1).tolist()
    if not alike or (not said.chunk_indexes and _is_as_written(data, frame, said)):
        return []
    listed = Counter(index_key(index) for _, index in said.chunk_indexes)
    seen: Counter[bytes] = Counter()
    copies: list[tuple[int, int]] = []
    for begin in (frame.chunks[row] for row in alike):
        end = begin + PREFIX.size + int.from_bytes(data[begin + 1 : begin + PREFIX.size], "little")
        content = data[begin:end]
        if seen[content] >= max(listed[chunk_key(data, begin)], 1):
            copies.append((begin, end))
        seen[content] += 1
    return copies


def _is_as_written(data: bytes, frame: Frame, said: Listing) -> bool:
    """Return whether a file is closed, and has as many chunks, and as many bytes of data, as it says."""
    n_chunks = len(frame.chunks) + len(frame.damaged)
    return (
        len(said.footers) == 1
        and len(said.data_ends) == 1
        and all(statistics.chunk_count == n_chunks for _, statistics in said.statistics)
        and not any(section_misfits(data, frame, said))
        and not data_problems(data, said)
    )


def without_chunks(frame: Frame, begins: Sequence[int]) -> array[int]:
    """Return the chunks of a frame but for some."""
    gone = set(begins)
    return array("q", [offset for offset in frame.chunks if offset not in gone])


def without_spans(batch: Batch, spans: Sequence[tuple[int, int]]) -> Batch:
    """Return a batch without the messages that lie in some spans of its buffer."""
    if not spans or not len(batch.start):
        return batch
    begins, ends = np.array(sorted(spans), np.int64).T
    row = np.searchsorted(begins, batch.start, "right") - 1
    kept = (row < 0) | (batch.start >= ends[np.maximum(row, 0)])
    arrays = (batch.channel, batch.sequence, batch.log_time, batch.publish_time, batch.start, batch.end)
    return batch if kept.all() else Batch(batch.data, *(values[kept] for values in arrays))
