"""Find a good plan of a problem by what was learnt, and say what is to be expected of it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice
from typing import Any, Final

from hrclog.analyzers.search.encoded import encode_plans
from hrclog.analyzers.search.evaluate import evaluate
from hrclog.analyzers.search.explain import PairChange, pair_changes
from hrclog.analyzers.search.forecast import Forecast, forecast, with_expected_times
from hrclog.analyzers.search.judge import possible_plan
from hrclog.analyzers.search.outcome import Search
from hrclog.analyzers.search.search import chosen_method, search
from hrclog.analyzers.search.space import Space, space_of
from hrclog.analyzers.search.wish import Wish
from hrclog.analyzers.search.worlds import drawn_worlds, expected_world
from hrclog.errors import ScenarioError
from hrclog.knowledge.task_times import AgentTask, TaskTimes
from hrclog.planning.plan import Plan
from hrclog.planning.problem import Problem
from hrclog.planning.random_plans import random_plans

_USUAL: Final = 100  # random plans that a plan is compared with
_USUAL_WORLDS: Final = 32
_LATE_S: Final = 1e-6  # after a due time; what rounding makes of being in time


@dataclass(frozen=True, slots=True)
class Found:
    """A plan, what is to be expected of it, and how it was found.

    Attributes:
        plan: with the times that are expected.
        forecast: its makespan and items.
        wish: what was wanted, its method being the one that was used.
        search: how many plans were judged, and why the search ended.
        bound_s: no plan's undisturbed makespan is shorter.
        changes: what becomes of pairs of tasks, against random plans; those that save most first.
        usual_s: mean over random plans of the expected makespan: the plan's own times their ratio in the same worlds.
        guessed: (agent, task) that are known by a declared guess alone.
        unobserved: pairs of (agent, task) side by side in the plan of which no run tells a factor.
    """

    plan: Plan
    forecast: Forecast
    wish: Wish
    search: Search
    bound_s: float
    changes: tuple[PairChange, ...]
    usual_s: float
    guessed: tuple[AgentTask, ...]
    unobserved: tuple[tuple[AgentTask, AgentTask], ...]

    @property
    def gap(self) -> float:
        """Return by which part the undisturbed makespan is above its bound."""
        return max(self.forecast.undisturbed_s / self.bound_s - 1.0, 0.0) if self.bound_s else float("inf")

    def to_json(self) -> dict[str, Any]:
        """Return all as JSON values."""
        return {
            "method": str(self.wish.method),
            "objective": str(self.wish.objective),
            "judged": self.search.judged,
            "exhaustive": self.search.exhaustive,
            "stopped": self.search.stopped,
            "bound_s": self.bound_s or None,
            "random_mean_s": self.usual_s,
            "forecast": self.forecast.to_json(),
            "pairs": [change.to_json() for change in self.changes],
            "guessed": [list(key) for key in self.guessed],
            "unobserved": [[*key, *other] for key, other in self.unobserved],
            "plan": self.plan.to_json(),
        }


def find_plan(problem: Problem, times: TaskTimes, wish: Wish | None = None, name: str = "plan") -> Found:
    """Return the best plan that is found.

    Args:
        problem: what is to be done.
        times: what is known of how long it takes, guesses included.
        wish: what kind of plan is wanted; default the least expected makespan.
        name: of the plan.

    Raises:
        ScenarioError: nothing is known of a task; no plan is possible, or none keeps the due times.
    """
    wish = wish or Wish()
    _check_avoided(problem, wish)
    space = space_of(problem)
    result, bound_s = search(space, times, wish)
    if not result.best:
        raise ScenarioError(f"no plan is possible: {_explain_no_plan(problem)}")
    plan = possible_plan(space, result.best[0].candidate, name)
    assert plan is not None  # noqa: S101 - what is impossible is not among the best
    # other draws than those it was chosen by, which flatter it
    plan_forecast = forecast(problem, plan, times, seed=wish.seed + 1)
    _check_due(problem, plan, plan_forecast)
    changes, ratio = _compare_with_random(space, times, plan, wish.seed)
    return Found(
        with_expected_times(plan, plan_forecast),
        plan_forecast,
        Wish(wish.objective, chosen_method(space, wish.method), wish.seed, wish.effort, wish.avoid, wish.explore),
        result,
        bound_s,
        tuple(changes),
        plan_forecast.mean_s * ratio,
        tuple(key for key in space.keys if times.times[key].source == "guess"),
        tuple(_unobserved_pairs(times, changes)),
    )


def _compare_with_random(space: Space, times: TaskTimes, plan: Plan, seed: int) -> tuple[list[PairChange], float]:
    """Return what becomes of pairs against random plans, and how many times as long these take in the same worlds."""
    usual = list(islice(random_plans(space.problem, f"usual:{seed}"), _USUAL))
    keys = space.keys
    encoded_usual, encoded_plan = (encode_plans(space.problem, keys, plans) for plans in (usual, [plan]))
    size = space.longest()
    changes = pair_changes(encoded_plan, encoded_usual, expected_world(times, keys, space.agents, size))
    worlds = drawn_worlds(times, keys, space.agents, size, _USUAL_WORLDS, seed + 1)
    usual_s, plan_s = (evaluate(plans, worlds).makespan_s.mean() for plans in (encoded_usual, encoded_plan))
    return changes, float(usual_s / plan_s)


def _unobserved_pairs(times: TaskTimes, changes: Iterable[PairChange]) -> Iterable[tuple[AgentTask, AgentTask]]:
    """Yield pairs that run side by side in the plan and of which neither factor was observed."""
    for change in changes:
        key, other = (change.agent, change.task), (change.other_agent, change.other_task)
        if change.overlap_s > 0 and not times.observed(key, other) and not times.observed(other, key):
            yield key, other


def _check_avoided(problem: Problem, wish: Wish) -> None:
    agent_tasks = problem.agent_tasks()
    for agent, task in (key for pair in wish.avoid or () for key in pair):
        if (agent, task) not in agent_tasks:
            names = ", ".join(f"{name} by {who}" for who, name in agent_tasks)
            raise ScenarioError(f"pairs to avoid: found {task!r} by {agent!r}, expected of {names}")


def _check_due(problem: Problem, plan: Plan, plan_forecast: Forecast) -> None:
    for item in plan.items:
        due = problem.task(item.task).due_s
        end = plan_forecast.items[item.item_id][1]
        if due is not None and end > due + _LATE_S:
            raise ScenarioError(
                f"task {item.task!r}: due_s is {due:g}, and the best plan that was found ends it at {end:.1f} s,"
                f" {end - due:.1f} s late; allow more time or ask less"
            )


def _explain_no_plan(problem: Problem) -> str:
    kinds = ", ".join(f"{p.before} -> {p.after} ({p.kind})" for p in problem.precedences)
    return f"in every order agents come to wait for each other; loosen one of the precedences: {kinds or 'none'}"
