"""Scores of estimators, from logs: what `hrclog score` does, in Python."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import polars as pl

from hrclog.analyzers.prediction.score import Score
from hrclog.analyzers.prediction.score import score as summed_up
from hrclog.analyzers.prediction.settings import SCORED, cross_validate, predict_prequential, predict_static
from hrclog.analyzers.projections.intervals import rebuild
from hrclog.analyzers.synergy.estimators import EstimatorName
from hrclog.analyzers.synergy.outlier_methods import Outliers
from hrclog.log.clocks.correction import NO_CLOCKS, Clocks
from hrclog.log.reader import read_logs
from hrclog.log.runs.where import ALL_RUNS, Where

Paths = str | Path | Iterable[str | Path]


def score(
    logs: Paths,
    test: Paths | None = None,
    *,
    estimators: Sequence[EstimatorName] = SCORED,
    outliers: Outliers = "none",
    folds: int = 5,
    seed: int = 0,
    static: bool = False,
    transfer_deviation: float = 0.0,
    clocks: Clocks = NO_CLOCKS,
    where: Where = ALL_RUNS,
) -> Score:
    """Say how well estimators predict durations and makespans that they have not seen.

    Without `test`, each fold of runs is predicted from the others. With it, test runs are predicted in time order,
    each from all logs and the test runs before it; with `static` from the logs alone.

    Args:
        logs: logs, folders and globs to learn from.
        test: those to predict.
        estimators: names of those to score; the first is compared with the others.
        outliers: which executions they leave out.
        folds: of cross-validation by run.
        seed: of the folds.
        static: do not learn from test runs that have ended.
        transfer_deviation: with `static`, standard deviation of log durations between sessions, if it is known.
        clocks: by agent, how far its clock is ahead, in ns or as a text (+3600s); that is taken off its times.
        where: which runs, by their tags: texts such as participant=P01 or condition!=pilot, or values by key.

    Raises:
        PluginError: an estimator is not known.
        LogReadError: nothing matched, or no file could be read.
        HrclogError: there are too few runs, or a run is on both sides.
    """
    train = _read_intervals(logs, clocks, where)
    if test is None:
        return summed_up(cross_validate(train, folds, seed, estimators, outliers))
    test_intervals = _read_intervals(test, clocks, where)
    if static:
        return summed_up(predict_static(train, test_intervals, estimators, outliers, transfer_deviation))
    return summed_up(predict_prequential(train, test_intervals, estimators, outliers))


def _read_intervals(logs: Paths, clocks: Clocks, where: Where) -> pl.DataFrame:
    paths = [logs] if isinstance(logs, str | Path) else logs
    return rebuild(read_logs(paths, clocks=clocks, where=where).events)[0]
