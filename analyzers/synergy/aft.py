"""The default estimator: a rate model with time-varying concurrency (accelerated failure time).

    W = sum over j of o_j / s_j,  log W ~ N(mu, sigma^2)

per task i of agent A, with s_j the factor while task j of another agent runs, 1 while the others idle; with several
other agents factors multiply. Everything the others do counts, whatever came of it; executions of i that did not
succeed are censored: they would have taken longer than they did (taken as independent of how long).

Fitted by maximum a posteriori, sigma by restricted maximum likelihood; standard errors from Hessian and expected
information there, intervals Student's on the logarithm.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from hrclog.analyzers.synergy.aft_fit import TaskFit, fit_task, inlying, models_of
from hrclog.analyzers.synergy.aft_likelihood import Prior
from hrclog.analyzers.synergy.estimator import Estimator
from hrclog.analyzers.synergy.evidence import by_evidence
from hrclog.analyzers.synergy.exposures import exposures
from hrclog.analyzers.synergy.fit import Fit
from hrclog.analyzers.synergy.observations import Observations
from hrclog.analyzers.synergy.outlier_methods import Outliers
from hrclog.analyzers.synergy.pairs import synergy_table
from hrclog.analyzers.synergy.regression import mean_durations

LEAST_IDLE: Final = 0.1
"""With less of its time beside an idle other agent, work on its own is not told from work beside it."""

LEAST_LEARNT: Final = 0.6
"""A factor whose posterior deviation is more than this part of its prior's was not learnt, unless 1 is excluded."""

_UNKNOWN: Final = (math.nan,) * 4


def aft(observations: Observations, outliers: Outliers = "none", prior: Prior | None = None) -> Fit:
    """Estimate synergies by the rate model.

    Args:
        observations: what to learn from.
        outliers: which executions to leave out, by their log duration; those that did not succeed stay.
        prior: of factors and sigma.
    """
    prior = prior or Prior()
    fits = [fit_task(inlying(data, outliers), prior) for data in exposures(observations) if data.finished.any()]
    means = mean_durations(observations)
    rows = [row for fit in fits for row in _rows(fit, means[fit.data.key], prior)]
    table = synergy_table(observations.executions, observations.meetings, rows, "aft", cut_short=True)
    return Fit(table, *models_of(fits))


def _rows(fit: TaskFit, mean_s: float, prior: Prior) -> Iterator[tuple[Any, ...]]:
    """Yield the numbers of each row of the table; NaN where the data do not identify them."""
    from scipy.special import stdtrit

    wide = float(stdtrit(fit.freedom, 0.975))
    for number, other in enumerate(fit.data.others):
        direction = np.zeros(len(fit.parameters))
        direction[2 + number] = 1.0
        free_deviation = fit.deviation(direction)
        direction[:2] = 1.0, fit.sigma**2  # of log mean work, mu + sigma^2 / 2
        deviation = fit.deviation(direction)
        log_s = float(fit.log_s[number])
        log_synergy = fit.mu + fit.sigma**2 / 2 + log_s - math.log(mean_s)
        # an effect that is clearly there was learnt, however uncertain its size
        clear = abs(log_s) > wide * free_deviation
        learnt = clear or deviation < LEAST_LEARNT * prior.tau
        free = (
            learnt
            and (clear or free_deviation < LEAST_LEARNT * prior.tau)
            and fit.data.idle_share(other[0]) >= LEAST_IDLE
        )
        numbers = _lognormal(log_synergy, deviation, wide) if learnt else _UNKNOWN
        free_numbers = _lognormal(log_s, free_deviation, wide) if free else _UNKNOWN
        yield (*fit.data.key, *other, *numbers, *free_numbers, free)


def _lognormal(log_value: float, deviation: float, wide: float) -> tuple[float, float, float, float]:
    """Return value, standard error and the ends of the interval."""
    value = math.exp(log_value)
    half = wide * deviation
    return value, value * deviation, math.exp(log_value - half), math.exp(log_value + half)


class Aft(Estimator):
    """The rate model."""

    name = "aft"
    summary = "rate model with time-varying concurrency (accelerated failure time)"
    assumes = (
        "a rate model: while another's task runs, work goes on at 1/s of its rate; work is log-normal, and factors are "
        "shrunk towards 1. It assumes that disturbance depends on which task the other runs, not on how far that is, "
        "and that failures do not depend on how long the work would have taken."
    )
    counts_cut_short = True
    conformal = True
    version = 2

    def fit(self, observations: Observations, outliers: Outliers = "none") -> Fit:
        """Estimate synergies by the rate model."""
        return aft(observations, outliers)

    def for_planning(self, fit: Fit, observations: Observations, outliers: Outliers = "none") -> Fit:
        """Return the models under the prior width that the evidence favours for each task."""
        return by_evidence(fit, observations, outliers)
