"""Improve plans step by step: iterated local search over swaps, relocations and reassignments of units of work.

From a plan, a batch of neighbours is drawn and judged at once; the best replaces the plan if it is no worse than the
plan was, or than the one of some steps before: many plans tie, and others must get worse before they get better (Burke
and Bykov, The late acceptance hill-climbing heuristic, 2017). When that has brought no new best plan for long enough,
the search goes on from the best with some units moved at random (Lourenço, Martin and Stützle, Iterated Local Search,
2003).
"""

from __future__ import annotations

import random
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hrclog.analyzers.search.judge import Judge
from hrclog.analyzers.search.outcome import Ranked, Search
from hrclog.analyzers.search.space import Candidate, Space
from hrclog.planning.random_plans import pick, random_rest
from hrclog.wording import counted

_BATCH: Final = 96
_MEMORY: Final = 20
"""How many steps back the score lies that the next plan must not exceed."""

_PATIENCE: Final = 12
"""Neighbours judged without a new best plan before the search moves elsewhere, per neighbour that there is."""

_ATTEMPTS: Final = 100
"""Random orders to begin with that may come to a standstill."""

_REMEMBERED: Final = 100_000
"""Scores that are kept in mind."""

_KICKS: Final = (2, 3, 4, 6)
"""How many units are moved at random then, in turn."""

_ENOUGH: Final = 60
"""After so many moves elsewhere without a new best plan the search ends."""


@dataclass(frozen=True, slots=True)
class Effort:
    """How long to search: until so many plans were judged, or so much time has passed, whichever is first.

    Only the first gives the same plan on every machine.
    """

    plans: int = 30_000
    seconds: float = float("inf")


