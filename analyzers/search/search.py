"""Look for good plans in the way that is wanted."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
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
    quest = Quest(space, times, wish, expected, lower_bound_s(space, expected))
    return SEARCHES[chosen_method(space, wish.method)](quest)


@dataclass(frozen=True, slots=True)
class Quest:
    """What a search is asked for.

    Attributes:
        space: the plans.
        times: what is known.
        wish: what kind is wanted.
        expected: the world where everything is as expected.
        bound_s: of the undisturbed makespan.
    """

    space: Space
    times: TaskTimes
    wish: Wish
    expected: Worlds
    bound_s: float


def any_plan(quest: Quest) -> tuple[Search, float]:
    """Draw a plan."""
    return random_plan(quest.space, quest.wish.seed), quest.bound_s


def baseline(quest: Quest) -> tuple[Search, float]:
    """Find the least makespan by mean durations."""
    wish = quest.wish
    return best_by_durations(quest.space, quest.times, MOST_ENUMERATED, wish.effort, wish.seed), quest.bound_s


def not_neighboring(quest: Quest) -> tuple[Search, float]:
    """Find the least makespan by mean durations among plans that keep harmful pairs apart."""
    wish = quest.wish
    apart = harmful_pairs(quest.times) if wish.avoid is None else wish.avoid
    return best_by_durations(quest.space, quest.times, MOST_ENUMERATED, wish.effort, wish.seed, apart), quest.bound_s


def solved(quest: Quest) -> tuple[Search, float]:
    """Solve the expected world by constraint programming."""
    from hrclog.analyzers.search.cpsat import cpsat

    wish = quest.wish
    solution = cpsat(quest.space, _guiding_world(quest), min(wish.effort.seconds, _CPSAT_SECONDS), wish.seed)
    return solution.search, quest.bound_s if wish.explore else max(quest.bound_s, solution.bound_s)


def searched(quest: Quest) -> tuple[Search, float]:
    """Search the expected world locally, and judge the best plans by all worlds."""
    wish = quest.wish
    guide = Judge(quest.space, _guiding_world(quest), _one_world_objective(wish.objective), times=quest.times)
    return _rejudge(local_search(guide, wish.effort, wish.seed, keep=_KEPT), _make_judge(quest)), quest.bound_s


def enumerated(quest: Quest) -> tuple[Search, float]:
    """Judge all plans by all worlds."""
    return judge_all(_make_judge(quest), seconds=quest.wish.effort.seconds), quest.bound_s


def _make_judge(quest: Quest) -> Judge:
    return Judge(quest.space, _draw_worlds(quest), quest.wish.objective, times=quest.times)


def _one_world_objective(objective: Objective) -> Objective:
    """Return what is small in the expected world where an objective is small; there are no quantiles in one world."""
    return objective if objective is Objective.CLOSED_FORM else Objective.MEAN


def _guiding_world(quest: Quest) -> Worlds:
    """Return the one world that a search is guided by: the expected one, in exploration with the factors drawn."""
    return replace(quest.expected, rate=_draw_worlds(quest).rate[:1]) if quest.wish.explore else quest.expected


def _draw_worlds(quest: Quest) -> Worlds:
    space, times, wish = quest.space, quest.times, quest.wish
    worlds = drawn_worlds(times, space.keys, space.agents, space.longest(), WORLDS, wish.seed)
    if wish.explore:
        return replace(worlds, rate=np.broadcast_to(worlds.rate[:1], worlds.rate.shape))
    return worlds


def _rejudge(result: Search, judge: Judge) -> Search:
    candidates = [ranked.candidate for ranked in result.best]
    scores = judge.scores(candidates).tolist()
    return replace(result, best=tuple(sorted(map(Ranked, scores, candidates))))


SEARCHES: Final[Mapping[str, Callable[[Quest], tuple[Search, float]]]] = {
    Method.ENUMERATE: enumerated,
    Method.LOCAL: searched,
    Method.CPSAT: solved,
    Method.BASELINE: baseline,
    Method.NOT_NEIGHBORING: not_neighboring,
    Method.RANDOM: any_plan,
}
"""What looks for plans in each way of `METHODS`, but for the one that chooses another."""
