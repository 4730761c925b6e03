"""Which task an order may go on with: the precedences, given what was done."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from hrclog.errors import ScenarioError
from hrclog.planning.problem import Precedence, PrecedenceKind, Problem


class Ledger:
    """What was done so far, which items still have to be followed, and so which task is ready.

    Args:
        problem: its precedences and counts are kept.
    """

    def __init__(self, problem: Problem) -> None:
        self._totals = {task.name: problem.total(task.name) for task in problem.tasks}
        self._done: dict[str, list[str]] = {task.name: [] for task in problem.tasks}
        self._rules: dict[str, list[Precedence]] = {}
        for precedence in problem.precedences:
            self._rules.setdefault(precedence.after, []).append(precedence)
        self._followers = {p.before: p.after for p in problem.precedences if p.kind is PrecedenceKind.NEXT}
        self._open: dict[str, tuple[str, str]] = {}  # agent -> (task it must do next, item that asks for it)

    def due(self, agent: str) -> str | None:
        """Return the task that an agent must do next, None if it is free to choose."""
        return self._open[agent][0] if agent in self._open else None

    def ready(self, agent: str, task: str) -> bool:
        """Return whether an agent may do a task now."""
        if self.due(agent) not in (None, task):
            return False
        return all(self._is_kept(rule, agent) for rule in self._rules.get(task, ()))

    def why_not(self, agent: str, task: str) -> str:
        """Return why an agent may not do a task now, "" if it may."""
        if self.due(agent) not in (None, task):
            return f"before {self.due(agent)!r}"
        for rule in self._rules.get(task, ()):
            if not self._is_kept(rule, agent):
                return f"without {rule.before!r} before it ({rule.kind})"
        return ""

    def do(self, agent: str, item_id: str, task: str) -> tuple[str, ...]:
        """Note that an agent does a task as an item, and return the items it had to wait for."""
        waits: dict[str, None] = {}
        for rule in self._rules.get(task, ()):
            waits |= dict.fromkeys(self._waits(rule, agent))
        self._done[task].append(item_id)
        self._open.pop(agent, None)
        if task in self._followers:
            self._open[agent] = (self._followers[task], item_id)
        return tuple(waits)

    def _is_kept(self, rule: Precedence, agent: str) -> bool:
        if rule.kind is PrecedenceKind.NEXT:
            return self.due(agent) == rule.after
        done = len(self._done[rule.before])
        if rule.kind is PrecedenceKind.EACH:
            return done > len(self._done[rule.after])
        return done == self._totals[rule.before]

    def _waits(self, rule: Precedence, agent: str) -> Sequence[str]:
        if rule.kind is PrecedenceKind.NEXT:
            return (self._open[agent][1],)
        done = self._done[rule.before]
        return done if rule.kind is PrecedenceKind.ALL else (done[len(self._done[rule.after])],)


def possible_sequence(problem: Problem, orders: Mapping[str, Sequence[str]], where: str) -> list[tuple[str, int]]:
    """Return an order of all work in which each agent keeps its own and every task is ready when its turn comes.

    A search with memory: what is ready depends only on how far each agent has got.

    Args:
        problem: its precedences are kept.
        orders: the tasks of each agent, in its order.
        where: begins the message of an error.

    Returns:
        (agent, place in its order) of each task.

    Raises:
        ScenarioError: there is none: whatever goes first, the agents come to wait for each other.
    """
    agents = [agent for agent in problem.agents if orders.get(agent)]
    path: list[tuple[str, int]] = []
    tried: set[frozenset[tuple[str, int]]] = set()
    places = dict.fromkeys(agents, 0)
    ledger = Ledger(problem)
    complaint = ""
    while len(path) < sum(len(orders[agent]) for agent in agents):
        agent = _next_agent(orders, places, ledger, tried)
        if agent is not None:
            path.append((agent, places[agent]))
            ledger.do(agent, "", orders[agent][places[agent]])
            places[agent] += 1
            tried.add(frozenset(places.items()))
            continue
        complaint = complaint or _standstill(orders, places, ledger)
        if not path:
            raise ScenarioError(f"{where}: {complaint}; change the order")
        places[path.pop()[0]] -= 1
        ledger = _replay(problem, orders, path)
    return path


def _next_agent(
    orders: Mapping[str, Sequence[str]],
    places: Mapping[str, int],
    ledger: Ledger,
    tried: set[frozenset[tuple[str, int]]],
) -> str | None:
    """Return an agent that can go on to where the search has not been."""
    for agent, place in places.items():
        if place < len(orders[agent]) and ledger.ready(agent, orders[agent][place]):
            ahead = frozenset({**places, agent: place + 1}.items())
            if ahead not in tried:
                return agent
    return None


def _replay(problem: Problem, orders: Mapping[str, Sequence[str]], path: Sequence[tuple[str, int]]) -> Ledger:
    ledger = Ledger(problem)
    for agent, place in path:
        ledger.do(agent, "", orders[agent][place])
    return ledger


def _standstill(orders: Mapping[str, Sequence[str]], places: Mapping[str, int], ledger: Ledger) -> str:
    waiting = [(agent, orders[agent][place]) for agent, place in places.items() if place < len(orders[agent])]
    return "; ".join(f"{agent!r} cannot do {task!r} {ledger.why_not(agent, task)}" for agent, task in sorted(waiting))
