"""The fit of the rate model to one task: its parameters, their covariances, and the models that come of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hrclog.analyzers.projections.joint_states import AgentTask
from hrclog.analyzers.synergy.aft_likelihood import Posterior, Prior, expected_information, log_posterior
from hrclog.analyzers.synergy.exposures import Exposure
from hrclog.analyzers.synergy.fit import Covariance, TaskModel
from hrclog.analyzers.synergy.log_work import NormalLogWork
from hrclog.analyzers.synergy.outlier_methods import Outliers, inliers
from hrclog.arrays import FloatArray

_ROUNDS: Final = 20
_SETTLED: Final = 1e-4


@dataclass(frozen=True, slots=True)
class TaskFit:
    """The fit of one (agent, task) against P tasks of others.

    Attributes:
        data: what was fitted.
        parameters: (mu, log sigma, log s), shape (2 + P,).
        covariance: inverse of minus the Hessian, shape (2 + P, 2 + P).
        mean_covariance: inverse of the expected information, shape (2 + P, 2 + P).
        spent: degrees of freedom that mu and the factors take from sigma.
        freedom: those that are left to it, at least 1.
    """

    data: Exposure
    parameters: FloatArray
    covariance: FloatArray
    mean_covariance: FloatArray
    spent: float
    freedom: float

    def deviation(self, direction: FloatArray) -> float:
        """Return the standard deviation of a combination of parameters, the larger that the two covariances give.

        Each alone knows too much somewhere: the Hessian leans on the shape of the noise, and the expected information
        takes it for evidence that an execution which took longer met more. It is infinite where a covariance is none,
        so that nothing counts as learnt.

        Args:
            direction: shape (2 + P,).
        """
        variances = [
            float(direction @ covariance @ direction) for covariance in (self.covariance, self.mean_covariance)
        ]
        return math.sqrt(max(variances)) if min(variances) > 0 else math.inf

    @property
    def mu(self) -> float:
        """Return the mean of log work."""
        return float(self.parameters[0])

    @property
    def sigma(self) -> float:
        """Return the standard deviation of log work."""
        return math.exp(self.parameters[1])

    @property
    def log_s(self) -> FloatArray:
        """Return the log factors, shape (P,)."""
        return self.parameters[2:]


def models_of(fits: Sequence[TaskFit]) -> tuple[dict[AgentTask, TaskModel], tuple[Covariance, ...]]:
    """Return the models of fits, and their covariances."""
    models = {
        fit.data.key: TaskModel(
            dict(zip(fit.data.others, fit.log_s.tolist(), strict=True)), NormalLogWork(fit.mu, fit.sigma)
        )
        for fit in fits
    }
    return models, tuple(Covariance(_names(fit.data), fit.covariance) for fit in fits)


def fit_task(data: Exposure, prior: Prior) -> TaskFit:
    """Fit one task.

    Args:
        data: at least one execution that succeeded.
        prior: of factors and sigma.
    """
    log_durations = np.log(data.work(np.zeros(len(data.others)))[data.finished])
    start = [log_durations.mean(), math.log(max(float(log_durations.std()), prior.sigma))]
    parameters = np.concatenate([start, np.zeros(len(data.others))])
    n, spent, previous = int(data.finished.sum()), 1.0, math.nan
    for _ in range(_ROUNDS):
        if abs(spent - previous) < _SETTLED:
            break
        parameters = _maximum(parameters, data, prior, spent)
        covariance = _inverse(-log_posterior(parameters, data, prior, spent).hessian)
        taken = 1 + float((1 - np.diag(covariance)[2:] / prior.tau**2).clip(0).sum())
        # more than the data hold cannot be taken from them
        previous, spent = spent, min(taken, n + prior.freedom - 0.5)
    mean_covariance = _inverse(expected_information(parameters, data, prior))
    return TaskFit(data, parameters, covariance, mean_covariance, previous, max(n + prior.freedom - previous, 1.0))


def _inverse(information: FloatArray) -> FloatArray:
    inverse: FloatArray = np.linalg.inv(information).astype(np.float64, copy=False)
    return inverse


def _maximum(start: FloatArray, data: Exposure, prior: Prior, spent: float) -> FloatArray:
    """Return where the log posterior is highest, uphill from a start."""
    from scipy.optimize import minimize

    scale = len(data.finished)
    last: dict[bytes, Posterior] = {}

    def at(x: FloatArray) -> Posterior:
        """Return all three at once: the optimizer asks for them one by one."""
        key = x.tobytes()
        if key not in last:
            last.clear()
            last[key] = log_posterior(x, data, prior, spent)
        return last[key]

    optimum = minimize(
        lambda x: -at(x).value / scale,
        start,
        jac=lambda x: -at(x).gradient / scale,
        hess=lambda x: -at(x).hessian / scale,
        method="trust-exact",
        options={"gtol": 1e-9},
    )
    result: FloatArray = optimum.x
    return result


def inlying(data: Exposure, outliers: Outliers) -> Exposure:
    """Return the executions without outliers in log duration; those that did not succeed stay."""
    if outliers == "none":
        return data
    kept = np.ones(len(data.finished), np.bool_)
    kept[data.finished] = inliers(np.log(data.work(np.zeros(len(data.others)))[data.finished]), outliers)
    return data.rows(kept)


def _names(data: Exposure) -> tuple[str | tuple[str, str, str, str], ...]:
    return ("mu", "log_sigma", *((*data.key, *other) for other in data.others))
