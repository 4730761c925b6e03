"""How probable factors are by chance, according to their intervals: each alone and among many comparisons."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

_WIDTH: Final = 2 * 1.959964  # standard errors that a 95 % interval spans


def p_value(factor: float, low: float, high: float) -> float:
    """Return the two-sided probability of a factor at least as far from 1 if there is no effect.

    The log of the factor is taken to be normal. If an end of the interval is not above 0, the factor itself is.

    Args:
        factor: the estimate.
        low: end of its interval.
        high: end of its interval.
    """
    if min(factor, low) > 0:
        effect, width = math.log(factor), math.log(high) - math.log(low)
    else:
        effect, width = factor - 1, high - low
    if width <= 0:
        return 0.0 if effect else 1.0
    return math.erfc(abs(effect) / (width / _WIDTH) / math.sqrt(2))


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p-values corrected for the number of comparisons, which may depend on each other.

    S. Holm, A simple sequentially rejective multiple test procedure, Scandinavian Journal of Statistics 6, 1979.

    Args:
        p_values: one per comparison.
    """
    adjusted = [0.0] * len(p_values)
    largest = 0.0
    for rank, place in enumerate(sorted(range(len(p_values)), key=p_values.__getitem__)):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[place]))
        adjusted[place] = largest
    return adjusted
