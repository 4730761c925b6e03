"""Steps of a clock within a run: from one event on, an agent's times are ahead of log times by another amount."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from hrclog.log.clock_series import LEAST_NS, Series

_NOISES: Final = 20.0  # quartiles of the changes from batch to batch: nine standard deviations of normal noise


@dataclass(frozen=True, slots=True)
class Step:
    """A step of an agent's clock; positive if the clock was put forward."""

    size_ns: int
    seq_before: int
    seq_after: int
    within_execution: bool


@dataclass(frozen=True, slots=True)
class _Piece:
    """Batches between two changes: indices, one past the last, and the level."""

    begin: int
    end: int
    level_ns: float


def threshold_ns(series: Sequence[Series]) -> float:
    """Return from which size on a change is no delay; a quarter of all changes suffices to know the delays."""
    changes = np.abs(np.concatenate([np.empty(0, np.int64), *(np.diff(one.ahead_ns) for one in series)]))
    return max(LEAST_NS, _NOISES * float(np.quantile(changes, 0.25, method="lower"))) if len(changes) else LEAST_NS


def steps(series: Series, threshold: float, reference_ns: float) -> list[Step]:
    """Return the steps of one clock.

    Args:
        series: of the agent.
        threshold: smallest size of a step, ns.
        reference_ns: by how much times of the run's other agents are ahead.
    """
    pieces = _pieces(series, threshold)
    lasting = [
        piece for index, piece in enumerate(pieces) if not _is_late(pieces, index, series, threshold, reference_ns)
    ]
    return [
        _step(series, before, after)
        for before, after in pairwise(lasting)
        if abs(after.level_ns - before.level_ns) > threshold
    ]


def _pieces(series: Series, threshold: float) -> list[_Piece]:
    cuts = np.flatnonzero(np.abs(np.diff(series.ahead_ns)) > threshold) + 1
    bounds = [0, *cuts.tolist(), len(series.ahead_ns)]
    return [_Piece(begin, end, float(np.median(series.ahead_ns[begin:end]))) for begin, end in pairwise(bounds)]


def _is_late(pieces: Sequence[_Piece], index: int, series: Series, threshold: float, reference_ns: float) -> bool:
    """Return whether a single batch was written late, rather than timed by a clock that is behind."""
    piece = pieces[index]
    neighbours = [*pieces[max(index - 1, 0) : index], *pieces[index + 1 : index + 2]]
    if piece.end - piece.begin > 1 or not neighbours or abs(piece.level_ns - reference_ns) <= threshold:
        return False
    if len(neighbours) == 1 and neighbours[0].end - neighbours[0].begin == 1:
        return False
    is_last = index == len(pieces) - 1
    if is_last and series.time_ns[piece.begin] < series.time_ns[piece.begin - 1]:
        return False  # delays do not turn times back
    return all(piece.level_ns < neighbour.level_ns for neighbour in neighbours)


def _step(series: Series, before: _Piece, after: _Piece) -> Step:
    last, first = int(series.last[before.end - 1]), int(series.first[after.begin])
    execution_id = series.execution_ids[last]
    return Step(
        round(after.level_ns - before.level_ns),
        int(series.seq[last]),
        int(series.seq[first]),
        bool(execution_id) and execution_id == series.execution_ids[first],
    )
