"""Fewer samples of what moves: as many as an eye can follow, and none while it stands still."""

from __future__ import annotations

from typing import Final

import numpy as np

from hrclog.analyzers.figures.arrays import FloatArray, IntArray

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
