"""Lognormal times: never negative, and sometimes long."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Lognormal:
    """A lognormal time: median in seconds and standard deviation of its logarithm."""

    median_s: float
    sigma: float

    @property
    def mu(self) -> float:
        """Mean of the logarithm of the seconds."""
        return math.log(self.median_s)

    @property
    def mean_s(self) -> float:
        """Mean in seconds."""
        return self.median_s * math.exp(self.sigma**2 / 2)
