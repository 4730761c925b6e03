"""`hrclog score`: how well estimators predict what they have not seen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hrclog.analyzers.synergy.estimators import ESTIMATORS, YARDSTICKS, scored
from hrclog.cli.clock_option import clock_option
from hrclog.cli.common import Progress, echo_json, echo_lines, json_option, outliers_option, tell
from hrclog.cli.names import NameOf
from hrclog.cli.where_option import where_option

if TYPE_CHECKING:
    import polars as pl

    from hrclog.analyzers.prediction.score import Score
    from hrclog.analyzers.prediction.settings import Predictions
    from hrclog.analyzers.synergy.outlier_methods import Outliers
    from hrclog.diagnostic import Diagnostic


@click.command(name="score")
@click.argument("logs", nargs=-1, metavar="[LOG...]", type=click.Path())
@click.option(
    "--cv", type=click.IntRange(min=2), metavar="FOLDS", help="Predict each fold of runs from the others. [default: 5]"
)
@click.option(
    "--train", multiple=True, metavar="LOG", type=click.Path(), help="Log or folder to learn from (repeatable)."
)
@click.option("--test", multiple=True, metavar="LOG", type=click.Path(), help="Log or folder to predict (repeatable).")
@click.option("--static", is_flag=True, help="Do not learn from test runs that have ended.")
@click.option(
    "--transfer-deviation",
    type=click.FloatRange(min=0),
    default=0.0,
    help="With --static: standard deviation of log durations between sessions, if you know it.",
)
@click.option("--truth", type=click.Path(path_type=Path), help="truth.json of simulated runs, to compare with.")
@click.option(
    "--estimator",
    "estimators",
    multiple=True,
    type=NameOf(ESTIMATORS, YARDSTICKS),
    help="Estimator to score (repeatable).  [default: all]",
)
@outliers_option
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the folds.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Folder for score.json and all forecasts.")
@clock_option
@where_option
@json_option
def command(
    *,
    logs: tuple[str, ...],
    cv: int | None,
    train: tuple[str, ...],
    test: tuple[str, ...],
    static: bool,
    transfer_deviation: float,
    truth: Path | None,
    estimators: tuple[str, ...],
    outliers: str,
    seed: int,
    output: Path | None,
    clocks: dict[str, int],
    conditions: tuple[str, ...],
    as_json: bool,
) -> int:
    """Score how well estimators predict durations and makespans they have not seen.

    Either LOG..., with folds by run (--cv), or --train and --test: test runs in time order, each predicted from the
    training runs and the test runs before it.

    \b
    Example:
      hrclog score --cv 5 runs/*.mcap
      hrclog score --train monday --test tuesday
    """
    from hrclog.analyzers.prediction.score import score
    from hrclog.analyzers.prediction.settings import SCORED, cross_validate, predict_prequential, predict_static
    from hrclog.cli.score_text import score_text

    _check_usage(logs, cv, train, test, static=static, transfer_deviation=transfer_deviation)
    _check_writable(output)
    names = tuple(dict.fromkeys(estimators)) or SCORED
    true = _true_pairs(truth) if truth else None
    known, findings = _read_sessions(logs or train, clocks, conditions)
    predicting = Progress("predicting", len(names) * ((cv or 5) if logs else 1))
    predictions: Predictions
    if logs:
        predictions = cross_validate(known, cv or 5, seed, names, outliers, predicting)
    else:
        tested, test_findings = _read_sessions(test, clocks, conditions)
        findings += test_findings
        if static:
            predictions = predict_static(known, tested, names, outliers, transfer_deviation, predicting)
        else:
            predictions = predict_prequential(known, tested, names, outliers, predicting)
    predicting.done()
    result = score(predictions)
    if true is not None:
        result = replace(result, truth=_against_truth(known, true, names, outliers))
    if output:
        _save(result, predictions, output)
    if as_json:
        echo_json(result.to_json())
    else:
        echo_lines(score_text(result))
    return tell(findings)


def _check_writable(folder: Path | None) -> None:
    from hrclog.analyzers.output import check_writable

    if folder is not None:
        check_writable(folder)


def _check_usage(
    logs: tuple[str, ...],
    cv: int | None,
    train: tuple[str, ...],
    test: tuple[str, ...],
    *,
    static: bool,
    transfer_deviation: float,
) -> None:
    if bool(logs) == bool(train or test):
        raise click.UsageError("expected either LOG... or both --train and --test")
    if bool(train) != bool(test):
        raise click.UsageError("expected --train and --test together")
    if logs and static:
        raise click.UsageError("--static goes with --train and --test")
    if train and cv:
        raise click.UsageError("--cv goes with LOG..., not with --train and --test")
    if transfer_deviation and not static:
        raise click.UsageError("--transfer-deviation goes with --static")


def _read_sessions(
    paths: tuple[str, ...], clocks: dict[str, int], conditions: tuple[str, ...]
) -> tuple[pl.DataFrame, list[Diagnostic]]:
    from hrclog.analyzers.projections.intervals import rebuild
    from hrclog.log.reader import read_logs

    reading = Progress("reading logs")
    read = read_logs(paths, on_file=reading, clocks=clocks, where=conditions)
    reading.done()
    intervals, illegal = rebuild(read.events)
    return intervals, [*read.diagnostics, *illegal]


def _true_pairs(path: Path) -> pl.DataFrame:
    from hrclog.analyzers.prediction.score_truth import true_pairs
    from hrclog.sim.truth import read_truth

    truth = read_truth(path)
    return true_pairs(
        [(row.agent, row.task, row.mu, row.sigma) for row in truth.tasks],
        [(row.agent, row.task, row.other_agent, row.other_task, row.synergy) for row in truth.synergies],
    )


def _against_truth(
    intervals: pl.DataFrame, truth: pl.DataFrame, names: tuple[str, ...], outliers: Outliers
) -> dict[str, dict[str, Any]]:
    from hrclog.analyzers.prediction.score_truth import pair_errors, truth_figures
    from hrclog.analyzers.synergy.estimator import estimate
    from hrclog.analyzers.synergy.observations import observe

    observations = observe(intervals)
    fits = {name: estimate(scored(name), observations, outliers) for name in names}
    return {name: truth_figures(pair_errors(fit, observations, truth)) for name, fit in fits.items()}


def _save(result: Score, predictions: Predictions, folder: Path) -> None:
    from hrclog.file_sets import replaced_set
    from hrclog.files import write_whole
    from hrclog.frame_files import write_by

    with replaced_set(folder, "score", keeps=True) as new:
        write_by(predictions.executions.write_parquet, new / "forecasts.parquet")
        write_by(predictions.makespans.write_parquet, new / "makespans.parquet")
        write_whole(new / "score.json", f"{result.to_json()}\n".encode())
