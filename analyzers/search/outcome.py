"""What a search for plans comes back with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from hrclog.analyzers.search.space import Candidate


class Ranked(NamedTuple):
    """A candidate and its score; sorted by score, ties by candidate."""

    score: float
    candidate: Candidate


@dataclass(frozen=True, slots=True)
class Search:
    """The best candidates that a search found, best first, none if none is possible.

    Attributes:
        best: candidates with their scores.
        judged: how many candidates were judged.
        exhaustive: whether that was all there are.
        stopped: why it ended, "" if it came to its end.
    """

    best: tuple[Ranked, ...]
    judged: int
    exhaustive: bool
    stopped: str = ""