def local_search(
    judge: Judge, effort: Effort, seed: int = 0, keep: int = 32, starts: Iterable[Candidate] = ()
) -> Search:
    """Return the best candidates found.

    Args:
        judge: of candidates.
        effort: how long to search.
        seed: of the moves.
        keep: how many candidates to return.
        starts: plans to begin with; random ones are added.
    """
    source = random.Random(f"search:{seed}")  # noqa: S311 - reproducible search, no cryptography
    deadline = time.monotonic() + effort.seconds
    elite = _Elite(judge, keep)
    elite.scores(list(dict.fromkeys([*starts, *_random_starts(judge.space, source)])))
    if not elite.best:
        return Search((), elite.judged, exhaustive=False, stopped="no plan is possible among those tried")
    moves = _moves(judge.space)
    patience = max(_PATIENCE * _neighbours(judge.space) // _BATCH, 8)
    walk = _Walk(elite.best[0])
    top, misses, kicks = elite.best[0], 0, 0
    while elite.judged < effort.plans:
        if time.monotonic() > deadline:
            return elite.search(f"after {effort.seconds:g} s")
        if not moves or kicks > _ENOUGH:
            return elite.search(f"nothing better in {counted(elite.judged, 'plan')}")
        batch = _neighbourhood(walk.at.candidate, moves, source)
        walk.step(min(map(Ranked, elite.scores(batch), batch), default=walk.at))
        misses += 1
        if elite.best[0].score < top.score:
            top, misses, kicks = elite.best[0], 0, 0
        elif misses > patience:
            kicked = _kick(top.candidate, moves, _KICKS[kicks % len(_KICKS)], source)
            walk, misses, kicks = _Walk(Ranked(elite.scores([kicked])[0], kicked)), 0, kicks + 1
    return elite.search(f"after {counted(elite.judged, 'plan')}")


class _Walk:
    """Goes from plan to plan; accepts worse plans that are no worse than the plan of `_MEMORY` steps before."""

    def __init__(self, start: Ranked) -> None:
        self.at = start
        self._before = deque([start.score], _MEMORY)

    def step(self, best: Ranked) -> None:
        """Go to the best neighbour, or stay."""
        if best.score <= max(self.at.score, self._before[0]):
            self.at = best
        self._before.append(min(self.at.score, self._before[0]))


class _Elite:
    """The best candidates so far, and the scores of all that were judged: none is judged twice."""

    def __init__(self, judge: Judge, keep: int) -> None:
        self.best: list[Ranked] = []
        self.judged = 0
        self._judge, self._keep = judge, keep
        self._known: dict[Candidate, float] = {}

    def scores(self, candidates: Sequence[Candidate]) -> list[float]:
        """Return the score of each candidate."""
        unknown = [candidate for candidate in candidates if candidate not in self._known]
        new_scores = dict(zip(unknown, self._judge.scores(unknown).tolist(), strict=True))
        self.judged += len(unknown)
        self._update_best(new_scores)
        scores = [
            new_scores[candidate] if candidate in new_scores else self._known[candidate] for candidate in candidates
        ]
        self._known |= new_scores if len(self._known) < _REMEMBERED else {}
        return scores

    def _update_best(self, scores: Mapping[Candidate, float]) -> None:
        worst = self.best[-1].score if len(self.best) >= self._keep else np.inf
        better = [Ranked(score, candidate) for candidate, score in scores.items() if score < worst]
        if better:
            self.best = sorted({*self.best, *better})[: self._keep]

    def search(self, stopped: str) -> Search:
        """Return what was found."""
        return Search(tuple(self.best), self.judged, exhaustive=False, stopped=stopped)


Move = Callable[[list[list[int]], random.Random], bool]
"""Changes a candidate in place; False if it would stay the same or become impossible."""


def _random_starts(space: Space, source: random.Random, count: int = 32) -> list[Candidate]:
    """Return candidates drawn at random; where agents wait for each other, ones that are possible."""
    return [_random_linked(space, source) if space.linked else _random_free(space, source) for _ in range(count)]


def _random_free(space: Space, source: random.Random) -> Candidate:
    rows: list[list[int]] = [[] for _ in space.agents]
    for unit, count in enumerate(space.counts):
        for _ in range(count):
            rows[space.agents.index(pick(space.units[unit].agents, source))].append(unit)
    return tuple(tuple(_shuffle(row, source)) for row in rows)


def _shuffle(row: list[int], source: random.Random) -> list[int]:
    return [unit for _, unit in sorted((source.random(), unit) for unit in row)]


def _random_linked(space: Space, source: random.Random) -> Candidate:
    units = [unit for unit, count in zip(space.units, space.counts, strict=True) for _ in range(count)]
    for _ in range(_ATTEMPTS):
        orders = random_rest(space.problem, space.begun, units, source)
        if orders is not None:
            rest = {agent: tasks[len(space.begun.get(agent, ())) :] for agent, tasks in orders.items()}
            return space.candidate(rest)
    return _random_free(space, source)


def _moves(space: Space) -> list[Move]:
    """Return the moves that can change something in a space."""
    moves: list[Move] = []
    if len(space.units) > 1 or len(space.agents) > 1:
        moves += [_swap, _relocate]
    if any(len(unit.agents) > 1 for unit in space.units):
        domains = [frozenset(space.agents.index(agent) for agent in unit.agents) for unit in space.units]
        moves += [_reassign(domains), _exchange(domains)]
    return moves


def _neighbours(space: Space) -> int:
    """Return about how many neighbours a candidate has."""
    total = sum(space.counts)
    return total * total


def _neighbourhood(candidate: Candidate, moves: Sequence[Move], source: random.Random) -> list[Candidate]:
    neighbours: dict[Candidate, None] = {}
    for _ in range(2 * _BATCH):
        rows = [list(row) for row in candidate]
        if pick(moves, source)(rows, source):
            neighbours[tuple(map(tuple, rows))] = None
            if len(neighbours) == _BATCH:
                break
    neighbours.pop(candidate, None)
    return list(neighbours)


def _kick(candidate: Candidate, moves: Sequence[Move], count: int, source: random.Random) -> Candidate:
    rows = [list(row) for row in candidate]
    n_changes = sum(pick(moves, source)(rows, source) for _ in range(8 * count) if count)
    return tuple(map(tuple, rows)) if n_changes else candidate


def _place(row: Sequence[object], source: random.Random) -> int:
    return int(source.random() * len(row))


def _swap(rows: list[list[int]], source: random.Random) -> bool:
    row = pick(rows, source)
    if len(row) < 2:
        return False
    a, b = _place(row, source), _place(row, source)
    row[a], row[b] = row[b], row[a]
    return row[a] != row[b]


def _relocate(rows: list[list[int]], source: random.Random) -> bool:
    """Move up to three units that stand side by side elsewhere in the same queue."""
    row = pick(rows, source)
    if len(row) < 2:
        return False
    begin = _place(row, source)
    end = min(begin + 1 + int(source.random() * 3), len(row))
    block, rest = row[begin:end], row[:begin] + row[end:]
    target = int(source.random() * (len(rest) + 1))
    row[:] = rest[:target] + block + rest[target:]
    return target != begin


def _reassign(domains: Sequence[frozenset[int]]) -> Move:
    def move(rows: list[list[int]], source: random.Random) -> bool:
        giver, taker = _place(rows, source), _place(rows, source)
        if giver == taker or not rows[giver]:
            return False
        place = _place(rows[giver], source)
        if taker not in domains[rows[giver][place]]:
            return False
        rows[taker].insert(int(source.random() * (len(rows[taker]) + 1)), rows[giver].pop(place))
        return True

    return move


def _exchange(domains: Sequence[frozenset[int]]) -> Move:
    def move(rows: list[list[int]], source: random.Random) -> bool:
        first_agent, second_agent = _place(rows, source), _place(rows, source)
        if first_agent == second_agent or not rows[first_agent] or not rows[second_agent]:
            return False
        a, b = _place(rows[first_agent], source), _place(rows[second_agent], source)
        first, second = rows[first_agent][a], rows[second_agent][b]
        if first == second or second_agent not in domains[first] or first_agent not in domains[second]:
            return False
        rows[first_agent][a], rows[second_agent][b] = second, first
        return True

    return move
