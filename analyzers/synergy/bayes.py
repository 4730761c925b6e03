"""The follow-up's Bayesian regression, deterministically: `bayes`.

    y ~ N(X s, sigma^2),   s_j ~ LogNormal(0, 0.5^2) independently,   sigma ~ Uniform(0, 2) seconds

with the y and X of `concurrent_shares`. sigma is integrated out in closed form,

    p(s | y) ~ prior(s) SS(s)^(-a) Gamma(a, SS(s) / 8),   a = (n - 1) / 2,   SS = |y - X s|^2,

and the moments of s come from importance sampling on scrambled Sobol points with a Student proposal adapted to them.
Sandrini, Faroni, Pedrocchi, Learning and planning for optimal synergistic human-robot coordination in manufacturing
contexts (RCIM 95, 2025).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from hrclog.analyzers.synergy.estimator import Estimator
from hrclog.analyzers.synergy.fit import Covariance, Fit
from hrclog.analyzers.synergy.observations import Observations
from hrclog.analyzers.synergy.outlier_methods import Outliers
from hrclog.analyzers.synergy.pairs import synergy_table
from hrclog.analyzers.synergy.regression import Regression, concurrent_shares
from hrclog.analyzers.synergy.sampled_models import sampled_models
from hrclog.arrays import FloatArray

PRIOR_DEVIATION: Final = 0.5
"""Of log s."""

LARGEST_SIGMA_S: Final = 2.0

LEAST_LEARNT: Final = 0.7
"""A factor whose posterior deviation (of log s) is more than this part of its prior's was hardly learnt."""

_RESOLUTION_S: Final = 1e-4  # residuals smaller than this are no evidence; durations may be identical
_FREEDOM: Final = 5.0  # of the proposal; tails heavier than the posterior's
_POINTS: Final = 12  # log2 of the number while adapting
_FINAL_POINTS: Final = 15
_MOST_ROUNDS: Final = 12
_EFFICIENT: Final = 0.5  # share of the sample that counts, beyond which a proposal is good enough
_DOUBTFUL: Final = 0.2  # with less, many more points are drawn
_DOUBTFUL_POINTS: Final = 18
_LEAST_EFFICIENT: Final = 0.05  # with less the moments are too rough to be told
_SEED: Final = 0
_NOT_KNOWN: Final = (math.nan,) * 4


@dataclass(frozen=True, slots=True)
class Posterior:
    """Moments of s; shapes (p,), the covariance (p, p).

    Attributes:
        mean: posterior mean.
        low: 2.5 % quantile.
        high: 97.5 % quantile.
        covariance: of s.
        log_deviation: posterior standard deviation of log s.
        efficiency: effective share of the sample; a small one says that the moments are rough.
    """

    mean: FloatArray
    low: FloatArray
    high: FloatArray
    covariance: FloatArray
    log_deviation: FloatArray
    efficiency: float


@dataclass(frozen=True, slots=True)
class _Problem:
    """SS(s) = least + |R (s - best)|^2."""

    root: FloatArray
    best: FloatArray
    least: float
    shape: float  # a

    def log_density(self, log_s: FloatArray) -> FloatArray:
        """Return the log posterior of log s, shape (m,) for (m, p)."""
        squares = self._squares(log_s)
        prior = -0.5 * (log_s**2).sum(axis=1) / PRIOR_DEVIATION**2
        density: FloatArray = prior - self.shape * np.log(squares) + log_upper_gamma(self.shape, squares / 8)
        return density

    def precision(self, log_s: FloatArray) -> float:
        """Return the expected 1 / sigma^2 at a point, shape (p,): minus twice the slope of the log likelihood by SS."""
        squares = self._squares(log_s[None])
        x = squares / (2 * LARGEST_SIGMA_S**2)
        slope = self.shape / squares + np.exp((self.shape - 1) * np.log(x) - x - log_upper_gamma(self.shape, x)) / 8
        return float(2 * slope[0])

    def gradient(self, log_s: FloatArray) -> FloatArray:
        """Return the gradient of the log posterior at a point, shape (p,)."""
        s = np.exp(log_s)
        pull: FloatArray = self.precision(log_s) * s * (self.root.T @ (self.root @ (s - self.best)))
        return -pull - log_s / PRIOR_DEVIATION**2

    def _squares(self, log_s: FloatArray) -> FloatArray:
        squares: FloatArray = self.least + (((np.exp(log_s) - self.best) @ self.root.T) ** 2).sum(axis=1)
        return squares


