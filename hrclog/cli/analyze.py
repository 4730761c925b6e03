"""`hrclog analyze`: the main job."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hrclog.analyzers.synergy.estimators import ESTIMATORS
from hrclog.analyzers.synergy.outlier_methods import OUTLIER_METHODS
from hrclog.cli.clock_option import clock_option
from hrclog.cli.common import (
    Progress,
    bootstrap_options,
    echo_json,
    echo_lines,
    estimator_option,
    json_option,
    logs_argument,
    outliers_option,
    tell,
)
from hrclog.cli.where_option import where_option

if TYPE_CHECKING:
    from hrclog.analyzers.result import Analysis
    from hrclog.log.clocks.correction import Clocks
    from hrclog.log.runs.where import Where


def _recordings(_: click.Context, __: click.Parameter, value: str) -> int | None:
    if value == "all":
        return None
    if not value.isdecimal():
        raise click.BadParameter(f"found {value!r}, expected a whole number or all")
    return int(value)


@click.command(name="analyze")
@logs_argument
@click.option(
    "-o",
    "--output",
    default="hrclog-out",
    show_default=True,
    type=click.Path(path_type=Path),
    help="Folder for the results.",
)
@estimator_option
@outliers_option
@bootstrap_options(0)
@click.option(
    "--recordings",
    default="200",
    show_default=True,
    metavar="N|all",
    callback=_recordings,
    help="How many runs to draw one by one; beyond it they are taken evenly spread.",
)
@clock_option
@where_option
@json_option
def command(
    logs: tuple[str, ...],
    output: Path,
    estimator: str,
    outliers: str,
    bootstrap: int,
    seed: int,
    workers: int,
    recordings: int | None,
    clocks: dict[str, int],
    conditions: tuple[str, ...],
    as_json: bool,
) -> int:
    """Rebuild what happened in recorded runs and estimate durations, overlaps and synergies.

    LOG is a log, a folder of logs, a glob or a ROS bag. Tables go to standard output; JSON, Parquet and Rerun
    recordings into the output folder.

    \b
    Example:
      hrclog analyze runs/*.mcap -o results
    """
    analysis = analyse(
        logs,
        output,
        estimator,
        outliers,
        bootstrap=bootstrap,
        seed=seed,
        workers=workers,
        recordings=recordings,
        clocks=clocks,
        where=conditions,
        as_json=as_json,
    )
    return tell(analysis.diagnostics)


def analyse(
    logs: Sequence[str | Path],
    output: Path,
    estimator: str = ESTIMATORS.default,
    outliers: str = OUTLIER_METHODS.default,
    *,
    bootstrap: int = 0,
    seed: int = 0,
    workers: int = 1,
    recordings: int | None = 200,
    clocks: Clocks | None = None,
    where: Where = (),
    as_json: bool = False,
) -> Analysis:
    """Analyse logs, write everything to a folder and print the result."""
    from hrclog.analyzers.analysis import analyze
    from hrclog.analyzers.output import check_writable, drawn_runs, save
    from hrclog.cli.summary import summary

    check_writable(output)
    reading = Progress("reading logs")
    draws = Progress("drawing runs anew", bootstrap)
    analysis = analyze(
        logs,
        estimator,
        outliers,
        reading,
        bootstrap=bootstrap,
        seed=seed,
        workers=workers,
        on_draws=draws.advance,
        clocks=clocks or {},
        where=where,
    )
    draws.done()
    reading.done()
    drawn = len(drawn_runs(analysis.runs, recordings))
    drawing = Progress("drawing runs", drawn + 1)
    save(analysis, output, drawing, recordings)
    drawing.done()
    if as_json:
        echo_json(analysis.to_json())
    else:
        echo_lines(summary(analysis, output, drawn))
    return analysis
