"""What an estimator returns: a table, covariances, and a model that predicts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import polars as pl

from hrclog.analyzers.projections.joint_states import AgentTask
from hrclog.analyzers.synergy.log_work import LogWork
from hrclog.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class TaskModel:
    """How long an (agent, task) takes given what the others do: the D that solves W(D) = exp(log work).

    W(D) is the integral over the execution of the product over the others of 1 / s.

    Attributes:
        log_factors: log s per task of the others; one that is missing has no effect.
        log_work: distribution of log W, W in seconds.
    """

    log_factors: Mapping[AgentTask, float]
    log_work: LogWork


@dataclass(frozen=True, slots=True)
class Covariance:
    """Of what was fitted together.

    Attributes:
        parameters: names; a factor is named by the (agent, task, other agent, other task) of its row.
        matrix: shape (p, p), in the order of the names; NaN where not known.
    """

    parameters: tuple[str | tuple[str, str, str, str], ...]
    matrix: FloatArray


@dataclass(frozen=True, slots=True)
class Fit:
    """The result of an estimator.

    Attributes:
        synergies: schema `SYNERGIES`.
        models: one per (agent, task) with a successful execution.
        covariances: one per fit that was made.
    """

    synergies: pl.DataFrame
    models: dict[AgentTask, TaskModel]
    covariances: tuple[Covariance, ...] = field(default=())
