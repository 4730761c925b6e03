"""The plan duration of the paper, in closed form, for comparison with the exact evaluation.

Tasks are laid out with their mean durations d, as if no agent affected another; each then counts
d_i (1 + sum_j delta_ij (s_ij - 1)), delta_ij the part of it that lies beside task j of another agent and s_ij the
synergy relative to mean durations. The plan takes as long as its longest agent (Sandrini, Faroni and Pedrocchi 2022,
eq. plan-duration-synergy). The formula ignores that a longer task
delays later tasks and so changes the overlaps.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hrclog.analyzers.search.encoded import Encoded
from hrclog.analyzers.search.evaluate import evaluate
from hrclog.analyzers.search.mean_durations import by_mean_durations
from hrclog.analyzers.search.worlds import expected_world
from hrclog.arrays import FloatArray
from hrclog.knowledge.task_times import AgentTask, TaskTimes


def closed_form_s(plans: Encoded, times: TaskTimes) -> FloatArray:
    """Return the closed-form duration of each plan, in seconds, shape (B,).

    Args:
        plans: B plans.
        times: what is known.

    Raises:
        ScenarioError: nothing is known of a key.
    """
    means = by_mean_durations(times)
    world = expected_world(means, plans.keys, plans.agents, plans.task.shape[-1], synergies=False)
    durations = np.empty((plans.size, len(plans.agents)))
    for number, agent in enumerate(plans.agents):
        cost = extra_per_second(plans.keys, times, means, agent)
        evaluated = evaluate(plans, world, cost=cost, timeline=True)
        if evaluated.start_s is None or evaluated.end_s is None:
            raise AssertionError("timelines were asked for")
        start = np.nanmin(evaluated.start_s, axis=(2, 3))[:, 0]
        last = np.nan_to_num(evaluated.end_s[:, 0, number], nan=-np.inf).max(axis=1)
        durations[:, number] = last - start + evaluated.cost[:, 0]
    longest: FloatArray = durations.max(axis=1)
    return longest


def extra_per_second(keys: Sequence[AgentTask], times: TaskTimes, means: TaskTimes, agent: str) -> FloatArray:
    """Return s_ij - 1 for the agent's tasks beside those of others, symmetric, shape (K + 1, K + 1)."""
    extra = np.zeros((len(keys) + 1, len(keys) + 1))
    for i, key in enumerate(keys):
        if key[0] != agent:
            continue
        time = times.times[key]
        for factor in time.factors:
            other = (factor.other_agent, factor.other_task)
            if other in keys:
                j = keys.index(other)
                synergy = np.exp(factor.log_s) * time.mean_s / means.times[key].mean_s
                extra[i, j] = extra[j, i] = synergy - 1.0
    return extra
