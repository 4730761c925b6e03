"""Models of estimators without a distribution of work: the work of the observed executions under their factors."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import polars as pl

from hrclog.analyzers.projections.joint_states import AgentTask
from hrclog.analyzers.synergy.exposures import exposures
from hrclog.analyzers.synergy.fit import TaskModel
from hrclog.analyzers.synergy.log_work import SampledLogWork
from hrclog.analyzers.synergy.observations import Observations

LEAST_FACTOR: Final = 0.1
"""A linear fit can give factors that no rate can have; in a model none is smaller than this."""


def sampled_models(observations: Observations, synergies: pl.DataFrame) -> dict[AgentTask, TaskModel]:
    """Return the model of each (agent, task) with a successful execution.

    Args:
        observations: what was learnt from.
        synergies: schema `SYNERGIES`; rows without a number have no effect.
    """
    known = synergies.filter(pl.col("synergy").is_not_null())
    factors: dict[AgentTask, dict[AgentTask, float]] = {}
    for agent, task, other, other_task, factor in known.select(
        "agent", "task", "other_agent", "other_task", "synergy"
    ).iter_rows():
        factors.setdefault((agent, task), {})[other, other_task] = math.log(max(factor, LEAST_FACTOR))
    models: dict[AgentTask, TaskModel] = {}
    for data in exposures(observations):
        if data.finished.any():
            of_task = factors.get(data.key, {})
            work = data.work(data.log_factors(of_task))[data.finished]
            models[data.key] = TaskModel(of_task, SampledLogWork(np.log(work)))
    return models
