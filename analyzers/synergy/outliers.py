"""Which rows of a regression to keep."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from hrclog.arrays import BoolArray, FloatArray

Outliers = Literal["none", "isolation-forest"]

_SEED: Final = 0
_FEWEST: Final = 2  # a forest of a single sample isolates nothing


def inliers(y: FloatArray, method: Outliers) -> BoolArray:
    """Return which rows to keep, shape (n,); all of them where none stands out.

    The isolation forest (Liu et al. 2008) is fitted on y alone, as the paper's authors do. It drops rows from both
    tails, among them slow ones that are the effect to be learnt, so it is an option and never the default.

    Args:
        y: the regression's left side, shape (n,).
        method: none keeps all; isolation-forest is seeded.
    """
    if method == "none" or len(y) < _FEWEST:
        return np.ones(len(y), np.bool_)
    from sklearn.ensemble import IsolationForest

    kept: BoolArray = IsolationForest(random_state=_SEED).fit_predict(y[:, None]) == 1
    return kept if kept.any() else ~kept  # it calls all outliers where all are equal
