"""Judge every plan there is."""

from __future__ import annotations

from itertools import islice

import numpy as np

from hrclog.analyzers.planner.judge import Judge
from hrclog.analyzers.planner.outcome import Ranked, Search
from hrclog.analyzers.planner.space import Candidate

_CHUNK = 4096


def judge_all(judge: Judge, keep: int = 32) -> Search:
    """Return the best candidates of all, in order of score and then of how they are written.

    Args:
        judge: of candidates.
        keep: how many to return.
    """
    best: list[Ranked] = []
    count = 0
    candidates = judge.space.candidates()
    while chunk := list(islice(candidates, _CHUNK)):
        scores = judge.scores(chunk)
        count += len(chunk)
        best = ranked([*best, *_best(chunk, scores.tolist(), keep)], keep)
    return Search(tuple(best), count, exhaustive=True)


def _best(chunk: list[Candidate], scores: list[float], keep: int) -> list[Ranked]:
    order = np.argsort(scores, kind="stable")[:keep]
    return [Ranked(scores[index], chunk[index]) for index in order.tolist() if np.isfinite(scores[index])]


def ranked(found: list[Ranked], keep: int) -> list[Ranked]:
    """Return the best, each candidate once."""
    return sorted(set(found))[:keep]
