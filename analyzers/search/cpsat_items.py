"""Executions as integer variables of a constraint solver.

Times are whole ticks. An execution is given when its agent is free and all that it waits for is there. This instant
and the end are rounded to the nearest tick; the start is the given instant plus the agent's gap, rounded. Rounding
keeps the order of instants, so "not before" holds for ticks as it does for seconds, and a start is off by one tick at
most.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

from hrclog.analyzers.search.rates import fastest, slowest
from hrclog.analyzers.search.space import Candidate, Space
from hrclog.analyzers.search.worlds import Worlds

TICKS_PER_S: Final = 100_000


@dataclass(frozen=True, slots=True)
class Item:
    """An execution that may take place: all its times are 0 if it does not.

    Attributes:
        agent: by number.
        key: by number.
        task: its name.
        given: when it is given to its agent.
        start: that and the gap.
        end: when it is over.
        taken: literal: it takes place.
    """

    agent: int
    key: int
    task: str
    given: Any
    start: Any
    end: Any
    taken: Any


@dataclass(frozen=True, slots=True)
class Chain:
    """A unit of work that an agent may do."""

    unit: int
    agent: int
    items: tuple[Item, ...]

    @property
    def first(self) -> Item:
        """Return the first of its executions."""
        return self.items[0]

    @property
    def last(self) -> Item:
        """Return the last of its executions."""
        return self.items[-1]

    @property
    def taken(self) -> Any:  # noqa: ANN401 - a literal of the solver
        """Return the literal: the agent does it."""
        return self.first.taken


class Items:
    """All executions that may take place, as variables of a solver's model.

    Args:
        cp: the solver's model.
        space: the plans.
        world: one world with equal work in equal tasks and equal gaps of an agent.
        most: ticks; longer makespans are of no interest.
    """

    def __init__(self, cp: Any, space: Space, world: Worlds, most: int) -> None:  # noqa: ANN401 - a solver's model
        self.waits = space.linked or any(task.release_s or task.resources for task in space.problem.tasks)
        self.keys, self.rate = space.keys, world.rate[0]
        self.work = world.work_s[0, :, 0] * TICKS_PER_S
        self._cp, self._space = cp, space
        self._gaps = [round(float(gap) * TICKS_PER_S) for gap in world.gap_s[0, :, 0]]
        latest = max(task.release_s for task in space.problem.tasks)  # before which all may have to wait
        self.horizon = most + max(self._gaps) + math.ceil(latest * TICKS_PER_S)
        self.chains = tuple(self._new_chains())
        self.of = [[i for c in self.chains if c.agent == a for i in c.items] for a in range(len(space.agents))]

    @property
    def all(self) -> list[Item]:
        """Return every item."""
        return [item for row in self.of for item in row]

    def named(self, task: str) -> list[Item]:
        """Return the items of a task."""
        return [item for item in self.all if item.task == task]

    def in_order(self, task: str) -> bool:
        """Return whether the executions of a task are numbered as they come."""
        kinds = [kind for kind in self._space.units if task in kind.tasks]
        return len(kinds) == 1 and len(kinds[0].agents) == 1

    def shortest(self, item: Item) -> int:
        """Return for how many ticks an execution lasts at least; the ends are off by 1.5 ticks together."""
        return math.ceil(float(self.work[item.key]) / fastest(self.keys, self.rate, item.key)) - 2

    def longest(self, item: Item) -> int:
        """Return for how many ticks an execution can last."""
        least = slowest(self.keys, self.rate, item.key)
        return min(math.floor(float(self.work[item.key]) / least + 2), self.horizon) if least > 0.0 else self.horizon

    def _new_chains(self) -> Iterator[Chain]:
        for unit, (kind, count) in enumerate(zip(self._space.units, self._space.counts, strict=True)):
            taken = []
            for agent in kind.agents:
                chains = [self._new_chain(unit, agent, optional=len(kind.agents) > 1) for _ in range(count)]
                self._order_equal_units(chains)
                taken += [chain.taken for chain in chains]
                yield from chains
            self._cp.add(sum(taken) == count)

    def _new_chain(self, unit: int, agent: str, *, optional: bool) -> Chain:
        number = self._space.agents.index(agent)
        taken = self._cp.new_bool_var("") if optional else self._cp.new_constant(1)
        items: list[Item] = []
        for task in self._space.units[unit].tasks:
            end = self._new_instant()
            given_at = items[-1].end if items and not self.waits else self._new_instant()
            item = Item(
                number,
                self.keys.index((agent, task)),
                task,
                given_at,
                given_at + self._gaps[number] * taken,
                end,
                taken,
            )
            self._cp.add(item.end - item.start >= self.shortest(item)).only_enforce_if(taken)
            self._cp.add(item.end - item.start <= self.longest(item)).only_enforce_if(taken)
            for instant in (given_at, end):
                self._cp.add(instant == 0).only_enforce_if(~taken)
            items.append(item)
        return Chain(unit, number, tuple(items))

    def _new_instant(self) -> Any:  # noqa: ANN401 - a variable of the solver
        return self._cp.new_int_var(0, self.horizon, "")

    def _order_equal_units(self, chains: Sequence[Chain]) -> None:
        """Fix the order of equal units of an agent, which are interchangeable, to the order of their numbers."""
        for before, after in pairwise(chains):
            self._cp.add_implication(after.taken, before.taken)
            self._cp.add(after.first.given >= before.last.end).only_enforce_if(after.taken)


def orders_of(given: Iterable[tuple[Chain, int]], agents: int) -> Candidate:
    """Return the plan in which units are done in the order of the instants at which they are given."""
    rows: list[list[tuple[int, int]]] = [[] for _ in range(agents)]
    for chain, instant in given:
        rows[chain.agent].append((instant, chain.unit))
    return tuple(tuple(unit for _, unit in sorted(row)) for row in rows)
