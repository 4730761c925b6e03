"""What an outlier method is, and the built-in ones."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, Final

import numpy as np

from hrclog.arrays import BoolArray, FloatArray

_SEED: Final = 0
_FEWEST: Final = 2  # a forest of a single sample isolates nothing


class OutlierMethod(ABC):
    """Says which rows stand out.

    Attributes:
        name: by which it is chosen.
        summary: one line for lists.
        remark: what the report says of an analysis that used it.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    remark: ClassVar[str]

    @abstractmethod
    def keep(self, y: FloatArray) -> BoolArray:
        """Return which rows to keep, shape (n,).

        Args:
            y: the regression's left side, shape (n,).
        """


class KeepAll(OutlierMethod):
    """No row is left out."""

    name = "none"
    summary = "keep every execution"
    remark = "No execution was left out as an outlier."

    def keep(self, y: FloatArray) -> BoolArray:
        """Return that all rows are kept."""
        return np.ones(len(y), np.bool_)


class Forest(OutlierMethod):
    """The isolation forest (Liu et al. 2008) on y alone, seeded, as the paper's authors use it.

    It drops rows from both tails, among them slow ones that are the effect to be learnt, so it is never the default.
    """

    name = "isolation-forest"
    summary = "leave out what an isolation forest calls outliers, from both tails, as the paper does"
    remark = (
        "An isolation forest left out what it calls outliers, commonly a sixth to a third of the executions, from both "
        "tails; among them are the slowest, which are the effect to be learnt."
    )

    def keep(self, y: FloatArray) -> BoolArray:
        """Return the rows that the forest does not isolate; all of them where none stands out."""
        if len(y) < _FEWEST:
            return np.ones(len(y), np.bool_)
        from sklearn.ensemble import IsolationForest

        kept: BoolArray = IsolationForest(random_state=_SEED).fit_predict(y[:, None]) == 1
        return kept if kept.any() else ~kept  # it calls all outliers where all are equal