def bayes(observations: Observations, outliers: Outliers = "none") -> Fit:
    """Estimate synergies as the follow-up does; the same data always give the same numbers.

    Args:
        observations: what to learn from; executions that did not succeed are company only.
        outliers: which rows of each regression to leave out.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, "blas"):
        solutions = [
            (regression, posterior(regression.x, regression.y))
            for regression in concurrent_shares(observations, outliers)
        ]
    rows = [row for regression, result in solutions for row in _rows(regression, result)]
    table = synergy_table(observations.executions, observations.meetings, rows, "bayes")
    covariances = tuple(
        Covariance(regression.keys, result.covariance if is_known(result) else np.full_like(result.covariance, np.nan))
        for regression, result in solutions
    )
    return Fit(table, sampled_models(observations, table), covariances)


def is_known(result: Posterior) -> bool:
    """Return whether enough of the sample counts for its moments to be told."""
    return result.efficiency >= _LEAST_EFFICIENT


def posterior(x: FloatArray, y: FloatArray) -> Posterior:
    """Return the posterior of s.

    Args:
        x: shape (n, p).
        y: seconds, shape (n,).
    """
    problem = _problem(x, y)
    center, covariance = _mode(problem)
    for _ in range(_MOST_ROUNDS):
        log_s, weights = _sample(problem, center, covariance, _POINTS)
        efficiency = 1 / float((weights**2).sum() * len(weights))
        center = weights @ log_s
        covariance = _covariance(log_s, weights, center) + 1e-12 * np.eye(len(center))
        if efficiency > _EFFICIENT:
            break
    points = _FINAL_POINTS if efficiency > _DOUBTFUL else _DOUBTFUL_POINTS
    log_s, weights = _sample(problem, center, covariance, points)
    s = np.exp(log_s)
    mean = weights @ s
    low, high = _quantiles(s, weights, (0.025, 0.975))
    efficiency = 1 / float((weights**2).sum() * len(weights))
    deviation = np.sqrt(weights @ (log_s - weights @ log_s) ** 2)
    return Posterior(mean, low, high, _covariance(s, weights, mean), deviation, efficiency)


def log_upper_gamma(shape: float, x: FloatArray) -> FloatArray:
    """Return log Gamma(a, x), the upper incomplete gamma function, also where it underflows.

    Args:
        shape: a >= 0.
        x: positive, shape as given.
    """
    from scipy.special import exp1, gammaincc, gammaln

    with np.errstate(divide="ignore"):
        result: FloatArray = np.log(exp1(x)) if shape == 0 else np.log(gammaincc(shape, x)) + gammaln(shape)
    tiny = result - (gammaln(shape) if shape else 0.0) < -600
    if tiny.any():
        result[tiny] = _by_fraction(shape, x[tiny])
    return result


def _by_fraction(shape: float, x: FloatArray) -> FloatArray:
    """Evaluate Legendre's continued fraction by Lentz's method; it converges fast for x well above a."""
    b = x + 1 - shape
    c = np.full_like(x, 1e300)
    d = 1 / b
    h = d.copy()
    for i in range(1, 500):
        a = -i * (i - shape)
        b = b + 2
        d = 1 / (a * d + b)
        c = b + a / c
        h *= c * d
        if np.all(np.abs(c * d - 1) < 1e-14):
            break
    result: FloatArray = np.log(h) - x + shape * np.log(x)
    return result


def _problem(x: FloatArray, y: FloatArray) -> _Problem:
    best: FloatArray = np.linalg.lstsq(x, y, rcond=1e-10)[0].astype(np.float64)
    root = np.linalg.qr(x, mode="r")
    residual = y - x @ best
    least = float(residual @ residual) + len(y) * _RESOLUTION_S**2
    return _Problem(np.asarray(root, np.float64), best, least, (len(y) - 1) / 2)


def _mode(problem: _Problem) -> tuple[FloatArray, FloatArray]:
    """Return where log s is likeliest, and a covariance there."""
    from scipy.optimize import minimize

    optimum = minimize(
        lambda t: -float(problem.log_density(t[None])[0]),
        np.zeros(len(problem.best)),
        jac=lambda t: -problem.gradient(t),
        method="L-BFGS-B",
        bounds=[(-4.0, 4.0)] * len(problem.best),
    )
    scaled = problem.root * np.exp(optimum.x)
    information = problem.precision(optimum.x) * (scaled.T @ scaled) + np.eye(len(optimum.x)) / PRIOR_DEVIATION**2
    return optimum.x, np.linalg.inv(information)


def _sample(
    problem: _Problem, center: FloatArray, covariance: FloatArray, log2_points: int
) -> tuple[FloatArray, FloatArray]:
    """Return points of log s (m, p) and their weights (m,), which sum to 1."""
    from scipy.special import gammaincinv, ndtri
    from scipy.stats.qmc import Sobol

    p = len(center)
    uniform = Sobol(p + 1, scramble=True, rng=np.random.default_rng(_SEED)).random_base2(log2_points)
    uniform = np.clip(uniform, 1e-12, 1 - 1e-12)
    chi2 = 2 * gammaincinv(_FREEDOM / 2, uniform[:, -1])
    z = ndtri(uniform[:, :-1]) * np.sqrt(_FREEDOM / chi2)[:, None]
    log_s = center + z @ _root(covariance)
    proposal = -(_FREEDOM + p) / 2 * np.log1p((z**2).sum(axis=1) / _FREEDOM)
    log_weight = problem.log_density(log_s) - proposal
    weight = np.exp(log_weight - log_weight.max())
    return log_s, weight / weight.sum()


def _root(covariance: FloatArray) -> FloatArray:
    """Return the symmetric root of a covariance, which rounding may have made indefinite."""
    values, vectors = np.linalg.eigh(covariance)
    result: FloatArray = (vectors * np.sqrt(values.clip(1e-12 * values.max()))) @ vectors.T
    return result


def _covariance(values: FloatArray, weights: FloatArray, center: FloatArray) -> FloatArray:
    deviations = values - center
    result: FloatArray = (deviations.T * weights) @ deviations
    return result


def _quantiles(values: FloatArray, weights: FloatArray, levels: tuple[float, ...]) -> FloatArray:
    """Return weighted quantiles, shape (levels, p)."""
    quantiles = []
    for column in values.T:
        order = np.argsort(column, kind="stable")
        cumulated = np.cumsum(weights[order]) - weights[order] / 2
        quantiles.append(np.interp(levels, cumulated, column[order]))
    return np.array(quantiles).T


def _rows(regression: Regression, result: Posterior) -> Iterator[tuple[Any, ...]]:
    std_err = np.sqrt(np.diag(result.covariance))
    numbers = np.stack([result.mean, std_err, result.low, result.high], axis=1).tolist()
    known = is_known(result)
    clear = (result.low > 1) | (result.high < 1)  # however uncertain its size
    learnt = (known & (clear | (result.log_deviation < LEAST_LEARNT * PRIOR_DEVIATION))).tolist()
    for key, values, identified in zip(regression.keys, numbers, learnt, strict=True):
        yield (*key, *(values if known else _NOT_KNOWN), *_NOT_KNOWN, identified)


class Bayes(Estimator):
    """The follow-up's regression."""

    name = "bayes"
    summary = "Bayesian regression of the follow-up (Sandrini, Faroni, Pedrocchi 2025)"
    assumes = (
        "the Bayesian regression of Sandrini, Faroni and Pedrocchi (RCIM 2025). It takes the share of a task's work "
        "that is done beside another for the share of its time, so strong factors come out about a third too small."
    )
    version = 2
    caution = "By bayes strong factors come out about a third too small."

    def fit(self, observations: Observations, outliers: Outliers = "none") -> Fit:
        """Estimate synergies as the follow-up does."""
        return bayes(observations, outliers)
