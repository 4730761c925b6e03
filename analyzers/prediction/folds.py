"""Parts of a set of runs that are held out in turn."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np


def folds(runs: Iterable[str], count: int, seed: int) -> list[list[str]]:
    """Deal runs into folds of nearly equal size, by chance.

    Args:
        runs: ids, in any order.
        count: how many folds; no more than there are runs.
        seed: of the deal.
    """
    ordered = sorted(runs)
    shuffled = np.random.default_rng(seed).permutation(len(ordered))
    parts = [sorted(ordered[index] for index in shuffled[part::count]) for part in range(count)]
    return [part for part in parts if part]
