"""Explain what a plan does better than others: which pairs of tasks it keeps apart, and how much time that saves."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from hrclog.analyzers.search.encoded import END, Encoded
from hrclog.analyzers.search.evaluate import Evaluated, evaluate
from hrclog.analyzers.search.worlds import Worlds
from hrclog.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class PairChange:
    """What becomes of two tasks of different agents, in expected seconds per run.

    Attributes:
        agent: of the first task.
        task: the first.
        other_agent: of the second task.
        other_task: the second.
        overlap_s: for how long they run side by side.
        usual_overlap_s: the same in plans drawn at random.
        saved_s: agents' time that is lost to this pair in those, less what is lost here.
    """

    agent: str
    task: str
    other_agent: str
    other_task: str
    overlap_s: float
    usual_overlap_s: float
    saved_s: float

    def to_json(self) -> dict[str, Any]:
        """Return the change as JSON values."""
        return {
            "agent": self.agent,
            "task": self.task,
            "other_agent": self.other_agent,
            "other_task": self.other_task,
            "overlap_s": self.overlap_s,
            "usual_overlap_s": self.usual_overlap_s,
            "saved_s": self.saved_s,
        }


def pair_changes(plan: Encoded, usual: Encoded, worlds: Worlds) -> list[PairChange]:
    """Return all pairs that run side by side here or there, those that save most first.

    Args:
        plan: one plan.
        usual: others, of the same keys and agents.
        worlds: in which they are carried out; the rates of the first count.
    """
    overlap, usual_overlap = (overlaps_s(plans, evaluate(plans, worlds, timeline=True)) for plans in (plan, usual))
    lost_rate = 1.0 - worlds.rate[0]
    changes = []
    for i, j in combinations(range(len(plan.keys)), 2):
        per_second = lost_rate[i, j] + lost_rate[j, i]
        if plan.keys[i][0] != plan.keys[j][0] and max(overlap[i, j], usual_overlap[i, j]) > 0:
            saved = float(per_second * (usual_overlap[i, j] - overlap[i, j]))
            changes.append(
                PairChange(*plan.keys[i], *plan.keys[j], float(overlap[i, j]), float(usual_overlap[i, j]), saved)
            )
    return sorted(changes, key=lambda change: (-change.saved_s, change.agent, change.task, change.other_task))


def overlaps_s(plans: Encoded, found: Evaluated) -> FloatArray:
    """Return for how long keys run side by side, the mean over plans and worlds; symmetric, shape (K, K)."""
    assert found.start_s is not None  # noqa: S101 - the caller asked for timelines
    assert found.end_s is not None  # noqa: S101 - the caller asked for timelines
    total = np.zeros((len(plans.keys) + 1, len(plans.keys) + 1))
    n_agents = len(plans.agents)
    for a, b in combinations(range(n_agents), 2):
        begin = np.maximum(found.start_s[:, :, a, :, None], found.start_s[:, :, b, None, :])
        end = np.minimum(found.end_s[:, :, a, :, None], found.end_s[:, :, b, None, :])
        beside = np.nan_to_num((end - begin).clip(0.0)).mean(axis=1)
        first = np.broadcast_to(_key_numbers(plans, a)[:, :, None], beside.shape)
        second = np.broadcast_to(_key_numbers(plans, b)[:, None, :], beside.shape)
        np.add.at(total, (first, second), beside / plans.size)
    both: FloatArray = (total + total.T)[:-1, :-1]
    return both


def _key_numbers(plans: Encoded, agent: int) -> IntArray:
    task = plans.task[:, agent, :-1]
    numbers: IntArray = np.where(task == END, len(plans.keys), task)
    return numbers
