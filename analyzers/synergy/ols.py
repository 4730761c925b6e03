"""The published regression by ordinary least squares: `ols` as the authors' code has it, `paper` as it is printed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any, Final

import numpy as np

from hrclog.analyzers.synergy.estimator import Estimator
from hrclog.analyzers.synergy.fit import Covariance, Fit
from hrclog.analyzers.synergy.least_squares import LeastSquares, fit
from hrclog.analyzers.synergy.observations import Observations
from hrclog.analyzers.synergy.outlier_methods import Outliers
from hrclog.analyzers.synergy.pairs import synergy_table
from hrclog.analyzers.synergy.regression import Regression, concurrent_shares, own_shares
from hrclog.analyzers.synergy.sampled_models import sampled_models

_NOT_KNOWN: Final = (math.nan,) * 4


def ols(observations: Observations, outliers: Outliers = "none") -> Fit:
    """Estimate synergies as the paper's authors' code does.

    Args:
        observations: what to learn from; executions that did not succeed are company only.
        outliers: which rows of each regression to leave out.
    """
    return _estimate("ols", observations, concurrent_shares(observations, outliers))


def paper(observations: Observations, outliers: Outliers = "none") -> Fit:
    """Estimate synergies as the paper prints it.

    Args:
        observations: what to learn from; executions that did not succeed are company only.
        outliers: which rows of each regression to leave out.
    """
    return _estimate("paper", observations, own_shares(observations, outliers))


def _estimate(name: str, observations: Observations, regressions: Iterable[Regression]) -> Fit:
    from threadpoolctl import threadpool_limits

    # many small problems: threads make each slower, and its last digits depend on their number
    with threadpool_limits(1, "blas"):
        solutions = [(regression, fit(regression.x, regression.y)) for regression in regressions]
    rows = [row for regression, result in solutions for row in _rows(regression, result)]
    table = synergy_table(observations.executions, observations.meetings, rows, name)
    covariances = tuple(Covariance(regression.keys, result.covariance) for regression, result in solutions)
    return Fit(table, sampled_models(observations, table), covariances)


def _rows(regression: Regression, result: LeastSquares) -> Iterator[tuple[Any, ...]]:
    numbers = np.stack([result.coefficients, result.std_errors, result.low, result.high], axis=1).tolist()
    for key, values, identified in zip(regression.keys, numbers, result.identified.tolist(), strict=True):
        yield (*key, *values, *_NOT_KNOWN, identified)


class Ols(Estimator):
    """The regression of the authors' code."""

    name = "ols"
    summary = "least squares of the authors' code (Sandrini, Faroni, Pedrocchi 2022)"
    assumes = (
        "the least squares of the authors' code (Sandrini, Faroni, Pedrocchi, ETFA 2022). Strong factors come out "
        "about a third too small, and factors below 0 are possible."
    )
    version = 2
    caution = "By ols strong factors come out about a third too small."

    def fit(self, observations: Observations, outliers: Outliers = "none") -> Fit:
        """Estimate synergies as the paper's authors' code does."""
        return ols(observations, outliers)


class Paper(Estimator):
    """The regression as it is printed."""

    name = "paper"
    summary = "least squares as the paper prints it, for comparison"
    assumes = (
        "the regression as printed in Sandrini, Faroni and Pedrocchi (ETFA 2022), kept for comparison; its "
        "coefficients should not be planned with."
    )
    version = 2
    caution = "These factors are the regression's as printed, kept for comparison: they should not be planned with."

    def fit(self, observations: Observations, outliers: Outliers = "none") -> Fit:
        """Estimate synergies as the paper prints it."""
        return paper(observations, outliers)
