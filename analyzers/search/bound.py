"""A makespan that no plan can beat, by linear programming.

The programme forgets the order of tasks and keeps sums only: how often each agent does each task (a_i), and for how
many seconds o_ij tasks i and j of two agents run side by side. In the rate model all executions of i together take
D_i = a_i d_i + sum_j (1 - 1 / s_ij) o_ij, linear in both. Every order of every allocation is a point of this programme,
so its optimum is a lower bound of the makespan with expected durations; the order may make it out of reach.

With more than two agents factors multiply, so that D_i is no longer linear; then each task counts with the least
duration that any company could give it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from hrclog.analyzers.search.rates import fastest
from hrclog.analyzers.search.space import Space
from hrclog.analyzers.search.worlds import Worlds
from hrclog.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class _Row:
    """A constraint: the sum of coefficients times variables equals a constant, or is at most that constant."""

    terms: dict[int, float]
    constant: float
    equal: bool


def lower_bound_s(space: Space, world: Worlds) -> float:
    """Return a lower bound of the makespan, in seconds, in the expected world.

    Due times, precedences and resources could only make it longer; they are left out.

    Args:
        space: the plans.
        world: one world in which equal tasks take equal work and equal items of an agent equal gaps.
    """
    from scipy.optimize import linprog

    programme = _Programme(space, world)
    rows = list(programme.rows())
    equalities = [row for row in rows if row.equal]
    inequalities = [row for row in rows if not row.equal]
    objective = np.zeros(programme.size)
    objective[0] = 1.0
    solution = linprog(
        objective,
        A_ub=_matrix(inequalities, programme.size),
        b_ub=[row.constant for row in inequalities],
        A_eq=_matrix(equalities, programme.size),
        b_eq=[row.constant for row in equalities],
        method="highs",
    )
    return float(solution.fun) if solution.success else 0.0


def _matrix(rows: list[_Row], size: int) -> FloatArray:
    matrix = np.zeros((len(rows), size))
    for number, row in enumerate(rows):
        for variable, value in row.terms.items():
            matrix[number, variable] += value
    return matrix


class _Programme:
    """Variables: 0 the makespan, then how often (unit, agent), then o_ij per pair of keys of two agents."""

    def __init__(self, space: Space, world: Worlds) -> None:
        self._space = space
        self._keys = space.keys
        self._work = world.work_s[0, :, 0]
        self._gap = world.gap_s[0, :, 0]
        self._rate = world.rate[0]
        self._count_variables: dict[tuple[int, str], int] = {}
        self._overlap_variables: dict[tuple[int, int], int] = {}
        for unit, kind in enumerate(space.units):
            for agent in kind.agents:
                self._count_variables[unit, agent] = 1 + len(self._count_variables)
        if len(space.agents) == 2:
            for i, j in combinations(range(len(self._keys)), 2):
                if self._keys[i][0] != self._keys[j][0]:
                    self._overlap_variables[i, j] = 1 + len(self._count_variables) + len(self._overlap_variables)
        self.size = 1 + len(self._count_variables) + len(self._overlap_variables)

    def rows(self) -> Iterator[_Row]:
        """Yield all constraints."""
        for unit, count in enumerate(self._space.counts):
            agents = self._space.units[unit].agents
            yield _Row({self._count_variables[unit, agent]: 1.0 for agent in agents}, count, equal=True)
        for number, agent in enumerate(self._space.agents):
            yield self._agent_row(number, agent)
        for key in range(len(self._keys)):
            if self._overlap_variables:
                yield self._overlap_row(key)
        if self._overlap_variables:
            yield self._total_row()

    def _agent_row(self, number: int, agent: str) -> _Row:
        """The agent's tasks and gaps fit into the makespan plus the time before the first start."""
        terms = self._load(agent, self._gap[number])
        return _Row({0: -1.0} | terms, self._first_start(number), equal=False)

    def _first_start(self, number: int) -> float:
        """Return the latest instant of the first start if the agent has work: the least gap of it and of sure workers.

        Sure workers are agents that alone can do some unit. Where agents may wait, only the agent's own gap counts.
        """
        space = self._space
        waits = space.linked or space.begun or any(task.release_s or task.resources for task in space.problem.tasks)
        busy = () if waits else {unit.agents[0] for unit in space.units if len(unit.agents) == 1}
        return float(min(self._gap[number], *(self._gap[space.agents.index(agent)] for agent in busy), np.inf))

    def _load(self, agent: str, gap: float) -> dict[int, float]:
        terms: dict[int, float] = {}
        for key, (name, _) in enumerate(self._keys):
            if name == agent:
                for variable, value in self._duration(key, gap).items():
                    terms[variable] = terms.get(variable, 0.0) + value
        return terms

    def _duration(self, key: int, gap: float = 0.0) -> dict[int, float]:
        """Return the terms of D_i, plus one gap for each execution."""
        agent, task = self._keys[key]
        least = float(self._work[key])
        if not self._overlap_variables:
            least /= fastest(self._keys, self._rate, key)
        terms = {
            variable: self._space.units[unit].tasks.count(task) * (least + gap)
            for (unit, name), variable in self._count_variables.items()
            if name == agent and task in self._space.units[unit].tasks
        }
        for (i, j), variable in self._overlap_variables.items():
            if key in (i, j):
                terms[variable] = 1.0 - float(self._rate[key, j if key == i else i])
        return terms

    def _overlap_row(self, key: int) -> _Row:
        """A task overlaps others for no longer than it lasts."""
        terms = {variable: 1.0 for pair, variable in self._overlap_variables.items() if key in pair}
        for variable, value in self._duration(key).items():
            terms[variable] = terms.get(variable, 0.0) - value
        return _Row(terms, 0.0, equal=False)

    def _total_row(self) -> _Row:
        """The time in which either agent works (both loads minus their overlap) is at most the makespan."""
        terms: dict[int, float] = {0: -1.0}
        for agent in self._space.agents:
            for variable, value in self._load(agent, 0.0).items():
                terms[variable] = terms.get(variable, 0.0) + value
        for variable in self._overlap_variables.values():
            terms[variable] = terms.get(variable, 0.0) - 1.0
        return _Row(terms, 0.0, equal=False)
