"""Put the steps together: logs in, a result out."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

from hrclog.analyzers.projections.diagnostics import impossible_factors, lint
from hrclog.analyzers.projections.durations import durations
from hrclog.analyzers.projections.intervals import rebuild
from hrclog.analyzers.projections.metrics import metrics
from hrclog.analyzers.projections.overlaps import overlaps, pair_overlaps
from hrclog.analyzers.projections.runs import runs
from hrclog.analyzers.result import Analysis
from hrclog.analyzers.synergy.bootstrap import with_bootstrap
from hrclog.analyzers.synergy.estimators import ESTIMATORS, OUTLIERS
from hrclog.analyzers.synergy.observations import observe
from hrclog.analyzers.synergy.outliers import Outliers
from hrclog.errors import HrclogError
from hrclog.log.reader import Logs, read_logs

DEFAULT_ESTIMATOR: Final = next(iter(ESTIMATORS))


def analyze(
    paths: str | Path | Iterable[str | Path],
    estimator: str = DEFAULT_ESTIMATOR,
    outliers: Outliers = "none",
    on_file: Callable[[Path], None] = lambda _: None,
    *,
    bootstrap: int = 0,
    seed: int = 0,
    workers: int = 1,
    on_draws: Callable[[int], None] = lambda _: None,
) -> Analysis:
    """Read logs, folders and globs, and analyse their runs.

    Args:
        paths: what to read.
        estimator: aft, bayes, ols or paper.
        outliers: none or isolation-forest.
        on_file: called after each file, for progress.
        bootstrap: how many times to draw the runs anew for errors and intervals of synergies; 0 keeps the estimator's.
        seed: of those draws.
        workers: processes for them.
        on_draws: told how many further draws are done, for progress.

    Raises:
        HrclogError: the estimator or outlier method is not known.
        LogReadError: nothing matched, or no file could be read.
    """
    _check_choice("estimator", estimator, ESTIMATORS)
    _check_choice("outliers", outliers, OUTLIERS)
    return analyze_logs(
        read_logs([paths] if isinstance(paths, str | Path) else paths, signals=True, on_file=on_file),
        estimator,
        outliers,
        bootstrap=bootstrap,
        seed=seed,
        workers=workers,
        on_draws=on_draws,
    )


def analyze_logs(
    logs: Logs,
    estimator: str = DEFAULT_ESTIMATOR,
    outliers: Outliers = "none",
    *,
    bootstrap: int = 0,
    seed: int = 0,
    workers: int = 1,
    on_draws: Callable[[int], None] = lambda _: None,
) -> Analysis:
    """Analyse what was read; arguments as those of `analyze`."""
    executions, illegal = rebuild(logs.events)
    found = overlaps(executions)
    table = runs(logs.events, executions)
    observations = observe(executions)
    fit = ESTIMATORS[estimator](observations, outliers)
    if bootstrap:
        fit = with_bootstrap(fit, observations, estimator, outliers, bootstrap, seed, workers, on_draws)
    lints = [*lint(logs.events, executions, found, table), *impossible_factors(fit.synergies)]
    return Analysis(
        events=logs.events,
        signals=logs.signals,
        intervals=executions,
        overlaps=found,
        pair_overlaps=pair_overlaps(executions, found),
        durations=durations(executions),
        synergies=fit.synergies,
        runs=table,
        metrics=metrics(executions, logs.events, logs.signals),
        diagnostics=[*logs.diagnostics, *illegal, *lints],
        estimator=estimator,
        outliers=outliers,
        bootstrap=bootstrap,
        observations=observations,
        fit=fit,
        scene=logs.scene,
    )


def _check_choice(what: str, found: str, known: Iterable[str]) -> None:
    if found not in known:
        raise HrclogError(f"{what} is {found!r}, expected one of {', '.join(known)}")
