"""The planning problem as integer constraints, such that every run of every plan keeps them.

While i of one agent runs beside j of another for o_ij, it does (1 / s_ij) o_ij of work, so that with two agents
D_i = d_i + sum_j (1 - 1 / s_ij) o_ij. With more agents factors multiply, and D_i is only bounded from below
(`overlap_weight`): what the solver minimises is then itself a bound, which plans may not reach.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import Any, Final

from hrclog.analyzers.search.cpsat_items import TICKS_PER_S, Chain, Item, Items
from hrclog.analyzers.search.rates import overlap_weight
from hrclog.analyzers.search.space import Candidate, Space
from hrclog.analyzers.search.worlds import Worlds
from hrclog.arrays import FloatArray
from hrclog.planning.problem import Precedence, PrecedenceKind

_MILLIONTHS: Final = 1_000_000
"""Weights of overlaps are written in these."""

ROUNDING: Final = 2
"""Largest excess in ticks of a rounded makespan: an end is off by half a tick, a start by one."""


class Model:
    """Variables and constraints.

    Args:
        space: the plans, none of them begun.
        world: one world with equal work in equal tasks and equal gaps of an agent.
        most_s: makespans above are of no interest.
        least_s: no makespan is below.
    """

    def __init__(self, space: Space, world: Worlds, most_s: float, least_s: float) -> None:
        from ortools.sat.python import cp_model

        self.cp = cp_model.CpModel()
        most = math.ceil(most_s * TICKS_PER_S) + ROUNDING
        least = max(math.floor(least_s * TICKS_PER_S) - ROUNDING, 0)
        self._space = space
        self.items = Items(self.cp, space, world, most)
        self._overlap_of: dict[tuple[int, int], Any] = {}
        for first_items, second_items in combinations(self.items.of, 2):
            self._add_overlaps(first_items, second_items)
        for item in self.items.all:
            self._constrain_duration(item)
        for agent in range(len(space.agents)):
            self._constrain_agent([chain for chain in self.items.chains if chain.agent == agent])
        self._constrain_resources()
        if self.items.waits:
            self._constrain_waits()
        self._minimize_makespan(self.cp.new_int_var(least, most, ""))

    def _add_overlaps(self, first_items: Sequence[Item], second_items: Sequence[Item]) -> None:
        """Define for how long executions of two agents run side by side."""
        for i in first_items:
            for j in second_items:
                between = self.cp.new_int_var(-self.items.horizon, self.items.horizon, "")
                overlap = self.cp.new_int_var(0, min(self.items.longest(i), self.items.longest(j)), "")
                ends = (i.end - i.start, j.end - j.start, i.end - j.start, j.end - i.start)
                self.cp.add_min_equality(between, ends)
                self.cp.add_max_equality(overlap, (between, 0))
                self._overlap_of[id(i), id(j)] = self._overlap_of[id(j), id(i)] = overlap
        for items, others in ((first_items, second_items), (second_items, first_items)):
            for i in items:
                self.cp.add(sum(self._overlap_of[id(i), id(j)] for j in others) <= i.end - i.start).only_enforce_if(
                    i.taken
                )

    def _constrain_duration(self, item: Item) -> None:
        """Define how long an execution takes.

        Its start is off by a tick and its end by half of one; so an overlap is off by 1.5 ticks, and a weight by half a
        millionth. The constraint leaves as much tolerance on either side, so that it excludes no plan.
        """
        others = [j for row in self.items.of for j in row if j.agent != item.agent]
        weights = [overlap_weight(self.items.keys, self.items.rate, item.key, j.key) for j in others]
        slow_down = sum(
            round(weight * _MILLIONTHS) * self._overlap_of[id(item), id(j)]
            for weight, j in zip(weights, others, strict=True)
        )
        work = float(self.items.work[item.key])
        weight_error = len(self.items.of) * self.items.horizon / (2 * _MILLIONTHS)
        tolerance = 1.5 + 1.5 * sum(map(abs, weights)) + weight_error
        work_done = _MILLIONTHS * (item.end - item.start) - slow_down
        self.cp.add(work_done >= round(_MILLIONTHS * (work - tolerance))).only_enforce_if(item.taken)
        if len(self.items.of) <= 2:
            self.cp.add(work_done <= round(_MILLIONTHS * (work + tolerance))).only_enforce_if(item.taken)

    def _constrain_agent(self, chains: Sequence[Chain]) -> None:
        """An agent does one unit after the other, without a break where nothing waits.

        A dispatcher holds nothing back, so a break is not a choice that a plan has.
        """
        self.cp.add_no_overlap(self._new_interval(chain.first, chain.last) for chain in chains)
        if self.items.waits or not chains:
            return
        arcs = [(0, 0, self.cp.new_bool_var(""))]
        for place, chain in enumerate(chains, 1):
            begins = self.cp.new_bool_var("")
            arcs += [(place, place, ~chain.taken), (0, place, begins), (place, 0, self.cp.new_bool_var(""))]
            self.cp.add(chain.first.given == 0).only_enforce_if(begins)
            for next_place, other in enumerate(chains, 1):
                if next_place != place and (chain.unit != other.unit or next_place == place + 1):
                    follows = self.cp.new_bool_var("")
                    arcs.append((place, next_place, follows))
                    self.cp.add(other.first.given == chain.last.end).only_enforce_if(follows)
        self.cp.add_circuit(arcs)
        busy = sum(chain.last.end - chain.first.given for chain in chains)
        for chain in chains:
            self.cp.add(chain.last.end <= busy)

    def _new_interval(self, first: Item, last: Item) -> Any:  # noqa: ANN401 - an interval of the solver
        size = self.cp.new_int_var(0, self.items.horizon, "")
        return self.cp.new_optional_interval_var(first.given, size, last.end, first.taken, "")

    def _constrain_resources(self) -> None:
        """An item holds its exclusive resources from the instant at which it is given to its end."""
        for users in self._items_by_resource().values():
            self.cp.add_no_overlap(self._new_interval(item, item) for item in users)

    def _items_by_resource(self) -> dict[str, list[Item]]:
        resources_of = {task.name: task.resources for task in self._space.problem.tasks}
        names = sorted({name for resources in resources_of.values() for name in resources})
        return {name: [item for item in self.items.all if name in resources_of[item.task]] for name in names}

    def _constrain_waits(self) -> None:
        """Items wait for precedences and releases, and are given at the instant at which the last of all is there."""
        for rule in self._space.problem.precedences:
            if rule.kind is PrecedenceKind.ALL:
                for item in self.items.named(rule.after):
                    for other in self.items.named(rule.before):
                        self.cp.add(item.given >= other.end).only_enforce_if(item.taken)
            elif rule.kind is PrecedenceKind.EACH:
                self._constrain_each(rule)
        for chain in self.items.chains:
            for place, item in enumerate(chain.items):
                before = chain.items[place - 1] if place else None
                if before is not None:
                    self.cp.add(item.given >= before.end)
                self._constrain_given(item, [before] if before is not None else self._other_last_items(chain))

    def _constrain_each(self, rule: Precedence) -> None:
        """Every execution waits for a different one; the k-th for the k-th where one agent does each task."""
        before, after = self.items.named(rule.before), self.items.named(rule.after)
        if self.items.in_order(rule.before) and self.items.in_order(rule.after):
            for item, other in zip(after, before, strict=False):
                self.cp.add(item.given >= other.end)
            return
        waits = [[self.cp.new_bool_var("") for _ in before] for _ in after]
        for row, item in zip(waits, after, strict=True):
            self.cp.add(sum(row) == item.taken)
            for literal, other in zip(row, before, strict=True):
                self.cp.add(item.given >= other.end).only_enforce_if(literal)
                self.cp.add_implication(literal, other.taken)
        for column in zip(*waits, strict=True):
            self.cp.add_at_most_one(column)

    def _other_last_items(self, chain: Chain) -> list[Item]:
        return [other.last for other in self.items.chains if other.agent == chain.agent and other is not chain]

    def _constrain_given(self, item: Item, predecessors: Iterable[Item]) -> None:
        """An item is given when the run starts, it is released, or something ends that it may have waited for."""
        task = self._space.problem.task(item.task)
        release = round(task.release_s * TICKS_PER_S)
        self.cp.add(item.given >= release).only_enforce_if(item.taken)
        awaited = {rule.before for rule in self._space.problem.precedences if rule.after == item.task}
        users = [other for name, row in self._items_by_resource().items() if name in task.resources for other in row]
        ends = [*predecessors, *(other for name in sorted(awaited) for other in self.items.named(name)), *users]
        instants = [release, *{id(other): other.end for other in ends if other is not item}.values()]
        reasons = [self.cp.new_bool_var("") for _ in instants]
        for reason, instant in zip(reasons, instants, strict=True):
            self.cp.add(item.given == instant).only_enforce_if(reason)
        self.cp.add_bool_or(*reasons, ~item.taken)

    def _minimize_makespan(self, makespan: Any) -> None:  # noqa: ANN401 - a variable of the solver
        first = self.cp.new_int_var(0, self.items.horizon, "")
        for item in self.items.all:
            self.cp.add(first <= item.start).only_enforce_if(item.taken)
            self.cp.add(makespan >= item.end - first)
        for first_items, second_items in combinations(self.items.of, 2):  # time in which either works
            loads = sum(i.end - i.start for i in (*first_items, *second_items))
            self.cp.add(
                makespan >= loads - sum(self._overlap_of[id(i), id(j)] for i in first_items for j in second_items)
            )
        self.cp.minimize(makespan)

    def hint(self, candidate: Candidate, given_s: FloatArray, end_s: FloatArray) -> None:
        """Propose a plan.

        Args:
            candidate: the plan.
            given_s: when each agent's items are given, in order, shape (A, P).
            end_s: when they end, likewise.
        """
        unused_chains = {agent: [c for c in self.items.chains if c.agent == agent] for agent in range(len(candidate))}
        for agent, row in enumerate(candidate):
            place = 0
            for unit in row:
                chain = next(chain for chain in unused_chains[agent] if chain.unit == unit)
                unused_chains[agent].remove(chain)
                times = zip(given_s[agent, place:].tolist(), end_s[agent, place:].tolist(), strict=True)
                self._hint_chain(chain, list(times)[: len(chain.items)])
                place += len(chain.items)
        for chain in (chain for unused in unused_chains.values() for chain in unused):
            self._hint_chain(chain, [])

    def _hint_chain(self, chain: Chain, times: Sequence[tuple[float, float]]) -> None:
        if len(self._space.units[chain.unit].agents) > 1:
            self.cp.add_hint(chain.taken, bool(times))
        for place, item in enumerate(chain.items):
            given_s, end_s = times[place] if times else (0.0, 0.0)
            if not place or self.items.waits:
                self.cp.add_hint(item.given, round(given_s * TICKS_PER_S))
            self.cp.add_hint(item.end, round(end_s * TICKS_PER_S))
