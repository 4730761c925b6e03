"""Judge every plan there is."""

from __future__ import annotations

import math
import time
from itertools import islice
from typing import Final

import numpy as np

from hrclog.analyzers.search.judge import Judge
from hrclog.analyzers.search.outcome import Ranked, Search
from hrclog.analyzers.search.space import Candidate
from hrclog.errors import ScenarioError

MOST_LISTED: Final = 1_000_000
"""Plans that can be judged one by one: in an hour or so."""

_CHUNK: Final = 256


def judge_all(judge: Judge, keep: int = 32, seconds: float = math.inf) -> Search:
    """Return the best candidates of all, in order of score and then of how they are written.

    Args:
        judge: of candidates.
        keep: how many to return.
        seconds: after which to stop; what was not judged then is unknown.

    Raises:
        ScenarioError: there are too many to be listed.
    """
    if judge.space.size(MOST_LISTED) > MOST_LISTED:
        raise ScenarioError(f"there are more than {MOST_LISTED:,} plans, too many to judge them all; search locally")
    deadline = time.monotonic() + seconds
    best: list[Ranked] = []
    count = 0
    candidates = judge.space.candidates()
    while chunk := list(islice(candidates, _CHUNK)):
        scores = judge.scores(chunk)
        count += len(chunk)
        best = ranked([*best, *_best_of_chunk(chunk, scores.tolist(), keep)], keep)
        if time.monotonic() > deadline:
            return Search(tuple(best), count, exhaustive=False, stopped=f"after {seconds:g} s")
    return Search(tuple(best), count, exhaustive=True)


def _best_of_chunk(chunk: list[Candidate], scores: list[float], keep: int) -> list[Ranked]:
    order = np.argsort(scores, kind="stable")[:keep]
    return [Ranked(scores[index], chunk[index]) for index in order.tolist() if np.isfinite(scores[index])]


def ranked(found: list[Ranked], keep: int) -> list[Ranked]:
    """Return the best, each candidate once."""
    return sorted(set(found))[:keep]
