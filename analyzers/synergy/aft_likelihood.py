"""The log posterior of the accelerated failure time model, with gradient and Hessian.

Work is done at the rate prod 1 / s_j over what the other agents do, so an execution's work is W = sum over joint states
of seconds / prod s_j, and log W ~ N(mu, sigma^2). The density of a *duration* needs the Jacobian dW/dD, the rate at
the end, and that of the logarithm:

    l = -log(2 pi)/2 - log sigma - z^2/2 - log W - sum over j at the end of log s_j,    z = (log W - mu) / sigma

An execution that did not succeed is censored: l = log(1 - Phi(z)). Prior: log s_j ~ N(0, tau^2), and the variance of
log *durations*, exp(2 spread), is scaled inverse chi-squared:

    spread = log sigma + mean over finished executions of (log W - log D + sum over j at the end of log s_j)

is log sigma, carried from work to durations by the Jacobian; a prior of sigma itself would pull at the factors where
durations hardly vary. Parameters are (mu, log sigma, log s_1, ..., log s_P).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hrclog.analyzers.synergy.exposures import Exposure
from hrclog.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class Prior:
    """What is believed before any run.

    Attributes:
        tau: standard deviation of log s around no effect.
        sigma: scale of the prior of the spread of log durations.
        freedom: how many executions that prior is worth.
    """

    tau: float = 0.75
    sigma: float = 0.05
    freedom: float = 1.0


@dataclass(frozen=True, slots=True)
class Posterior:
    """The log posterior at one point; shapes (), (2 + P,), (2 + P, 2 + P)."""

    value: float
    gradient: FloatArray
    hessian: FloatArray


@dataclass(frozen=True, slots=True)
class _Derivatives:
    """Per execution: l, and its derivatives by mu, log sigma and u = log W; shapes (K,).

    By symmetry the mixed derivatives with u are minus those with mu.
    """

    value: FloatArray
    mu: FloatArray
    scale: FloatArray
    u: FloatArray
    mu_mu: FloatArray
    mu_scale: FloatArray
    scale_scale: FloatArray


def log_posterior(parameters: FloatArray, data: Exposure, prior: Prior, spent: float = 0.0) -> Posterior:
    """Evaluate the log posterior.

    Args:
        parameters: (mu, log sigma, log s), shape (2 + P,).
        data: executions of one task.
        prior: of log s and sigma.
        spent: degrees of freedom that location and factors take from the spread's estimate; p spent ones add p times
            the spread, as integrating them out does (restricted maximum likelihood, Patterson and Thompson 1971).
    """
    mu, log_sigma, log_s = float(parameters[0]), float(parameters[1]), parameters[2:]
    rate = np.exp(-(data.members @ log_s))
    work = data.seconds @ rate
    u = np.log(work)
    by_u = -(data.seconds @ (rate[:, None] * data.members)) / work[:, None]  # du / dlog s, shape (K, P)
    at_end = data.members[data.last]
    terms = _derivatives(u, mu, log_sigma, data.finished)
    value = terms.value.sum() - (at_end @ log_s)[data.finished].sum()
    gradient = np.concatenate([[terms.mu.sum(), terms.scale.sum()], terms.u @ by_u - at_end[data.finished].sum(axis=0)])
    hessian = np.empty((len(parameters),) * 2)
    hessian[0, 0], hessian[1, 1] = terms.mu_mu.sum(), terms.scale_scale.sum()
    hessian[0, 1] = hessian[1, 0] = terms.mu_scale.sum()
    hessian[0, 2:] = hessian[2:, 0] = -(terms.mu_mu @ by_u)
    hessian[1, 2:] = hessian[2:, 1] = -(terms.mu_scale @ by_u)
    bend = rate * (data.seconds.T @ (terms.u / work))  # of W itself, per state
    hessian[2:, 2:] = (by_u.T * (terms.mu_mu - terms.u)) @ by_u + (data.members.T * bend) @ data.members

    value -= 0.5 * float(log_s @ log_s) / prior.tau**2
    gradient[2:] -= log_s / prior.tau**2
    hessian[2:, 2:] -= np.eye(len(log_s)) / prior.tau**2
    ended = data.finished / max(int(data.finished.sum()), 1)
    spread = log_sigma + _stretch(data, u, log_s)
    by_spread = np.concatenate([[0.0, 1.0], ended @ (by_u + at_end)])
    bend = rate * (data.seconds.T @ (ended / work))
    curvature = (data.members.T * bend) @ data.members - (by_u.T * ended) @ by_u  # of the spread, by factors
    pull = prior.freedom * prior.sigma**2 / math.exp(2 * spread)
    slope = spent - prior.freedom + pull
    value += (spent - prior.freedom) * spread - 0.5 * pull
    gradient += slope * by_spread
    hessian -= 2 * pull * np.outer(by_spread, by_spread)
    hessian[2:, 2:] += slope * curvature
    return Posterior(float(value), gradient, hessian)


def expected_information(parameters: FloatArray, data: Exposure, prior: Prior) -> FloatArray:
    """Return what the data and the prior say about the parameters through the mean of log work, shape (2 + P, 2 + P).

    This is the Hessian without the terms in which factors change the spread of durations: those lean on the shape of
    the noise, and claim to know factors that were never varied (identical runs, say). Positive semidefinite, with log
    sigma apart from the rest.

    Args:
        parameters: (mu, log sigma, log s), shape (2 + P,).
        data: executions of one task.
        prior: of log s and sigma.
    """
    mu, log_sigma, log_s = float(parameters[0]), float(parameters[1]), parameters[2:]
    rate = np.exp(-(data.members @ log_s))
    work = data.seconds @ rate
    shares = (data.seconds @ (rate[:, None] * data.members)) / work[:, None]  # of the work, per factor in force
    terms = _derivatives(np.log(work), mu, log_sigma, data.finished)
    design = np.concatenate([np.ones((len(work), 1)), shares], axis=1)
    information = np.zeros((len(parameters),) * 2)
    mean = np.array([0, *range(2, len(parameters))])
    information[np.ix_(mean, mean)] = (design.T * -terms.mu_mu) @ design
    spread = log_sigma + _stretch(data, np.log(work), log_s)
    information[1, 1] = -terms.scale_scale.sum() + 2 * prior.freedom * prior.sigma**2 / math.exp(2 * spread)
    factors = np.arange(2, len(parameters))
    information[factors, factors] += 1 / prior.tau**2
    return information


def _stretch(data: Exposure, log_work: FloatArray, log_s: FloatArray) -> float:
    """Return the log of how much wider log durations spread than log work, the mean over finished executions."""
    if not data.finished.any():
        return 0.0
    log_durations = np.log(data.seconds.sum(axis=1))
    stretch = log_work - log_durations + (data.members @ log_s)[data.last]
    return float(stretch[data.finished].mean())


def _derivatives(
    u: FloatArray, mu: float, log_sigma: float, finished: np.ndarray[tuple[int], np.dtype[np.bool_]]
) -> _Derivatives:
    from scipy.special import log_ndtr

    sigma = math.exp(log_sigma)
    z = (u - mu) / sigma
    survival = log_ndtr(-z)
    hazard = np.exp(-0.5 * z * z - 0.5 * math.log(2 * math.pi) - survival)
    slope = hazard * (hazard - z)
    tilt = slope * z + hazard

    def either(ended: FloatArray, censored: FloatArray) -> FloatArray:
        return np.where(finished, ended, censored)

    ones = np.ones_like(z)
    return _Derivatives(
        value=either(-0.5 * math.log(2 * math.pi) - log_sigma - 0.5 * z * z - u, survival),
        mu=either(z, hazard) / sigma,
        scale=either(z * z - 1, hazard * z),
        u=either(-z / sigma - 1, -hazard / sigma),
        mu_mu=-either(ones, slope) / sigma**2,
        mu_scale=-either(2 * z, tilt) / sigma,
        scale_scale=-either(2 * z * z, tilt * z),
    )
