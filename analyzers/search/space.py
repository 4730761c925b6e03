"""All plans of a problem: who does which unit of work, in which order."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product

from hrclog.analyzers.search.encoded import Queues
from hrclog.knowledge.task_times import AgentTask
from hrclog.planning.problem import PrecedenceKind, Problem, Unit

Candidate = tuple[tuple[int, ...], ...]
"""Of each agent the numbers of its units of work, in its order."""


@dataclass(frozen=True, slots=True)
class Space:
    """The plans of a problem.

    Attributes:
        problem: what is to be done.
        units: the different units of work.
        counts: how often each is to be done.
        begun: tasks that an agent goes on with before anything else.
    """

    problem: Problem
    units: tuple[Unit, ...]
    counts: tuple[int, ...]
    begun: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def agents(self) -> tuple[str, ...]:
        """Return the agents of the problem."""
        return self.problem.agents

    @property
    def keys(self) -> list[AgentTask]:
        """Return every (agent, task) that a plan may hold, in order of agents, then tasks."""
        used = {(agent, task) for unit in self.units for agent in unit.agents for task in unit.tasks}
        used |= {(agent, task) for agent, tasks in self.begun.items() for task in tasks}
        return [key for key in self.problem.agent_tasks() if key in used]

    @property
    def linked(self) -> bool:
        """Return whether agents may have to wait for each other's work, so that not every order is possible."""
        return any(p.kind is not PrecedenceKind.NEXT for p in self.problem.precedences)

    def queues(self, candidate: Candidate) -> Queues:
        """Return the tasks of each agent, in its order."""
        return {
            agent: (*self.begun.get(agent, ()), *(task for unit in row for task in self.units[unit].tasks))
            for agent, row in zip(self.agents, candidate, strict=True)
        }

    def candidate(self, orders: Queues) -> Candidate:
        """Return the candidate whose tasks are in these orders; tasks in no unit are left out.

        Where an agent's own work and work for anybody begin with the same task, its own is taken to be done first.
        """
        counts_left = list(self.counts)
        by_freedom = sorted(range(len(self.units)), key=lambda number: len(self.units[number].agents))
        rows = []
        for agent in self.agents:
            row = []
            for task in orders.get(agent, ()):
                fitting = [n for n in by_freedom if self.units[n].tasks[0] == task and agent in self.units[n].agents]
                if fitting:
                    row.append(next((number for number in fitting if counts_left[number]), fitting[-1]))
                    counts_left[row[-1]] -= 1
            rows.append(tuple(row))
        return tuple(rows)

    def longest(self) -> int:
        """Return how many items an agent's queue can hold."""
        return max(
            len(self.begun.get(agent, ()))
            + sum(n * len(u.tasks) for u, n in zip(self.units, self.counts, strict=True) if agent in u.agents)
            for agent in self.agents
        )

    def allocations(self) -> Iterator[tuple[tuple[int, ...], ...]]:
        """Yield how often each agent does each unit, shape (units, agents)."""
        rows = [
            [
                tuple(dict(zip(unit.agents, split, strict=True)).get(agent, 0) for agent in self.agents)
                for split in _splits(count, len(unit.agents))
            ]
            for unit, count in zip(self.units, self.counts, strict=True)
        ]
        yield from product(*rows)

    def size(self, most: int) -> int:
        """Return how many candidates there are, or some number above `most` if there are more."""
        total = 0
        for tried, allocation in enumerate(self.allocations()):
            total += math.prod(_orders(column) for column in self._by_agent(allocation))
            if total > most or tried > most:
                return max(total, most + 1)
        return total

    def candidates(self) -> Iterator[Candidate]:
        """Yield every candidate once, in a fixed order."""
        for allocation in self.allocations():
            yield from product(*(list(_arrangements(column)) for column in self._by_agent(allocation)))

    def _by_agent(self, allocation: Sequence[Sequence[int]]) -> list[tuple[int, ...]]:
        """Return how often each agent does each unit, an entry per agent even where there are no units."""
        return [tuple(row[agent] for row in allocation) for agent in range(len(self.agents))]


def space_of(problem: Problem) -> Space:
    """Return all plans of a problem."""
    counts = Counter(problem.units())
    return Space(problem, tuple(counts), tuple(counts.values()))


def _splits(count: int, parts: int) -> Iterator[tuple[int, ...]]:
    """Yield the ways to write a count as a sum of `parts` numbers."""
    if parts == 1:
        yield (count,)
        return
    for first in range(count + 1):
        for rest in _splits(count - first, parts - 1):
            yield (first, *rest)


def _orders(counts: Sequence[int]) -> int:
    return math.factorial(sum(counts)) // math.prod(math.factorial(count) for count in counts)


def _arrangements(counts: Sequence[int]) -> Iterator[tuple[int, ...]]:
    """Yield the different orders of units that occur `counts` times each, sorted."""
    if not sum(counts):
        yield ()
        return
    for unit, count in enumerate(counts):
        if count:
            counts_left = [n - (index == unit) for index, n in enumerate(counts)]
            for rest in _arrangements(counts_left):
                yield (unit, *rest)
