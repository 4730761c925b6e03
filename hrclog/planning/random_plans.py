"""Plans drawn at random under a problem's constraints."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from hrclog.errors import ScenarioError
from hrclog.planning.order import Ledger, possible_sequence
from hrclog.planning.plan import Orders, Plan, make_plan
from hrclog.planning.problem import Precedence, Problem, Unit

T = TypeVar("T")

_ATTEMPTS = 1000
_TRIALS = 100  # attempts that tell whether a problem with fewer precedences is possible


def random_plans(problem: Problem, seed: int | str) -> Iterator[Plan]:
    """Yield plans drawn at random, all different, until chance finds no further one.

    The order depends on the seed alone, so the first plans stay the same however many are taken. A problem has been
    drawn dry when 100 + 10 n draws in a row gave none that is not among the n found (for equally likely plans: one
    that is left would have been missed with probability e^-10).

    Args:
        problem: what is to be done.
        seed: of the random numbers.

    Raises:
        ScenarioError: no order was found in which every agent gets to the end.
    """
    source = random.Random(f"plans:{seed}")  # noqa: S311 - reproducible simulation, no cryptography
    keys: set[tuple[tuple[str, ...], ...]] = set()
    misses = 0
    while misses < 100 + 10 * len(keys):
        orders = random_orders(problem, source)
        key = tuple(orders[agent] for agent in problem.agents)
        if key in keys:
            misses += 1
            continue
        keys.add(key)
        misses = 0
        yield make_plan(problem, orders, f"plan-{len(keys):03d}")


def distinct_plans(problem: Problem, count: int, seed: int | str) -> list[Plan]:
    """Return plans drawn at random, all different.

    Raises:
        ScenarioError: there are not that many.
    """
    plans = [plan for plan, _ in zip(random_plans(problem, seed), range(count), strict=False)]
    if len(plans) < count:
        raise ScenarioError(f"{count} different plans were asked for, the problem has {len(plans)}; ask for fewer")
    return plans


def random_orders(problem: Problem, source: random.Random) -> Orders:
    """Return the tasks of each agent in a random order that is possible.

    Free work is dealt out at random first; where no precedence links the agents, an agent's orders are equally likely.

    Args:
        problem: what is to be done.
        source: only its `random()` is used, the one method whose numbers Python promises to keep.

    Raises:
        ScenarioError: no order was found in which every agent gets to the end.
    """
    orders = _try(problem, source, _ATTEMPTS)
    if orders is None:
        rules = ", ".join(f"{rule.before} -> {rule.after} ({rule.kind})" for rule in _conflict(problem))
        raise ScenarioError(
            f"precedences: {_ATTEMPTS} random orders all came to a standstill, agents waiting for each other; "
            f"together {rules} cannot be kept, loosen one of them"
        )
    return orders


def _try(problem: Problem, source: random.Random, attempts: int) -> Orders | None:
    """Return orders that are possible, None if none of so many is."""
    units = problem.units()
    for _ in range(attempts):
        orders = _draw_orders(problem, [(pick(unit.agents, source), unit) for unit in units], source)
        if orders is not None:
            return orders
    return None


def _conflict(problem: Problem) -> tuple[Precedence, ...]:
    """Return precedences that come to a standstill together, and no longer if one of them is left out."""
    source = random.Random(0)  # noqa: S311 - reproducible message, no cryptography
    for rule in problem.precedences:
        fewer = replace(problem, precedences=tuple(other for other in problem.precedences if other != rule))
        if _try(fewer, source, _TRIALS) is None:
            problem = fewer
    return problem.precedences


def pick(values: Sequence[T], source: random.Random) -> T:
    """Return one of the values, each equally likely."""
    return values[int(source.random() * len(values))]


def random_rest(
    problem: Problem, begun: Mapping[str, Sequence[str]], units: Iterable[Unit], source: random.Random
) -> Orders | None:
    """Return orders that begin in a given way, and go on in a random way that is possible; None if that fails.

    Args:
        problem: its precedences are kept.
        begun: the tasks that each agent does first.
        units: the work that is left, each as often as it is to be done.
        source: only its `random()` is used.
    """
    assignments = [(pick(unit.agents, source), unit) for unit in units]
    try:
        return _draw_orders(problem, assignments, source, begun)
    except ScenarioError:  # the first tasks need some of the remaining ones
        return None


def _draw_orders(
    problem: Problem,
    assignments: Iterable[tuple[str, Unit]],
    source: random.Random,
    begun: Mapping[str, Sequence[str]] | None = None,
) -> Orders | None:
    remaining: dict[str, Counter[str]] = {agent: Counter() for agent in problem.agents}
    for agent, unit in assignments:
        remaining[agent].update(unit.tasks)
    orders: dict[str, list[str]] = {agent: [] for agent in problem.agents}
    ledger = Ledger(problem)
    for agent, place in possible_sequence(problem, begun or {}, "what comes first"):
        task = (begun or {})[agent][place]
        ledger.do(agent, str(place), task)
        orders[agent].append(task)
    for _ in range(sum(counts.total() for counts in remaining.values())):
        agent, ready = _pick_turn(ledger, remaining, source)
        if not ready:
            return None
        task = pick(ready, source)
        ledger.do(agent, str(len(orders[agent])), task)
        orders[agent].append(task)
        remaining[agent][task] -= 1
    return {agent: tuple(tasks) for agent, tasks in orders.items()}


def _pick_turn(ledger: Ledger, remaining: dict[str, Counter[str]], source: random.Random) -> tuple[str, list[str]]:
    """Return one of the agents that can go on, each equally likely, and what it can do; "" and [] if none can."""
    agents = list(remaining)
    while agents:
        agent = pick(agents, source)
        ready = _ready_tasks(ledger, agent, remaining[agent])
        if ready:
            return agent, ready
        agents.remove(agent)
    return "", []


def _ready_tasks(ledger: Ledger, agent: str, remaining: Counter[str]) -> list[str]:
    """Return each ready task as often as it is left."""
    due = ledger.due(agent)
    if due is not None:
        return [due] if ledger.ready(agent, due) else []
    return [task for task, count in remaining.items() if count and ledger.ready(agent, task) for _ in range(count)]
