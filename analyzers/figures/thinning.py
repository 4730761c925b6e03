"""Fewer samples: of what moves as many as an eye can follow; of any line those that give it its shape."""

from __future__ import annotations

from typing import Final

import numpy as np

from hrclog.arrays import FloatArray, IntArray

PERIOD_NS: Final = 40_000_000
"""Of what moves in a picture."""


def worth_drawing(times_ns: IntArray, values: FloatArray, period_ns: int = PERIOD_NS) -> IntArray:
    """Return the indices of the samples to draw.

    Kept are about one per period, the ends of every motion, and the last of all; what lies between equal neighbours is
    dropped, whether a picture holds values or joins them by lines.

    Args:
        times_ns: in order, shape (n,).
        values: shape (n, m).
        period_ns: of what is kept.
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

    Kept are all where there are no more; else the first, the lowest and the highest of each of equal runs of samples,
    and the last of all.

    Args:
        values: shape (n,); what is not a number is neither low nor high.
        most: at least 4.
    """
    if len(values) <= most:
        return np.arange(len(values))
    starts = np.linspace(0, len(values), (most - 1) // 3, endpoint=False).astype(np.int64)
    kept = [starts, _first_equal(values, starts, np.fmin), _first_equal(values, starts, np.fmax)]
    return np.unique(np.append(np.concatenate(kept), len(values) - 1))


def _first_equal(values: FloatArray, starts: IntArray, extreme: np.ufunc) -> IntArray:
    """Return where each run of samples, of those that have any number, first takes its extreme value."""
    runs = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(values)))
    equal = np.flatnonzero(values == extreme.reduceat(values, starts)[runs])
    return equal[np.unique(runs[equal], return_index=True)[1]]
