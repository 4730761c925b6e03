"""Random numbers that are the same on every Python version: one independent stream per purpose."""

from __future__ import annotations

import math
import random
from statistics import NormalDist

_STANDARD_NORMAL = NormalDist()
_TINY = 2.0**-53


class Stream:
    """A stream of random numbers, told apart from all others by what it is for.

    Only `random()` and `getrandbits()` of the Mersenne Twister are used, whose numbers do not change between versions.

    Args:
        seed: of the campaign.
        purpose: what the numbers are for (run, agent, ...), outermost first.
    """

    def __init__(self, seed: int, *purpose: str | int) -> None:
        self.source = random.Random("/".join(map(str, (seed, *purpose))))  # noqa: S311 - reproducible simulation

    def uniform(self) -> float:
        """Return a number from [0, 1)."""
        return self.source.random()

    def lognormal(self, mu: float, sigma: float) -> float:
        """Return exp(mu + sigma z) with z standard normal; mu and sigma of the logarithm."""
        return math.exp(mu + sigma * _STANDARD_NORMAL.inv_cdf(max(self.source.random(), _TINY)))

    def bits(self, count: int) -> int:
        """Return an integer of `count` random bits."""
        return self.source.getrandbits(count)
