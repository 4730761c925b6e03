"""How the logarithm of an execution's work (seconds at full rate) is distributed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from hrclog.arrays import FloatArray

_LEVELS: Final = (np.arange(99) + 0.5) / 99
_SMALLEST_DEVIATION: Final = 1e-6  # identical durations have no density


class LogWork(Protocol):
    """A distribution of log work; work in seconds."""

    def quantile(self, levels: FloatArray) -> FloatArray:
        """Return quantiles, shape as given; levels within (0, 1)."""

    def log_density(self, values: FloatArray) -> FloatArray:
        """Return the log density at values, shape as given."""

    @property
    def center(self) -> float:
        """Return the mean."""

    @property
    def deviation(self) -> float:
        """Return the standard deviation."""


@dataclass(frozen=True, slots=True)
class NormalLogWork:
    """log W ~ N(center, deviation^2)."""

    center: float
    deviation: float

    def quantile(self, levels: FloatArray) -> FloatArray:
        """Return normal quantiles."""
        from scipy.special import ndtri

        quantiles: FloatArray = self.center + self.deviation * ndtri(levels)
        return quantiles

    def log_density(self, values: FloatArray) -> FloatArray:
        """Return the normal log density."""
        z = (values - self.center) / self.deviation
        return -0.5 * z * z - math.log(self.deviation) - 0.5 * math.log(2 * math.pi)


@dataclass(frozen=True, slots=True)
class SampledLogWork:
    """What was observed is what there is; shape (n,), n >= 1.

    Attributes:
        values: log work, in any order.
        conformal: whether quantiles are those of a new draw, at rank q (n + 1) (Vovk et al. 2005), or of the sample.
    """

    values: FloatArray
    conformal: bool = False

    def quantile(self, levels: FloatArray) -> FloatArray:
        """Return quantiles of the sample, linear between its values."""
        return np.quantile(self.values, levels, method="weibull" if self.conformal else "linear")

    def log_density(self, values: FloatArray) -> FloatArray:
        """Return the log density of the normal with the sample's moments; a sample itself has none."""
        return NormalLogWork(self.center, self.deviation).log_density(values)

    @property
    def center(self) -> float:
        """Return the sample's mean."""
        return float(self.values.mean())

    @property
    def deviation(self) -> float:
        """Return the sample's standard deviation."""
        return max(float(self.values.std(ddof=1 if len(self.values) > 1 else 0)), _SMALLEST_DEVIATION)


@dataclass(frozen=True, slots=True)
class StudentLogWork:
    """log W = center + scale t with `freedom` degrees of freedom."""

    center: float
    scale: float
    freedom: float

    def quantile(self, levels: FloatArray) -> FloatArray:
        """Return Student quantiles."""
        from scipy.special import stdtrit

        quantiles: FloatArray = self.center + self.scale * stdtrit(self.freedom, levels)
        return quantiles

    def log_density(self, values: FloatArray) -> FloatArray:
        """Return the Student log density."""
        nu, z = self.freedom, (values - self.center) / self.scale
        constant = math.lgamma((nu + 1) / 2) - math.lgamma(nu / 2) - 0.5 * math.log(nu * math.pi)
        return constant - math.log(self.scale) - (nu + 1) / 2 * np.log1p(z * z / nu)

    def half_width(self, share: float) -> float:
        """Return half the width of the central interval that holds a share of the distribution."""
        return float(self.quantile(np.array([0.5 + share / 2]))[0]) - self.center

    @property
    def deviation(self) -> float:
        """Return half the central 68.27 %: every Student distribution has it, and a normal one's is its deviation."""
        return self.half_width(0.6826894921370859)


def expected_work_s(work: LogWork) -> float:
    """Return the mean of W over the central 99 % of its distribution; a Student's log work has no mean work."""
    return float(np.exp(work.quantile(_LEVELS)).mean())


def widened(work: LogWork, deviation: float) -> LogWork:
    """Return the distribution with an independent normal deviation of its centre added.

    Args:
        work: the distribution.
        deviation: of the logarithm; 0 changes nothing.
    """
    if deviation == 0:
        return work
    if isinstance(work, SampledLogWork):
        shifts = NormalLogWork(0.0, deviation).quantile(_LEVELS)
        return SampledLogWork((work.values[:, None] + shifts).ravel(), work.conformal)
    return NormalLogWork(work.center, math.hypot(work.deviation, deviation))
