"""The interface of an estimator: one class that defines how it fits, what it assumes, and how to read its fit."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import ClassVar, NamedTuple

import polars as pl

from hrclog.analyzers.projections.overlaps import PAIR
from hrclog.analyzers.projections.schemas import SYNERGIES
from hrclog.analyzers.synergy.fit import Fit, TaskModel
from hrclog.analyzers.synergy.observations import Observations
from hrclog.analyzers.synergy.outlier_methods import Outliers
from hrclog.analyzers.synergy.pairs import synergy_table
from hrclog.analyzers.synergy.sampled_models import sampled_models
from hrclog.errors import HrclogError


class EstimatorError(HrclogError):
    """An estimator failed, or returned something that is no fit."""

    def __init__(self, estimator: str, found: str, expected: str) -> None:
        super().__init__(f"estimator {estimator!r}: {found}, expected {expected}")


class Coefficient(NamedTuple):
    """What an estimator says of one pair of tasks; NaN where it cannot tell.

    `synergy` is the factor on the mean duration of (agent, task) while (other_agent, other_task) runs; `free` the same
    relative to undisturbed work. Each has a standard error and the ends of a 95 % interval.
    """

    agent: str
    task: str
    other_agent: str
    other_task: str
    synergy: float
    std_err: float = math.nan
    ci_low: float = math.nan
    ci_high: float = math.nan
    free: float = math.nan
    free_std_err: float = math.nan
    free_ci_low: float = math.nan
    free_ci_high: float = math.nan
    identified: bool = True


class Estimator(ABC):
    """Estimates synergies from observations of runs.

    Subclass it, name it, and register it: `hrclog.register_estimator`, the entry-point group `hrclog.estimators`, or
    `--estimator package.module:NAME`. To work with several processes, the class must be importable by its module.

    Attributes:
        name: by which it is chosen; letters, digits, dots, hyphens and underscores.
        summary: one line for lists of estimators.
        assumes: for the report's page of methods, a noun phrase and its sentences.
        caution: a sentence of doubt that the report prints beside its factors; "" for none.
        counts_cut_short: whether executions that did not succeed take part, as cut short.
        conformal: whether predictions widen its models by residuals of held-out runs, so that their intervals hold.
        version: increase it when the same runs give other numbers: knowledge bases then make their statistics anew.
    """

    name: ClassVar[str]
    summary: ClassVar[str] = ""
    assumes: ClassVar[str] = "an estimator that says nothing of its assumptions."
    caution: ClassVar[str] = ""
    counts_cut_short: ClassVar[bool] = False
    conformal: ClassVar[bool] = False
    version: ClassVar[int] = 1

    @abstractmethod
    def fit(self, observations: Observations, outliers: Outliers = "none") -> Fit:
        """Estimate synergies.

        Args:
            observations: what to learn from.
            outliers: name of the method that says what to leave out.
        """

    def for_planning(self, fit: Fit, observations: Observations, outliers: Outliers = "none") -> Fit:  # noqa: ARG002 - for those that need them
        """Return the fit whose models plans are judged by; its table stays.

        Args:
            fit: what `fit` returned.
            observations: what it was made of.
            outliers: as for the fit.
        """
        return fit

    def result(self, observations: Observations, coefficients: Iterable[Coefficient]) -> Fit:
        """Return the fit of an estimator that knows coefficients and nothing else.

        Its models spread as the executions did whose work the coefficients explain.

        Args:
            observations: what was learnt from.
            coefficients: at most one per pair of tasks; pairs without one have no factor.

        Raises:
            EstimatorError: a coefficient is of a task that was not observed, or is no number.
        """
        coefficients = list(coefficients)
        _check_coefficients(self.name, coefficients, observations)
        table = synergy_table(
            observations.executions,
            observations.meetings,
            map(tuple, coefficients),
            self.name,
            cut_short=self.counts_cut_short,
        )
        return Fit(table, sampled_models(observations, table))


def estimate(estimator: Estimator, observations: Observations, outliers: Outliers = "none") -> Fit:
    """Return what an estimator makes of observations, checked.

    Args:
        estimator: of `hrclog.analyzers.synergy.estimators`.
        observations: what to learn from.
        outliers: name of the method that says what to leave out.

    Raises:
        EstimatorError: the estimator raised an error, or returned no fit.
    """
    try:
        fit = estimator.fit(observations, outliers)
    except HrclogError:
        raise
    except (Exception, SystemExit) as error:
        complaint = f"it raised {type(error).__name__}: {error}"
        remedy = "a fit; `hrclog --debug` before the command shows where, or choose another"
        raise EstimatorError(estimator.name, complaint, remedy) from error
    _check_fit(estimator.name, fit)
    return fit


def _check_coefficients(name: str, coefficients: Iterable[Coefficient], observations: Observations) -> None:
    tasks = set(observations.executions.select("agent", "task").rows())
    for coefficient in coefficients:
        for agent, task in (coefficient[:2], coefficient[2:4]):
            if (agent, task) not in tasks:
                raise EstimatorError(name, f"a coefficient of task {task!r} by {agent!r}", "tasks that were observed")
        if not isinstance(coefficient.synergy, int | float):
            raise EstimatorError(name, f"a synergy of {coefficient.synergy!r}", "a number, NaN where it cannot tell")


def _check_fit(name: str, fit: object) -> None:
    if not isinstance(fit, Fit):
        raise EstimatorError(name, f"it returned {type(fit).__name__}", "a Fit, such as `self.result(...)` makes")
    table = fit.synergies
    if not isinstance(table, pl.DataFrame) or table.schema != SYNERGIES:
        columns = dict(table.schema) if isinstance(table, pl.DataFrame) else type(table).__name__
        raise EstimatorError(name, f"its table has {columns}", "the columns of schema SYNERGIES (docs/tables.md)")
    if table.select(PAIR).is_duplicated().any():
        twice = table.filter(table.select(PAIR).is_duplicated()).row(0)[:4]
        raise EstimatorError(name, f"its table has two rows for {twice}", "one per pair of tasks")
    for key, model in fit.models.items():
        if not isinstance(model, TaskModel):
            raise EstimatorError(name, f"its model of {key} is {type(model).__name__}", "a TaskModel")
