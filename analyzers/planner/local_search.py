"""Improve plans step by step: iterated local search over swaps, relocations and reassignments of units of work.

From a plan, a batch of neighbours is drawn and judged at once; the best replaces the plan if it is better. When batches
have brought nothing for long enough, the search goes on from the best plan with some units moved at random (Lourenço,
Martin and Stützle, Iterated Local Search, 2003).
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hrclog.analyzers.planner.judge import Judge
from hrclog.analyzers.planner.outcome import Ranked, Search
from hrclog.analyzers.planner.space import Candidate, Space
from hrclog.random_plans import pick, random_rest

_BATCH: Final = 256
_PATIENCE: Final = 3
"""Batches without a better plan before the search moves elsewhere, per hundred neighbours that there are."""

_ATTEMPTS: Final = 100
"""Random orders to begin with that may come to a standstill."""

_KICKS: Final = (2, 3, 4, 6)
"""How many units are moved at random then, in turn."""


@dataclass(frozen=True, slots=True)
class Effort:
    """How long to search: until so many plans were judged, or so much time has passed, whichever is first.

    Only the first gives the same plan on every machine.
    """

    plans: int = 60_000
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
    elite = _Elite(keep)
    first = list(dict.fromkeys([*starts, *_random_starts(judge.space, source)]))
    judged = elite.add(first, judge.scores(first).tolist())
    if not elite.best:
        return Search((), judged, exhaustive=False, stopped="no plan is possible among those tried")
    moves = _moves(judge.space)
    patience = max(_PATIENCE * _neighbours(judge.space) // _BATCH, 4)
    current, kicks = elite.best[0], 0
    misses = 0
    while moves and judged < effort.plans:
        if time.monotonic() > deadline:
            return Search(tuple(elite.best), judged, exhaustive=False, stopped=f"after {effort.seconds:g} s")
        batch = _neighbourhood(current.candidate, moves, source)
        scores = judge.scores(batch).tolist()
        judged += elite.add(batch, scores)
        best = min(map(Ranked, scores, batch), default=current)
        if best.score < current.score:
            current, misses = best, 0
            continue
        misses += 1
        if misses > patience:
            kicked = _kicked(elite.best[0].candidate, moves, _KICKS[kicks % len(_KICKS)], source)
            score = judge.scores([kicked]).tolist()
            judged += elite.add([kicked], score)
            current, misses, kicks = Ranked(score[0], kicked), 0, kicks + 1
    return Search(tuple(elite.best), judged, exhaustive=False, stopped=f"after {judged:,} plans")


class _Elite:
    """The best candidates so far."""

    def __init__(self, keep: int) -> None:
        self.best: list[Ranked] = []
        self._keep = keep

    def add(self, candidates: Sequence[Candidate], scores: Sequence[float]) -> int:
        """Take in candidates, and return how many there were."""
        worst = self.best[-1].score if len(self.best) >= self._keep else np.inf
        better = [Ranked(s, c) for s, c in zip(scores, candidates, strict=True) if s < worst]
        if better:
            self.best = sorted({*self.best, *better})[: self._keep]
        return len(candidates)


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
    return tuple(tuple(_shuffled(row, source)) for row in rows)


def _shuffled(row: list[int], source: random.Random) -> list[int]:
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
    found: list[Move] = []
    if len(space.units) > 1 or len(space.agents) > 1:
        found += [_swap, _relocate]
    if any(len(unit.agents) > 1 for unit in space.units):
        domains = [frozenset(space.agents.index(agent) for agent in unit.agents) for unit in space.units]
        found += [_reassign(domains), _exchange(domains)]
    return found


def _neighbours(space: Space) -> int:
    """Return about how many neighbours a candidate has."""
    total = sum(space.counts)
    return total * total


def _neighbourhood(candidate: Candidate, moves: Sequence[Move], source: random.Random) -> list[Candidate]:
    found: dict[Candidate, None] = {}
    for _ in range(2 * _BATCH):
        rows = [list(row) for row in candidate]
        if pick(moves, source)(rows, source):
            found[tuple(map(tuple, rows))] = None
            if len(found) == _BATCH:
                break
    found.pop(candidate, None)
    return list(found)


def _kicked(candidate: Candidate, moves: Sequence[Move], count: int, source: random.Random) -> Candidate:
    rows = [list(row) for row in candidate]
    done = sum(pick(moves, source)(rows, source) for _ in range(8 * count) if count)
    return tuple(map(tuple, rows)) if done else candidate


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
        one, other = _place(rows, source), _place(rows, source)
        if one == other or not rows[one] or not rows[other]:
            return False
        a, b = _place(rows[one], source), _place(rows[other], source)
        first, second = rows[one][a], rows[other][b]
        if first == second or other not in domains[first] or one not in domains[second]:
            return False
        rows[one][a], rows[other][b] = second, first
        return True

    return move
