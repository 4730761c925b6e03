"""Ordinary least squares without an intercept, that says which coefficients the data identify."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from hrclog.arrays import BoolArray, FloatArray

_RANK_TOLERANCE: Final = 1e-10  # of the largest singular value, columns scaled to unit length


@dataclass(frozen=True, slots=True)
class LeastSquares:
    """A fit; NaN where a number is not identified. Shapes (p,), the covariance (p, p)."""

    coefficients: FloatArray
    std_errors: FloatArray
    low: FloatArray
    high: FloatArray
    identified: BoolArray
    covariance: FloatArray


@dataclass(frozen=True, slots=True)
class _Solution:
    """Coefficients, a root F of (X'X)^-1 = F F', the rank, and what is identified."""

    coefficients: FloatArray
    root: FloatArray
    rank: int
    identified: BoolArray


def fit(x: FloatArray, y: FloatArray) -> LeastSquares:
    """Fit y = X s and return s, its usual standard errors and Student 95 % intervals.

    sigma^2 = |y - X s|^2 / (n - rank), cov = sigma^2 (X'X)^-1. A coefficient is identified when no direction in which
    X is blind has a part in it.

    Args:
        x: shape (n, p), no zero column.
        y: shape (n,).
    """
    from scipy.special import stdtrit

    scale = np.linalg.norm(x, axis=0)
    unit = x / scale
    solution = _by_qr(unit, y) or _by_svd(unit, y)
    coefficients = np.where(solution.identified, solution.coefficients / scale, np.nan)
    freedom = len(y) - solution.rank
    residual = y - unit @ solution.coefficients
    variance = float(residual @ residual) / freedom if freedom > 0 else np.nan
    spread = np.linalg.norm(solution.root, axis=1)
    std_errors = np.where(solution.identified, np.sqrt(variance) * spread / scale, np.nan)
    half = float(stdtrit(freedom, 0.975)) * std_errors if freedom > 0 else std_errors
    root = np.where(solution.identified[:, None], solution.root / scale[:, None], np.nan)
    covariance = variance * (root @ root.T)
    return LeastSquares(
        coefficients, std_errors, coefficients - half, coefficients + half, solution.identified, covariance
    )


def _by_qr(unit: FloatArray, y: FloatArray) -> _Solution | None:
    """Solve by QR where X has full rank beyond doubt, else return None; ten times faster than by SVD.

    |R| and |R^-1| (Frobenius) bound the largest and the inverse of the smallest singular value.
    """
    from scipy.linalg.lapack import dtrtri

    n, p = unit.shape
    if n < p:
        return None
    q, r = np.linalg.qr(unit)
    inverse, singular = dtrtri(r)
    if singular or not np.linalg.norm(r) * np.linalg.norm(inverse) * _RANK_TOLERANCE < 1:
        return None
    return _Solution(inverse @ (q.T @ y), inverse, p, np.ones(p, np.bool_))


def _by_svd(unit: FloatArray, y: FloatArray) -> _Solution:
    """Solve by singular values, leaving out the directions in which X is blind."""
    u, singular, vt = np.linalg.svd(unit, full_matrices=False)
    keep = singular > _RANK_TOLERANCE * singular.max()
    u, singular, vt = u[:, keep], singular[keep], vt[keep]
    identified = np.abs((vt**2).sum(axis=0) - 1) < 1e-8
    return _Solution(vt.T @ ((u.T @ y) / singular), vt.T / singular, len(singular), identified)
