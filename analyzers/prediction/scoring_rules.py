"""Proper scoring rules for one forecast of a duration (Gneiting and Raftery 2007)."""

from __future__ import annotations

from typing import Final

import numpy as np

from hrclog.arrays import FloatArray

LEVELS: Final[FloatArray] = (np.arange(100) + 0.5) / 100
"""At which forecasts give quantiles."""

LOW, HIGH = 0.05, 0.95
"""The ends of the 90 % interval."""


def crps(quantiles: FloatArray, observed: float) -> float:
    """Return the continuous ranked probability score, twice the mean pinball loss; the unit is that of the forecast.

    Args:
        quantiles: at `LEVELS`, shape (100,).
        observed: what happened.
    """
    error = observed - quantiles
    return 2 * float(np.where(error >= 0, LEVELS * error, (LEVELS - 1) * error).mean())


def interval_score(low: float, high: float, observed: float) -> float:
    """Return the width of the 90 % interval plus 20 times what the observation lies outside it."""
    return high - low + 2 / (1 - (HIGH - LOW)) * (max(low - observed, 0.0) + max(observed - high, 0.0))
