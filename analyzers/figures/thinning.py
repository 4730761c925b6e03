"""Thin samples: keep of motions as many as an eye can follow, and of lines those that give them their shape."""

from __future__ import annotations

from typing import Final

import numpy as np

from hrclog.arrays import FloatArray, IntArray

PERIOD_NS: Final = 40_000_000
"""The period of the samples of a motion."""


def worth_drawing(times_ns: IntArray, values: FloatArray, period_ns: int = PERIOD_NS) -> IntArray:
    """Return the indices of the samples to draw.

    It keeps about one sample per period, the ends of every motion, and the last sample. It drops samples between equal
    neighbours. That suits pictures that hold values and pictures that join them by lines.

    Args:
        times_ns: in order, shape (n,).
        values: shape (n, m).
        period_ns: of the samples that are kept.
    """
    if len(times_ns) < 3:
        return np.arange(len(times_ns))
    changed = (np.diff(values, axis=0) != 0).any(axis=1)
    ends = np.append(changed, False) != np.insert(changed, 0, False)
    gap = np.diff(times_ns) > 2 * period_ns
    ticks = np.diff(times_ns // period_ns) > 0
    moving = np.insert(ticks & changed, 0, True)
    moving[:-1] |= gap
    moving[1:] |= gap
    moving[-1] = True
    return np.flatnonzero(moving | ends)


def extremes(values: FloatArray, most: int) -> IntArray:
    """Return the indices of at most `most` samples, so that no spike is lost.

    If there are no more than that, it keeps all. Else it splits the samples into equally long groups, and keeps the
    first, the lowest and the highest of each group, and the last sample.

    Args:
        values: shape (n,); what is not a number is neither low nor high.
        most: at least 4.
    """
    if len(values) <= most:
        return np.arange(len(values))
    starts = np.linspace(0, len(values), (most - 1) // 3, endpoint=False).astype(np.int64)
    index_sets = [starts, _first_equal(values, starts, np.fmin), _first_equal(values, starts, np.fmax)]
    return np.unique(np.append(np.concatenate(index_sets), len(values) - 1))


def _first_equal(values: FloatArray, starts: IntArray, extreme: np.ufunc) -> IntArray:
    """Return where each group of samples first takes its extreme value; groups without numbers have none."""
    runs = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(values)))
    equal = np.flatnonzero(values == extreme.reduceat(values, starts)[runs])
    return equal[np.unique(runs[equal], return_index=True)[1]]
