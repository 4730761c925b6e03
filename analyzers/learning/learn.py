"""What runs teach: statistics for people, and the times that plans are judged by."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import polars as pl

from hrclog.analyzers.projections.durations import durations
from hrclog.analyzers.projections.intervals import is_counted, is_learnt
from hrclog.analyzers.projections.joint_states import AgentTask
from hrclog.analyzers.synergy.estimator import estimate
from hrclog.analyzers.synergy.estimators import DEFAULT_ESTIMATOR, ESTIMATORS
from hrclog.analyzers.synergy.fit import Fit, TaskModel
from hrclog.analyzers.synergy.observations import observe
from hrclog.analyzers.synergy.outlier_methods import Outliers
from hrclog.arrays import FloatArray
from hrclog.events import Outcome
from hrclog.knowledge.task_times import Factor, Gap, TaskTime, TaskTimes


@dataclass(frozen=True, slots=True)
class Learnt:
    """What an estimator makes of runs.

    Attributes:
        estimator: its name.
        outliers: which executions it left out.
        durations: schema `DURATIONS`.
        synergies: schema `SYNERGIES`.
        times: what plans are judged by.
    """

    estimator: str
    outliers: Outliers
    durations: pl.DataFrame
    synergies: pl.DataFrame
    times: TaskTimes


def learn(intervals: pl.DataFrame, estimator: str = DEFAULT_ESTIMATOR, outliers: Outliers = "none") -> Learnt:
    """Learn from runs.

    Args:
        intervals: a frame of schema `INTERVALS`.
        estimator: one of `ESTIMATORS`.
        outliers: which executions it leaves out.
    """
    observations = observe(intervals)
    chosen_estimator = ESTIMATORS[estimator]
    fit = estimate(chosen_estimator, observations, outliers)
    summary = durations(intervals)
    failures = _failure_rates(intervals)
    times = {}
    planned = chosen_estimator.for_planning(fit, observations, outliers)
    for key, time in _times(planned, summary).items():
        rate, failed_s = failures.get(key, (0.0, 0.0))
        times[key] = replace(time, failure_rate=rate, failed_s=failed_s)
    return Learnt(chosen_estimator.name, outliers, summary, fit.synergies, TaskTimes(times, gaps(intervals)))


def gaps(intervals: pl.DataFrame) -> dict[str, Gap]:
    """Return how long each agent takes from when it could start its next task until it does.

    From being told where the log says when that was; else from when it was free and the planned start had come, which
    is not known of the first task of a run.

    Args:
        intervals: a frame of schema `INTERVALS`.
    """
    rows = intervals.filter(is_counted()).sort("run_id", "agent", "start_ns", "until_ns", "task", "execution_id")
    free = pl.col("until_ns").shift(1).over("run_id", "agent")
    could_start = pl.when(free.is_not_null()).then(pl.max_horizontal(free, "planned_start_ns"))
    gap = (pl.col("start_ns") - pl.coalesce("dispatched_ns", could_start)).clip(0) / 1e9
    gap_rows = (
        rows.with_columns(gap.alias("gap_s"))
        .filter(is_learnt())
        .select("agent", "gap_s")
        .drop_nulls()
        .sort("agent", "gap_s")
        .group_by("agent", maintain_order=True)
        .agg(pl.col("gap_s").mean().alias("mean"), pl.col("gap_s").std().fill_null(0.0).alias("std"), pl.len())
    )
    return {agent: Gap(agent, mean, std, n) for agent, mean, std, n in gap_rows.iter_rows()}


def _failure_rates(intervals: pl.DataFrame) -> dict[AgentTask, tuple[float, float]]:
    """Return of each (agent, task) the part of its attempts that fails, and how long such a one takes."""
    failed = pl.col("outcome").is_in([Outcome.FAILED.value, Outcome.TIMED_OUT.value])
    seconds = (pl.col("until_ns") - pl.col("start_ns")) / 1e9
    rates = (
        intervals.filter(is_learnt(), failed | (pl.col("outcome") == Outcome.SUCCEEDED.value))
        .group_by("agent", "task")
        .agg(failed.mean().alias("rate"), seconds.filter(failed).sort().mean().alias("failed_s"))
        .filter(pl.col("rate").is_between(0, 1, closed="none"))
    )
    return {(agent, task): (rate, seconds) for agent, task, rate, seconds in rates.iter_rows()}


def _times(fit: Fit, summary: pl.DataFrame) -> dict[AgentTask, TaskTime]:
    observed_of = {(agent, task): (n, mean) for agent, task, n, mean in summary.select(*_OBSERVED).iter_rows()}
    observed = fit.synergies.filter(pl.col("n") > 0)
    rows = {
        (agent, task, other_agent, other_task): (n, synergy, std_err)
        for agent, task, other_agent, other_task, n, synergy, std_err in observed.select(
            "agent", "task", "other_agent", "other_task", "n", "synergy", "std_err"
        ).iter_rows()
    }
    return {key: _time(key, model, *observed_of[key], rows, fit) for key, model in sorted(fit.models.items())}


_OBSERVED: Final = ("agent", "task", "count", "mean_s")

Rows = dict[tuple[str, str, str, str], tuple[int, float | None, float | None]]


def _time(key: AgentTask, model: TaskModel, n: int, mean_s: float, rows: Rows, fit: Fit) -> TaskTime:
    factors = tuple(
        Factor(*other, log_s, rows.get((*key, *other), (0, None, None))[0])
        for other, log_s in sorted(model.log_factors.items())
    )
    sigma = model.log_work.deviation
    covariance = _covariance(key, factors, sigma, n, rows, fit)
    return TaskTime(*key, model.log_work.center, sigma, n, factors, covariance, mean_s)


def _covariance(key: AgentTask, factors: tuple[Factor, ...], sigma: float, n: int, rows: Rows, fit: Fit) -> FloatArray:
    """Return the estimator's covariance where it has one of log parameters, else that of independent ones."""
    names = ("mu", "log_sigma", *((*key, factor.other_agent, factor.other_task) for factor in factors))
    for covariance in fit.covariances:
        if set(covariance.parameters) == set(names) and np.isfinite(covariance.matrix).all():
            order = [covariance.parameters.index(name) for name in names]
            matrix: FloatArray = covariance.matrix[np.ix_(order, order)]
            return matrix
    return np.diag([sigma**2 / max(n, 1), 0.5 / max(n, 1), *_variances(key, factors, rows)])


def _variances(key: AgentTask, factors: tuple[Factor, ...], rows: Rows) -> Iterator[float]:
    """Yield the variance of each log factor by its relative error, 0 where none is known."""
    for factor in factors:
        _, synergy, std_err = rows.get((*key, factor.other_agent, factor.other_task), (0, None, None))
        if synergy is None or std_err is None or synergy <= 0 or not math.isfinite(std_err):
            yield 0.0
        else:
            yield (std_err / synergy) ** 2
