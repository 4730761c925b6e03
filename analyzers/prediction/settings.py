"""Predict runs in one of three settings, which are never mixed.

    cv           folds by run: each is predicted from the others
    static       test runs are predicted from training runs, once and for all
    prequential  test runs in time order, each predicted from training runs and earlier test runs

A duration is predicted from its start and from what the others do, a run's makespan from the order of each agent's
tasks; of the run itself nothing else is used.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np
import polars as pl

from hrclog.analyzers.learning.learn import gaps
from hrclog.analyzers.prediction.conformal import conformal
from hrclog.analyzers.prediction.folds import folds
from hrclog.analyzers.prediction.held_out import FORECASTS, MAKESPANS, HeldOut
from hrclog.analyzers.prediction.plan_cells import plan_cells
from hrclog.analyzers.prediction.residuals import Learning, Observed, Session
from hrclog.analyzers.projections.joint_states import AgentTask
from hrclog.analyzers.synergy.estimator import estimate
from hrclog.analyzers.synergy.estimators import ESTIMATORS, YARDSTICKS, scored
from hrclog.analyzers.synergy.fit import TaskModel
from hrclog.analyzers.synergy.log_work import SampledLogWork, widened
from hrclog.analyzers.synergy.observations import Observations, observe
from hrclog.analyzers.synergy.outlier_methods import Outliers
from hrclog.errors import HrclogError
from hrclog.wording import counted

Setting = Literal["cv", "static", "prequential"]
OnStep = Callable[[], None]

SCORED: Final = (*ESTIMATORS.builtins, *YARDSTICKS.builtins)
"""The estimators that are scored when none are named."""

WIDEST_TRANSFER: Final = 10.0
_GAPS_KEPT: Final = 0.95  # of what is known about gaps, from run to run


@dataclass(frozen=True, slots=True)
class Predictions:
    """What was predicted, and what happened.

    Attributes:
        setting: how.
        executions: schema `FORECASTS`, in order of estimator, run in time, start.
        makespans: schema `MAKESPANS`, in order of estimator and run in time.
        runs: ids of the test runs, in time order.
        n_train_runs: what was learnt from before the first test run; with cv that of the largest fold.
        n_executions: how many there were to predict.
        calibrated: the estimators whose intervals are made to hold what they say.
    """

    setting: Setting
    executions: pl.DataFrame
    makespans: pl.DataFrame
    runs: list[str]
    n_train_runs: int
    n_executions: int
    calibrated: tuple[str, ...]


@dataclass(slots=True)
class _Rows:
    executions: list[tuple[Any, ...]]
    makespans: list[tuple[Any, ...]]


def cross_validate(
    intervals: pl.DataFrame,
    count: int = 5,
    seed: int = 0,
    estimators: Sequence[str] = SCORED,
    outliers: Outliers = "none",
    on_step: OnStep = lambda: None,
) -> Predictions:
    """Predict each fold of runs from the others.

    Args:
        intervals: a frame of schema `INTERVALS`.
        count: how many folds; with fewer runs, as many as there are.
        seed: of the folds.
        estimators: which to use.
        outliers: which executions they leave out.
        on_step: called after each fold and estimator, for progress.

    Raises:
        HrclogError: there are fewer than two runs, or folds.
    """
    runs = intervals["run_id"].unique().to_list()
    if min(count, len(runs)) < 2:
        raise HrclogError(
            f"cross-validation by run: found {counted(len(runs), 'run')} and {counted(count, 'fold')}, expected at "
            "least 2 of either; give more runs, or predict some from others with --train and --test"
        )
    observations, held_out = observe(intervals), HeldOut(intervals)
    parts = folds(runs, count, seed)
    rows = _Rows([], [])
    calibrated = {name: scored(name).conformal for name in estimators}
    for part in parts:
        gaps_s = _mean_gaps_s(intervals.filter(~pl.col("run_id").is_in(part)))
        train = observations.without(part)
        for name in estimators:
            fitted = models(train, name, outliers)
            calibrated[name] &= all(isinstance(model.log_work, SampledLogWork) for model in fitted.values())
            _predict(rows, held_out, part, name, fitted, gaps_s)
            on_step()
    n_train = len(runs) - max(len(part) for part in parts)
    calibrated_names = tuple(name for name, widened_all in calibrated.items() if widened_all)
    return _predictions("cv", rows, held_out, estimators, n_train, calibrated_names)


def predict_static(
    train: pl.DataFrame,
    test: pl.DataFrame,
    estimators: Sequence[str] = SCORED,
    outliers: Outliers = "none",
    transfer_deviation: float = 0.0,
    on_step: OnStep = lambda: None,
) -> Predictions:
    """Predict test runs from training runs, once and for all.

    How far one session is from another cannot be learnt from one of them, so these intervals promise nothing.

    Args:
        train: a frame of schema `INTERVALS`.
        test: another, of other runs.
        estimators: which to use.
        outliers: which executions they leave out.
        transfer_deviation: standard deviation of log durations between sessions, if it is known; at most 10.
        on_step: called after each estimator, for progress.

    Raises:
        HrclogError: a run is on both sides, or a side has none; or the deviation is out of range.
    """
    if not 0 <= transfer_deviation <= WIDEST_TRANSFER:
        raise HrclogError(
            f"transfer deviation: found {transfer_deviation}, expected 0 to {WIDEST_TRANSFER}: it is that of the"
            " logarithm of durations, so 0.1 is about 10 %"
        )
    _check_apart(train, test)
    observations, held_out, gaps_s = observe(train), HeldOut(test), _mean_gaps_s(train)
    rows = _Rows([], [])
    for name in estimators:
        fitted = {
            key: replace(model, log_work=widened(model.log_work, transfer_deviation))
            for key, model in models(observations, name, outliers).items()
        }
        _predict(rows, held_out, held_out.runs, name, fitted, gaps_s)
        on_step()
    return _predictions("static", rows, held_out, estimators, train["run_id"].n_unique(), ())


def predict_prequential(
    train: pl.DataFrame,
    test: pl.DataFrame,
    estimators: Sequence[str] = SCORED,
    outliers: Outliers = "none",
    on_step: OnStep = lambda: None,
    learning: Learning | None = None,
    cells_of: Callable[[pl.DataFrame], pl.DataFrame] = plan_cells,
) -> Predictions:
    """Predict test runs in time order, each from the training runs and the test runs before it.

    Factors stay those of the training runs; how log work is distributed follows the session (`Session`).

    Args:
        train: a frame of schema `INTERVALS`.
        test: another, of other runs.
        estimators: which to use.
        outliers: which executions they leave out.
        on_step: called after each estimator, for progress.
        learning: how the session is learnt.
        cells_of: which executions stand at the same place of the same plan.

    Raises:
        HrclogError: a run is on both sides, or a side has none.
    """
    _check_apart(train, test)
    observations, held_out, gaps_s = observe(train), HeldOut(test, cells_of), _mean_gaps_s(train)
    gaps_of = {str(run): _mean_gaps_s(part) for (run,), part in test.group_by("run_id")}
    rows = _Rows([], [])
    for name in estimators:
        fitted = models(observations, name, outliers)
        session = Session({key: model.log_work for key, model in fitted.items()}, learning)
        _predict_in_order(rows, held_out, name, fitted, session, gaps_s, gaps_of)
        on_step()
    return _predictions(
        "prequential", rows, held_out, estimators, train["run_id"].n_unique(), tuple(dict.fromkeys(estimators))
    )


def models(observations: Observations, estimator: str, outliers: Outliers = "none") -> dict[AgentTask, TaskModel]:
    """Return an estimator's models, with conformal widths where it asks for them.

    Args:
        observations: what to learn from.
        estimator: its name.
        outliers: which executions it leaves out.
    """
    chosen_estimator = scored(estimator)
    fit = estimate(chosen_estimator, observations, outliers)
    return (conformal(chosen_estimator, fit, observations, outliers) if chosen_estimator.conformal else fit).models


def _predict(
    rows: _Rows,
    held_out: HeldOut,
    runs: Sequence[str],
    name: str,
    fitted: Mapping[AgentTask, TaskModel],
    gaps_s: Mapping[str, float],
) -> None:
    def model_of(key: AgentTask, _cell: str) -> TaskModel | None:
        return fitted.get(key)

    for run in runs:
        rows.executions += held_out.forecasts(name, run, model_of)
        rows.makespans += held_out.makespan(name, run, model_of, gaps_s)


def _predict_in_order(
    rows: _Rows,
    held_out: HeldOut,
    name: str,
    fitted: Mapping[AgentTask, TaskModel],
    session: Session,
    gaps_s: Mapping[str, float],
    gaps_of: Mapping[str, Mapping[str, float]],
) -> None:
    means_s = dict(gaps_s)

    def model_of(key: AgentTask, cell: str) -> TaskModel | None:
        model = fitted.get(key)
        return replace(model, log_work=session.predict(key, cell)) if model else None

    for run in held_out.runs:
        rows.executions += held_out.forecasts(name, run, model_of)
        rows.makespans += held_out.makespan(name, run, model_of, means_s)
        session.learn(_observe_run(held_out, run, fitted))
        for agent, gap_s in gaps_of[run].items():
            means_s[agent] = _GAPS_KEPT * means_s.get(agent, gap_s) + (1 - _GAPS_KEPT) * gap_s


def _observe_run(held_out: HeldOut, run: str, fitted: Mapping[AgentTask, TaskModel]) -> Iterator[Observed]:
    for row, _, agent, task, _, cell, duration_s in held_out.of(run).iter_rows():
        model = fitted.get((agent, task))
        if model:
            work = held_out.timelines.along(row, model.log_factors).work_after(duration_s)
            yield Observed((agent, task), cell, float(np.log(work)))


def _mean_gaps_s(intervals: pl.DataFrame) -> dict[str, float]:
    return {agent: gap.mean_s for agent, gap in gaps(intervals).items()}


def _predictions(
    setting: Setting,
    rows: _Rows,
    held_out: HeldOut,
    estimators: Sequence[str],
    n_train_runs: int,
    calibrated: tuple[str, ...],
) -> Predictions:
    order = pl.DataFrame({"run_id": held_out.runs}, schema={"run_id": pl.String}).with_row_index("run_order")
    names = pl.DataFrame({"estimator": list(dict.fromkeys(estimators))}).with_row_index("name_order")

    def ordered(tuples: list[tuple[Any, ...]], schema: pl.Schema) -> pl.DataFrame:
        frame = pl.DataFrame(tuples, schema=schema, orient="row").join(order, on="run_id", maintain_order="left")
        frame = frame.join(names, on="estimator", maintain_order="left")
        return frame.sort("name_order", "run_order", maintain_order=True).select(schema.names())

    return Predictions(
        setting,
        ordered(rows.executions, FORECASTS),
        ordered(rows.makespans, MAKESPANS),
        held_out.runs,
        n_train_runs,
        held_out.executions.height,
        calibrated,
    )


def _check_apart(train: pl.DataFrame, test: pl.DataFrame) -> None:
    for name, side in (("training", train), ("test", test)):
        if side.is_empty():
            raise HrclogError(f"the {name} runs hold no executions, expected at least one; look at them: hrclog info")
    both = sorted(set(train["run_id"].unique()) & set(test["run_id"].unique()))
    if both:
        raise HrclogError(
            f"{counted(len(both), 'run is', 'runs are')} among both the training and the test runs, the first is "
            f"{both[0]!r}; expected different ones, for what was learnt from predicts itself too well"
        )
