"""Lognormal and gamma distributions fitted to durations by maximum likelihood.

Durations may agree to the nanosecond, so what the fits need - the gap between the log of the mean and the mean of the
logs, and how far log and digamma are apart - is computed without subtracting large numbers from each other.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from hrclog.arrays import FloatArray

NAMES: Final = ("lognormal_mu", "lognormal_sigma", "lognormal_aic", "gamma_shape", "gamma_scale_s", "gamma_aic")


_NEWTON_STEPS: Final = 50
_LARGE_SHAPE: Final = 100.0  # beyond it the asymptotic series are exact to rounding
_NO_SPREAD: Final = 1e-12  # relative; durations are nanoseconds


def fit_distributions(seconds: FloatArray) -> dict[str, float | None]:
    """Fit a lognormal and a gamma distribution by maximum likelihood, with AIC = 4 - 2 log-likelihood.

    Args:
        seconds: durations, shape (n,).

    Returns:
        Parameters by column name; None where fewer than two different positive durations leave them undefined.
    """
    if len(seconds) < 2 or seconds.min() <= 0 or np.ptp(seconds) <= _NO_SPREAD * seconds.max():
        return dict.fromkeys(NAMES)
    return dict(zip(NAMES, (*_fit_lognormal(np.log(seconds)), *_fit_gamma(seconds)), strict=True))


def _fit_lognormal(logs: FloatArray) -> tuple[float, float, float]:
    n, mu, sigma = len(logs), float(logs.mean()), float(logs.std())
    log_likelihood = -n / 2 * (math.log(2 * math.pi * sigma * sigma) + 1) - float(logs.sum())
    return mu, sigma, 4 - 2 * log_likelihood


def _fit_gamma(seconds: FloatArray) -> tuple[float, float, float]:
    """Newton's method on log shape - digamma(shape) = log mean - mean log (Minka 2002 gives the start)."""
    n, mean = len(seconds), float(seconds.mean())
    gap = _log_gap(seconds, mean)
    shape = (3 - gap + math.sqrt((gap - 3) ** 2 + 24 * gap)) / (12 * gap)
    for _ in range(_NEWTON_STEPS):
        value, slope = _log_minus_digamma(shape)
        step = (value - gap) / slope
        shape = shape - step if step < shape else shape / 2
        if abs(step) < 1e-12 * shape:
            break
    mean_log = float(np.log(seconds).mean())
    log_likelihood = n * (_stirling_rest(shape) - shape * gap - mean_log)
    return shape, mean / shape, 4 - 2 * log_likelihood


def _log_gap(seconds: FloatArray, mean: float) -> float:
    """Return log mean - mean log."""
    if np.ptp(seconds) > mean:
        return math.log(mean) - float(np.log(seconds).mean())
    deviation = seconds / mean - 1
    return float((deviation - np.log1p(deviation)).mean())


def _log_minus_digamma(shape: float) -> tuple[float, float]:
    """Return log x - digamma(x) and its derivative (series: Abramowitz and Stegun 6.3.18)."""
    if shape < _LARGE_SHAPE:
        from scipy.special import digamma, polygamma

        return math.log(shape) - float(digamma(shape)), 1 / shape - float(polygamma(1, shape))
    r = 1 / shape
    value = r * (1 / 2 + r * (1 / 12 - r * r * (1 / 120 - r * r / 252)))
    slope = -r * r * (1 / 2 + r * (1 / 6 - r * r * (1 / 30 - r * r / 42)))
    return value, slope


def _stirling_rest(shape: float) -> float:
    """Return x log x - x - log gamma(x) (series: Abramowitz and Stegun 6.1.41)."""
    if shape < _LARGE_SHAPE:
        return shape * math.log(shape) - shape - math.lgamma(shape)
    r = 1 / shape
    return math.log(shape / (2 * math.pi)) / 2 - r * (1 / 12 - r * r * (1 / 360 - r * r / 1260))
