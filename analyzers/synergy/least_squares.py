"""Ordinary least squares without an intercept, that says which coefficients the data identify."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_RANK_TOLERANCE: Final = 1e-10  # of the largest singular value, columns scaled to unit length


@dataclass(frozen=True, slots=True)
class LeastSquares:
    """A fit; NaN where a coefficient, its standard error or its interval is not identified. Shapes (p,)."""

    coefficients: Floats
    std_errors: Floats
    low: Floats
    high: Floats
    identified: npt.NDArray[np.bool_]


def fit(x: Floats, y: Floats) -> LeastSquares:
    """Fit y = X s and return s, its usual standard errors and Student 95 % intervals.

    sigma^2 = |y - X s|^2 / (n - rank), cov = sigma^2 (X'X)^-1. A coefficient is identified when no direction in which
    X is blind has a part in it.

    Args:
        x: shape (n, p), no zero column.
        y: shape (n,).
    """
    from scipy.special import stdtrit

    scale = np.linalg.norm(x, axis=0)
    u, singular, vt = np.linalg.svd(x / scale, full_matrices=False)
    keep = singular > _RANK_TOLERANCE * singular.max(initial=0.0)
    u, singular, vt = u[:, keep], singular[keep], vt[keep]
    solution = vt.T @ ((u.T @ y) / singular) / scale
    identified = np.abs((vt**2).sum(axis=0) - 1) < 1e-8
    freedom = len(y) - len(singular)
    residual = y - x @ solution
    variance = float(residual @ residual) / freedom if freedom > 0 else np.nan
    std_errors = np.sqrt(variance * ((vt / singular[:, None]) ** 2).sum(axis=0)) / scale
    half = float(stdtrit(freedom, 0.975)) * std_errors if freedom > 0 else std_errors
    unknown = np.where(identified, 0.0, np.nan)
    return LeastSquares(
        solution + unknown, std_errors + unknown, solution - half + unknown, solution + half + unknown, identified
    )
