"""Run all steps of an analysis, from logs to a result."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from hrclog.analyzers.projections.durations import durations
from hrclog.analyzers.projections.intervals import rebuild
from hrclog.analyzers.projections.lints.impossible_factors import impossible_factors
from hrclog.analyzers.projections.lints.lints import lint
from hrclog.analyzers.projections.metrics import metrics
from hrclog.analyzers.projections.overlaps import overlaps, pair_overlaps
from hrclog.analyzers.projections.runs import runs
from hrclog.analyzers.result import Analysis
from hrclog.analyzers.synergy.bootstrap import with_bootstrap
from hrclog.analyzers.synergy.estimator import estimate
from hrclog.analyzers.synergy.estimators import DEFAULT_ESTIMATOR, ESTIMATORS, EstimatorName
from hrclog.analyzers.synergy.observations import observe
from hrclog.analyzers.synergy.outlier_methods import OUTLIER_METHODS, Outliers
from hrclog.log.clocks.correction import NO_CLOCKS, Clocks
from hrclog.log.logs import Logs
from hrclog.log.reader import read_logs
from hrclog.log.runs.where import ALL_RUNS, Where
from hrclog.log.selected import only_runs


def analyze(
    paths: str | Path | Iterable[str | Path] | Logs,
    estimator: EstimatorName = DEFAULT_ESTIMATOR,
    outliers: Outliers = "none",
    on_file: Callable[[Path], None] = lambda _: None,
    *,
    bootstrap: int = 0,
    seed: int = 0,
    workers: int = 1,
    on_draws: Callable[[int], None] = lambda _: None,
    clocks: Clocks = NO_CLOCKS,
    where: Where = ALL_RUNS,
) -> Analysis:
    """Read logs, folders and globs, and analyse their runs.

    Args:
        paths: what to read; or runs that were read, or made by `hrclog.from_table`.
        estimator: aft, bayes, ols or paper, one that was registered, or `package.module:NAME`.
        outliers: none or isolation-forest.
        on_file: called after each file, for progress.
        bootstrap: how often to resample the runs for errors and intervals of synergies; 0 keeps the estimator's.
        seed: of the resampling.
        workers: processes for the resampling.
        on_draws: called with the number of further draws done, for progress.
        clocks: by agent, how far its clock is ahead, in ns or as a text (+3600s); that is taken off its times.
        where: which runs, by their tags: texts such as participant=P01 or condition!=pilot, or values by key.

    Raises:
        PluginError: the estimator or outlier method is not known.
        EstimatorError: the estimator failed, or returned no fit.
        LogReadError: nothing matched, or no file could be read.
        HrclogError: no event names an agent of `clocks`, or an offset is none; or no run is as `where` says.
    """
    names = _check_names(estimator, outliers)  # before the logs are read
    return analyze_logs(
        only_runs(paths, where) if isinstance(paths, Logs) else _read(paths, on_file, clocks, where),
        *names,
        bootstrap=bootstrap,
        seed=seed,
        workers=workers,
        on_draws=on_draws,
    )


def _read(
    paths: str | Path | Iterable[str | Path], on_file: Callable[[Path], None], clocks: Clocks, where: Where
) -> Logs:
    listed = [paths] if isinstance(paths, str | Path) else paths
    return read_logs(listed, signals=True, on_file=on_file, clocks=clocks, where=where)


def analyze_logs(
    logs: Logs,
    estimator: EstimatorName = DEFAULT_ESTIMATOR,
    outliers: Outliers = "none",
    *,
    bootstrap: int = 0,
    seed: int = 0,
    workers: int = 1,
    on_draws: Callable[[int], None] = lambda _: None,
) -> Analysis:
    """Analyse logs that were read; the arguments are those of `analyze`."""
    executions, illegal = rebuild(logs.events)
    overlap_rows = overlaps(executions)
    table = runs(logs.events, executions)
    observations = observe(executions)
    chosen_estimator = ESTIMATORS[estimator]
    fit = estimate(chosen_estimator, observations, outliers)
    if bootstrap:
        fit = with_bootstrap(fit, observations, chosen_estimator, outliers, bootstrap, seed, workers, on_draws)
    lints = [*lint(logs.events, executions, overlap_rows, table), *impossible_factors(fit.synergies)]
    return Analysis(
        events=logs.events,
        signals=logs.signals,
        intervals=executions,
        overlaps=overlap_rows,
        pair_overlaps=pair_overlaps(executions, overlap_rows),
        durations=durations(executions),
        synergies=fit.synergies,
        runs=table,
        metrics=metrics(executions, logs.events, logs.signals),
        diagnostics=[*logs.diagnostics, *illegal, *lints],
        estimator=chosen_estimator.name,
        outliers=outliers,
        bootstrap=bootstrap,
        observations=observations,
        fit=fit,
        scene=logs.scene,
        exclusions=logs.exclusions,
    )


def _check_names(estimator: str, outliers: str) -> tuple[str, str]:
    """Return the names under which an estimator and an outlier method are known.

    Raises:
        PluginError: one of them is not.
    """
    return ESTIMATORS[estimator].name, OUTLIER_METHODS[outliers].name
