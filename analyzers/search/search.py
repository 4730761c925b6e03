"""Look for good plans in the way that is wanted."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from hrclog.analyzers.search.bound import lower_bound_s
from hrclog.analyzers.search.exhaustive import judge_all
from hrclog.analyzers.search.judge import Judge, Objective
from hrclog.analyzers.search.local_search import local_search
from hrclog.analyzers.search.outcome import Ranked, Search
from hrclog.analyzers.search.reference import best_by_durations, harmful_pairs, random_plan
from hrclog.analyzers.search.space import Space
from hrclog.analyzers.search.wish import Method, Wish
from hrclog.analyzers.search.worlds import Worlds, drawn_worlds, expected_world
from hrclog.knowledge.task_times import TaskTimes

MOST_ENUMERATED: Final = 2_000
"""Plans that `auto` judges one by one; from more it searches."""

WORLDS: Final = 200
"""Runs that a plan is judged by."""

_KEPT: Final = 64  # candidates of a local search that are judged by all worlds
_CPSAT_SECONDS: Final = 60.0


def chosen_method(space: Space, method: Method) -> Method:
    """Return how a plan is looked for, where it is left to choice."""
    if method is not Method.AUTO:
        return method
    return Method.ENUMERATE if space.size(MOST_ENUMERATED) <= MOST_ENUMERATED else Method.LOCAL


def search(space: Space, times: TaskTimes, wish: Wish) -> tuple[Search, float]:
    """Return the best plans found, and a bound of the undisturbed makespan.

    Args:
        space: the plans.
        times: what is known.
        wish: what kind is wanted.

    Raises:
        ScenarioError: nothing is known of a task.
    """
    expected = expected_world(times, space.keys, space.agents, space.longest())
    bound = lower_bound_s(space, expected)
    match chosen_method(space, wish.method):
        case Method.RANDOM:
            return random_plan(space, wish.seed), bound
        case Method.BASELINE:
            return best_by_durations(space, times, MOST_ENUMERATED, wish.effort, wish.seed), bound
        case Method.NOT_NEIGHBORING:
            apart = harmful_pairs(times) if wish.avoid is None else wish.avoid
            return best_by_durations(space, times, MOST_ENUMERATED, wish.effort, wish.seed, apart), bound
        case Method.CPSAT:
            from hrclog.analyzers.search.cpsat import cpsat

            believed = _believed(expected, space, times, wish)
            found = cpsat(space, believed, min(wish.effort.seconds, _CPSAT_SECONDS), wish.seed)
            return found.search, bound if wish.explore else max(bound, found.bound_s)
        case Method.LOCAL:
            believed = _believed(expected, space, times, wish)
            guide = Judge(space, believed, _near(wish.objective), times=times)
            near = local_search(guide, wish.effort, wish.seed, keep=_KEPT)
            return _judged_again(near, Judge(space, _worlds(space, times, wish), wish.objective, times=times)), bound
        case _:
            judge = Judge(space, _worlds(space, times, wish), wish.objective, times=times)
            return judge_all(judge, seconds=wish.effort.seconds), bound


def _near(objective: Objective) -> Objective:
    """Return what is small in the expected world where an objective is small; there are no quantiles in one world."""
    return objective if objective is Objective.CLOSED_FORM else Objective.MEAN


def _believed(expected: Worlds, space: Space, times: TaskTimes, wish: Wish) -> Worlds:
    """Return the one world that a search is guided by: the expected one, in exploration with the factors drawn."""
    return replace(expected, rate=_worlds(space, times, wish).rate[:1]) if wish.explore else expected


def _worlds(space: Space, times: TaskTimes, wish: Wish) -> Worlds:
    worlds = drawn_worlds(times, space.keys, space.agents, space.longest(), WORLDS, wish.seed)
    if wish.explore:
        return replace(worlds, rate=np.broadcast_to(worlds.rate[:1], worlds.rate.shape))
    return worlds


def _judged_again(found: Search, judge: Judge) -> Search:
    candidates = [ranked.candidate for ranked in found.best]
    scores = judge.scores(candidates).tolist()
    return replace(found, best=tuple(sorted(map(Ranked, scores, candidates))))
