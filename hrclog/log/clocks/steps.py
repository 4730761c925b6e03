"""Steps of a clock within a run: from one event on, an agent's times are ahead of log times by another amount.

A delay makes single events look as if the clock were behind, never ahead. So what counts is the least delayed of a few
batches before a place, and of a few behind it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from hrclog.arrays import BoolArray, IntArray
from hrclog.log.clocks.series import FEW, FEW_NS, LEAST_NS, Series
from hrclog.units import NS_PER_S

_WINDOW: Final = 3  # batches
_NOISES: Final = 6.0
_LONGEST_DELAY_NS: Final = 60 * NS_PER_S  # of a single event at either end


@dataclass(frozen=True, slots=True)
class Step:
    """A step of an agent's clock; positive if the clock was put forward."""

    size_ns: int
    seq_before: int
    seq_after: int
    within_execution: bool


def threshold_ns(series: Sequence[Series]) -> float:
    """Return from which size on a change is no delay, by the typical change from batch to batch."""
    changes = np.abs(np.concatenate([np.empty(0, np.int64), *(np.diff(one.ahead_ns) for one in series)]))
    return max(LEAST_NS, _NOISES * float(np.quantile(changes, 0.6, method="lower"))) if len(changes) else LEAST_NS


def own_threshold_ns(series: Series, threshold: float) -> float:
    """Return the same for one clock, as its agent's delays may vary more than those of others.

    Args:
        series: of the agent.
        threshold: of the run.
    """
    return max(threshold, threshold_ns([series]) if len(series.ahead_ns) > FEW else FEW_NS)


def steps(series: Series, threshold: float, reference_ns: float) -> list[Step]:
    """Return the steps of one clock.

    Args:
        series: of the agent.
        threshold: smallest size of a step, ns.
        reference_ns: by how much times of the run's other agents are ahead.
    """
    ahead = series.ahead_ns
    change = _highest(ahead, behind=True)[1:] - _highest(ahead, behind=False)[:-1]  # at each place between two batches
    is_step = np.abs(change) > threshold
    if not is_step.any():
        return []
    may_be_delay = _single_at_an_end(change) & (np.abs(change) < _LONGEST_DELAY_NS)
    may_be_delay[0] &= abs(ahead[0] - reference_ns) > threshold / 2
    is_step &= ~may_be_delay
    return [_step(series, place, int(change[place])) for place in _places(is_step, change, np.diff(ahead))]


def _highest(ahead: IntArray, *, behind: bool) -> IntArray:
    """Return the largest of each value and the few behind it, or before it; shape of `ahead`."""
    highest = ahead.copy()
    for distance in range(1, min(_WINDOW, len(ahead))):
        if behind:
            highest[:-distance] = np.maximum(highest[:-distance], ahead[distance:])
        else:
            highest[distance:] = np.maximum(highest[distance:], ahead[:-distance])
    return highest


def _single_at_an_end(change: IntArray) -> BoolArray:
    """Return which changes tell no more than that the first or the last batch is lower than the others."""
    single = np.zeros(len(change), np.bool_)
    single[0] = change[0] > 0
    single[-1] |= change[-1] < 0
    return single


def _places(is_step: BoolArray, change: IntArray, differences: IntArray) -> list[int]:
    """Return where the clock stepped: of places side by side that show the same step, the one where it is largest."""
    places: list[int] = []
    direction = np.where(is_step, np.sign(change), 0)
    bounds = [*np.flatnonzero(np.diff(direction, prepend=0)).tolist(), len(direction)]
    for begin, end in pairwise(bounds):
        if direction[begin]:
            places.append(begin + int(np.argmax(differences[begin:end] * direction[begin])))
    return places


def _step(series: Series, place: int, size_ns: int) -> Step:
    last, first = int(series.last[place]), int(series.first[place + 1])
    execution_id = series.execution_ids[last]
    return Step(
        size_ns,
        int(series.seq[last]),
        int(series.seq[first]),
        bool(execution_id) and execution_id == series.execution_ids[first],
    )
