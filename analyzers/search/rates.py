"""How much others can slow a task down or help it, in terms that are linear in overlaps."""

from __future__ import annotations

import math
from collections.abc import Sequence

from hrclog.arrays import FloatArray
from hrclog.knowledge.task_times import AgentTask


def overlap_weight(keys: Sequence[AgentTask], rate: FloatArray, i: int, j: int) -> float:
    """Return what a second beside key j adds at least to the duration of key i: D_i >= d_i + sum_j weight_ij o_ij.

    Work is the integral of the product of rates r_ij = 1 / s_ij over what runs beside i. With two agents that gives
    1 - r_ij, and equality. With A agents what slows i down counts with 1 / (A - 1), since for rates up to 1
    1 - r_1 r_2 ... >= max (1 - r) >= mean (1 - r); what helps counts with the most that the rest could add to it.

    Args:
        keys: (agent, task) by number.
        rate: of the first key while the second runs, shape (K + 1, K + 1).
        i: whose duration.
        j: beside what.
    """
    weight = 1.0 - float(rate[i, j])
    rest = {agent for agent, _ in keys} - {keys[i][0], keys[j][0]}
    if weight >= 0.0:
        return weight / (1 + len(rest))
    return weight * math.prod(max(_rates(keys, rate, i, agent)) for agent in rest)


def fastest(keys: Sequence[AgentTask], rate: FloatArray, i: int) -> float:
    """Return the highest rate at which key i can be done, whatever runs beside it."""
    return math.prod(max(_rates(keys, rate, i, agent)) for agent in _others(keys, i))


def slowest(keys: Sequence[AgentTask], rate: FloatArray, i: int) -> float:
    """Return the lowest rate at which key i can be done, whatever runs beside it."""
    return math.prod(min(_rates(keys, rate, i, agent)) for agent in _others(keys, i))


def _others(keys: Sequence[AgentTask], i: int) -> list[str]:
    return sorted({agent for agent, _ in keys} - {keys[i][0]})


def _rates(keys: Sequence[AgentTask], rate: FloatArray, i: int, agent: str) -> list[float]:
    """Return the rates of key i beside each task of an agent, and beside none."""
    return [1.0, *(float(rate[i, j]) for j, (name, _) in enumerate(keys) if name == agent)]
