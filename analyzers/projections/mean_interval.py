"""How sure a mean is: Student's 95 % interval."""

from __future__ import annotations

import numpy as np

from hrclog.arrays import FloatArray, IntArray


def mean_interval(values: FloatArray) -> tuple[float, float | None, float | None]:
    """Return the mean of values and the ends of its 95 % interval, None below two values.

    Args:
        values: at least one, shape (n,); taken as independent of each other.
    """
    # sorted, the sum does not depend on the order
    ordered = np.sort(values)
    mean = float(ordered.mean())
    if len(ordered) < 2:
        return mean, None, None
    half = float(half_width(np.array([ordered.std(ddof=1)]), np.array([len(ordered)]))[0])
    return mean, mean - half, mean + half


def half_width(std: FloatArray, n: IntArray) -> FloatArray:
    """Return half the width of the 95 % interval of each mean, t(0.975, n - 1) std / sqrt(n); NaN below two values.

    Args:
        std: sample standard deviations (ddof = 1), shape (m,).
        n: how many values each mean is of, shape (m,).
    """
    from scipy.special import stdtrit

    enough = n > 1
    freedom = np.where(enough, n - 1, 1)
    half: FloatArray = np.where(enough, stdtrit(freedom, 0.975) * std / np.sqrt(np.maximum(n, 1)), np.nan)
    return half
