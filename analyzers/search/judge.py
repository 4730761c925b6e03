"""Score plans: how good they are in given worlds, by a given objective."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Final

import numpy as np

from hrclog.analyzers.search.closed_form import closed_form_s
from hrclog.analyzers.search.encoded import Encoded, encode_plans, encode_queues, encode_resources
from hrclog.analyzers.search.evaluate import Begun, Evaluated, evaluate
from hrclog.analyzers.search.space import Candidate, Space
from hrclog.analyzers.search.worlds import Worlds
from hrclog.arrays import FloatArray
from hrclog.errors import ScenarioError
from hrclog.knowledge.task_times import NOTHING, AgentTask, TaskTimes
from hrclog.planning.plan import Plan, make_plan

TARDY: Final = 1e6
"""Weight of a second after a due time, relative to a second of makespan: due times come first."""

MOST_LANES: Final = 16_384
"""Plans times worlds that are judged at once; more do not fit the processor's cache."""


class Objective(StrEnum):
    """What is to be small: the mean or the 95 % quantile of the makespan over worlds, or the paper's closed form."""

    MEAN = "mean"
    P95 = "p95"
    CLOSED_FORM = "closed-form"


@dataclass(frozen=True)
class Judge:
    """Judges candidates; lower is better, infinite where a candidate is impossible.

    Attributes:
        space: what the candidates are.
        worlds: in which they are carried out.
        objective: of their makespans.
        begun: where they go on from.
        cost: per second in which two agents work on keys i and j, in the order of `space.keys` and idle.
        cost_weight: of that cost beside a second of makespan.
        times: what is known, for the closed form.
    """

    space: Space
    worlds: Worlds
    objective: Objective = Objective.MEAN
    begun: Begun = field(default_factory=Begun)
    cost: FloatArray | None = None
    cost_weight: float = 1.0
    times: TaskTimes = NOTHING

    def scores(self, candidates: Sequence[Candidate]) -> FloatArray:
        """Return the score of each candidate, shape (n,)."""
        size = max(MOST_LANES // self.worlds.count, 1)
        parts = [self._scores(candidates[start : start + size]) for start in range(0, len(candidates), size)]
        return np.concatenate(parts) if parts else np.empty(0)

    def _scores(self, candidates: Sequence[Candidate]) -> FloatArray:
        encoded, possible = self._encode(candidates)
        scores = np.full(len(candidates), np.inf)
        if encoded is not None:
            scores[possible] = self._score(encoded)
        return scores

    def _score(self, encoded: Encoded) -> FloatArray:
        if self.objective is Objective.CLOSED_FORM:
            return closed_form_s(encoded, self.times)
        due = _due_times(self.space, encoded.keys)
        evaluated = evaluate(
            encoded, self.worlds, begun=self.begun, cost=self.cost, timeline=bool(np.isfinite(due).any())
        )
        score = evaluated.makespan_s + self.cost_weight * evaluated.cost + TARDY * _tardiness(evaluated, encoded, due)
        if self.objective is Objective.P95:
            return np.quantile(score, 0.95, axis=1)
        mean: FloatArray = score.mean(axis=1)
        return mean

    def _encode(self, candidates: Sequence[Candidate]) -> tuple[Encoded | None, list[int]]:
        """Return the candidates that are possible, and their places."""
        keys = self.space.keys
        if not self.space.linked:
            encoded = encode_queues(self.space.agents, keys, [self.space.queues(candidate) for candidate in candidates])
            return _add_rules(encoded, self.space), list(range(len(candidates)))
        plans, places = [], []
        for place, candidate in enumerate(candidates):
            plan = possible_plan(self.space, candidate)
            if plan is not None:
                plans.append(plan)
                places.append(place)
        return (encode_plans(self.space.problem, keys, plans) if plans else None), places


def possible_plan(space: Space, candidate: Candidate, name: str = "plan") -> Plan | None:
    """Return the plan of a candidate, None if agents would wait for each other for ever."""
    try:
        return make_plan(space.problem, {a: tuple(tasks) for a, tasks in space.queues(candidate).items()}, name)
    except ScenarioError:
        return None


def _add_rules(encoded: Encoded, space: Space) -> Encoded:
    """Add what the tasks themselves ask for: release times and resources."""
    releases = np.array([space.problem.task(task).release_s for _, task in encoded.keys] + [0.0])
    not_before = releases[encoded.task] if releases.any() else None
    return replace(encoded, not_before_s=not_before, resources=encode_resources(space.problem, encoded))


def _due_times(space: Space, keys: Sequence[AgentTask]) -> FloatArray:
    due = [space.problem.task(task).due_s for _, task in keys]
    return np.array([*(np.inf if instant is None else instant for instant in due), np.inf])


def _tardiness(evaluated: Evaluated, encoded: Encoded, due: FloatArray) -> FloatArray:
    """Return the total time by which items end after they are due; (B, S)."""
    if evaluated.end_s is None:
        return np.zeros_like(evaluated.makespan_s)
    late = (evaluated.end_s - due[encoded.task[:, None, :, :-1]]).clip(0.0)
    total: FloatArray = np.nansum(np.where(np.isfinite(late), late, 0.0), axis=(2, 3))
    return total
