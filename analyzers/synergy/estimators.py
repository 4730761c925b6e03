"""The estimators by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import polars as pl

from hrclog.analyzers.synergy.outliers import Outliers
from hrclog.analyzers.synergy.regression import ols, paper

Estimator = Callable[[pl.DataFrame, Outliers], pl.DataFrame]
"""Takes intervals and how to treat outliers; returns a frame of schema `SYNERGIES`."""

ESTIMATORS: Final[dict[str, Estimator]] = {"ols": ols, "paper": paper}
OUTLIERS: Final[tuple[Outliers, ...]] = ("none", "isolation-forest")
