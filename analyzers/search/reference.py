"""Plans to compare with: drawn at random, by mean durations alone, and with harmful pairs kept apart."""

from __future__ import annotations

import math
import random
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from hrclog.analyzers.search.exhaustive import judge_all
from hrclog.analyzers.search.judge import Judge
from hrclog.analyzers.search.local_search import Effort, local_search
from hrclog.analyzers.search.mean_durations import by_mean_durations
from hrclog.analyzers.search.outcome import Ranked, Search
from hrclog.analyzers.search.space import Space
from hrclog.analyzers.search.worlds import expected_world
from hrclog.arrays import FloatArray
from hrclog.knowledge.task_times import AgentTask, TaskTimes
from hrclog.planning.random_plans import pick, random_plans

Pairs = Iterable[tuple[AgentTask, AgentTask]]

_TIE: Final = 1e-11  # of a score; what rounding makes of equal ones
_TIES_KEPT: Final = 256  # of a local search
_HARM: Final = 1.645  # deviations that a log factor must be above 0: one in twenty by chance
_FORBIDDEN: Final = 1e5  # what a second side by side of tasks that must be apart counts beside one of makespan


def random_plan(space: Space, seed: int) -> Search:
    """Return any plan, drawn by the seed."""
    plan = next(random_plans(space.problem, seed), None)
    if plan is None:
        return Search((), 0, exhaustive=False)
    return Search((Ranked(math.nan, space.candidate(plan.orders())),), 1, exhaustive=False)


def best_by_durations(
    space: Space, times: TaskTimes, most: int, effort: Effort, seed: int, apart: Pairs = ()
) -> Search:
    """Return the plans that are best by mean durations alone, in an order drawn by the seed.

    Args:
        space: the plans.
        times: what is known.
        most: spaces up to this size are judged as a whole.
        effort: how long to search in larger ones.
        seed: of the order.
        apart: pairs that run side by side as little as possible, before anything else.
    """
    keys = space.keys
    worlds = expected_world(by_mean_durations(times), keys, space.agents, space.longest(), synergies=False)
    judge = Judge(space, worlds, cost=_costs(keys, apart), cost_weight=_FORBIDDEN)
    enumerable = space.size(most) <= most
    result = judge_all(judge, keep=most) if enumerable else local_search(judge, effort, seed, keep=_TIES_KEPT)
    ties = [ranked for ranked in result.best if ranked.score <= result.best[0].score * (1 + _TIE)]
    source = random.Random(f"ties:{seed}")  # noqa: S311 - reproducible planning, no cryptography
    chosen = [pick(ties, source)] if ties else []
    return replace(result, best=(*chosen, *(ranked for ranked in ties if ranked not in chosen)))


def harmful_pairs(times: TaskTimes) -> tuple[tuple[AgentTask, AgentTask], ...]:
    """Return the pairs of which one task makes the other longer, beyond what chance would show one time in twenty."""
    pairs = []
    for key, time in times.times.items():
        for place, factor in enumerate(time.factors):
            variance = 0.0 if time.covariance is None else float(time.covariance[2 + place, 2 + place])
            if factor.log_s > _HARM * math.sqrt(max(variance, 0.0)):
                pairs.append((key, (factor.other_agent, factor.other_task)))
    return tuple(sorted(pairs))


def _costs(keys: Sequence[AgentTask], pairs: Pairs) -> FloatArray | None:
    cost = np.zeros((len(keys) + 1, len(keys) + 1))
    for key, other in pairs:
        if key in keys and other in keys:
            i, j = keys.index(key), keys.index(other)
            cost[i, j] = cost[j, i] = 1.0
    return cost if cost.any() else None
