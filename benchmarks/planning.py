"""How good plans of large problems are, and how fast: 48 pick-place pairs, 16 of each agent's own and 16 for either.

python benchmarks/planning.py [--seconds 10] [--problems 5] [--cpsat]

Synergies are drawn log-uniformly from 0.5 to 6, work uniformly from 2 to 8 s. Everything is as expected (no noise), so
that the bound by linear programming is one of the same thing.
"""

from __future__ import annotations

import argparse
import math
import random
import time
from dataclasses import replace

import numpy as np

from hrclog.analyzers.search.bound import lower_bound_s
from hrclog.analyzers.search.cpsat import cpsat
from hrclog.analyzers.search.judge import Judge
from hrclog.analyzers.search.local_search import Effort, local_search
from hrclog.analyzers.search.space import Space, space_of
from hrclog.analyzers.search.worlds import Worlds
from hrclog.planning.problem import Count, Problem
from hrclog.planning.random_plans import random_orders
from hrclog.sim.scenario import load_scenario

PAIRS = 16
GAPS_S = (0.5, 0.3)
RANDOM = 200


def main() -> None:
    """Print a line per problem."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--problems", type=int, default=5)
    parser.add_argument("--cpsat", action="store_true", help="let CP-SAT try too")
    given = parser.parse_args()
    print(
        "| problem | random mean s | found s | shorter | bound s | gap | plans judged | took s |" + " CP-SAT s, bound |"
    )
    print("| --- |" + " --- |" * 8)
    for seed in range(given.problems):
        print(line(seed, given.seconds, use_cpsat=given.cpsat), flush=True)


def line(seed: int, seconds: float, *, use_cpsat: bool) -> str:
    """Return what came of one problem as a row of a table."""
    space = space_of(pairs())
    world = drawn_world(space, seed)
    judge = Judge(space, world)
    source = random.Random(seed)  # noqa: S311 - a reproducible benchmark, no cryptography
    usual = judge.scores([space.candidate(random_orders(space.problem, source)) for _ in range(RANDOM)]).mean()
    begun = time.perf_counter()
    found = local_search(judge, Effort(seconds=seconds), seed)
    took, score, bound = time.perf_counter() - begun, found.best[0].score, lower_bound_s(space, world)
    other = ""
    if use_cpsat:
        solved = cpsat(space, world, seconds, seed)
        other = f"{solved.search.best[0].score:.1f}, {solved.bound_s:.1f}"
    figures = f"{usual:.1f} | {score:.1f} | {1 - score / usual:.1%} | {bound:.1f} | {score / bound - 1:.1%}"
    return f"| {seed} | {figures} | {found.judged:,} | {took:.1f} | {other} |"


def pairs() -> Problem:
    """Return the paper's tasks, with more boxes and blue ones for either agent."""
    paper = load_scenario("paper").problem
    counts = tuple(
        Count(f"{kind}_{color}_box", PAIRS) for color in ("white", "blue", "orange") for kind in ("pick", "place")
    )
    return replace(paper, tasks=tuple(replace(task, targets=()) for task in paper.tasks), counts=counts)


def drawn_world(space: Space, seed: int) -> Worlds:
    """Return a world with work and synergies drawn at random."""
    source, size, keys = np.random.default_rng(seed), space.longest(), space.keys
    rate = np.ones((1, len(keys) + 1, len(keys) + 1))
    for i, (agent, _) in enumerate(keys):
        for j, (other, _) in enumerate(keys):
            if agent != other:
                rate[0, i, j] = 1.0 / math.exp(source.uniform(math.log(0.5), math.log(6.0)))
    work = source.uniform(2.0, 8.0, len(keys))
    return Worlds(
        np.broadcast_to(work[None, :, None], (1, len(keys), size)),
        rate,
        np.broadcast_to(np.array(GAPS_S)[None, :, None], (1, len(space.agents), size)),
    )


if __name__ == "__main__":
    main()
