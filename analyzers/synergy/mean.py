"""The yardstick: nobody disturbs anybody, a task takes as long as it took."""

from __future__ import annotations

import math
from typing import Final

from hrclog.analyzers.projections.overlaps import PAIR
from hrclog.analyzers.synergy.estimator import Estimator
from hrclog.analyzers.synergy.fit import Fit
from hrclog.analyzers.synergy.observations import Observations
from hrclog.analyzers.synergy.outlier_methods import Outliers
from hrclog.analyzers.synergy.pairs import synergy_table
from hrclog.analyzers.synergy.sampled_models import sampled_models

_ASSUMED: Final = (1.0, *(math.nan,) * 3)


def mean(observations: Observations, outliers: Outliers = "none") -> Fit:  # noqa: ARG001 - an estimator's signature
    """Assume that every factor is 1; the table says so without an error, for nothing was learnt.

    Args:
        observations: what to learn from.
        outliers: has no effect.
    """
    rows = [(*key, *_ASSUMED, *_ASSUMED, True) for key in observations.pairs.select(PAIR).unique().sort(PAIR).rows()]
    table = synergy_table(observations.executions, observations.meetings, rows, "mean")
    return Fit(table, sampled_models(observations, table))


class Mean(Estimator):
    """The yardstick of a world without synergies."""

    name = "mean"
    summary = "no synergies at all: a task takes as long as it took"
    assumes = "the assumption that no task affects another's duration."

    def fit(self, observations: Observations, outliers: Outliers = "none") -> Fit:
        """Assume that every factor is 1."""
        return mean(observations, outliers)
