"""Choose how much tasks may affect each other: the width of each task's prior, by the evidence of the runs.

Where a task hardly ever ran beside nobody, its work and the factors of the others are told apart by the prior alone.
A task that nobody affects then gets factors around any value, with work to match. The width tau of the prior of its
log factors tells which it is: the marginal likelihood, by Laplace's approximation

    log p(D | tau) = l(x) - P log tau + log |S| / 2 + const,   x the maximum, S its covariance, P factors,

is highest at a small tau where no factor is needed (empirical Bayes; MacKay 1992). It decides in favour of planning,
which adds factors up, and not of reading single ones: tables keep the fixed prior, which pulls at all alike.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from hrclog.analyzers.synergy.aft_fit import TaskFit, fit_task, inlying, models_of
from hrclog.analyzers.synergy.aft_likelihood import Prior, log_posterior
from hrclog.analyzers.synergy.exposures import Exposure, exposures
from hrclog.analyzers.synergy.fit import Fit
from hrclog.analyzers.synergy.observations import Observations
from hrclog.analyzers.synergy.outlier_methods import Outliers

WIDTHS: Final = (0.05, 0.2, 0.75)
"""From hardly any effect to the fixed prior's; ties go to the first."""


def by_evidence(fit: Fit, observations: Observations, outliers: Outliers) -> Fit:
    """Return a fit of `aft` with the models and covariances of evidence's widths; its table stays.

    Args:
        fit: of the fixed prior.
        observations: what it was made of.
        outliers: which executions it left out.
    """
    fits = [fit_by_evidence(inlying(data, outliers)) for data in exposures(observations) if data.finished.any()]
    models, covariances = models_of(fits)
    return replace(fit, models=models, covariances=covariances)


def fit_by_evidence(data: Exposure) -> TaskFit:
    """Fit one task under the prior width that its executions make most likely.

    Args:
        data: at least one execution that succeeded.
    """
    priors = [Prior(tau=tau) for tau in WIDTHS]
    fits = [fit_task(data, prior) for prior in priors]
    return max(zip(fits, priors, strict=True), key=lambda fitted: log_evidence(*fitted))[0]


def log_evidence(fit: TaskFit, prior: Prior) -> float:
    """Return the log marginal likelihood of a task's executions, up to a constant."""
    sign, log_volume = np.linalg.slogdet(fit.covariance)
    if sign <= 0:
        return -math.inf
    at_maximum = log_posterior(fit.parameters, fit.data, prior, fit.spent).value
    return float(at_maximum - len(fit.log_s) * math.log(prior.tau) + 0.5 * log_volume)
