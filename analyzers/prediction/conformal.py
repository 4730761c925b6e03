"""Prediction widths that hold within a session, from the residuals of executions whose run was held out of the fit.

Conformal prediction (Vovk, Gammerman and Shafer 2005) with cross-validated residuals by run (Barber et al. 2021).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from hrclog.analyzers.prediction.folds import folds
from hrclog.analyzers.projections.joint_states import AgentTask
from hrclog.analyzers.synergy.estimator import Estimator, estimate
from hrclog.analyzers.synergy.exposures import exposures
from hrclog.analyzers.synergy.fit import Fit
from hrclog.analyzers.synergy.log_work import SampledLogWork
from hrclog.analyzers.synergy.observations import Observations
from hrclog.analyzers.synergy.outlier_methods import Outliers
from hrclog.arrays import FloatArray

FOLDS: Final = 5
FEWEST: Final = 19
"""With fewer residuals their 95 % quantile is not that of a new draw, and a task keeps the fitted distribution."""

_SEED: Final = 0


def conformal(estimator: Estimator, fit: Fit, observations: Observations, outliers: Outliers = "none") -> Fit:
    """Return a fit whose models spread like residuals of runs that were held out.

    Args:
        estimator: what made the fit.
        fit: of all observations.
        observations: what it was fitted to.
        outliers: as for the fit.
    """
    residuals = held_out_residuals(estimator, observations, outliers)
    models = dict(fit.models)
    for key, model in fit.models.items():
        task_residuals = residuals.get(key)
        if task_residuals is not None and len(task_residuals) >= FEWEST:
            models[key] = replace(
                model, log_work=SampledLogWork(model.log_work.center + task_residuals, conformal=True)
            )
    return replace(fit, models=models)


def held_out_residuals(
    estimator: Estimator, observations: Observations, outliers: Outliers = "none"
) -> dict[AgentTask, FloatArray]:
    """Return log W - mu of each task's successful executions, both from a fit without their run."""
    residuals: dict[AgentTask, list[FloatArray]] = {}
    for held_out in folds(observations.runs, FOLDS, _SEED):
        models = estimate(estimator, observations.without(held_out), outliers).models
        for data in exposures(observations.only(held_out)):
            model = models.get(data.key)
            if model is not None and data.finished.any():
                log_work = np.log(data.work(data.log_factors(model.log_factors))[data.finished])
                residuals.setdefault(data.key, []).append(log_work - model.log_work.center)
    return {key: np.sort(np.concatenate(parts)) for key, parts in residuals.items()}
