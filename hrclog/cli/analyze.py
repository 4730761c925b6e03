"""`hrclog analyze`: the main job."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hrclog.cli.common import (
    Progress,
    bootstrap_options,
    estimator_option,
    json_option,
    logs_argument,
    outliers_option,
    tell,
)

if TYPE_CHECKING:
    from hrclog.analyzers.analysis import Analysis
    from hrclog.analyzers.synergy.outliers import Outliers


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
@json_option
def command(
    logs: tuple[str, ...],
    output: Path,
    estimator: str,
    outliers: str,
    bootstrap: int,
    seed: int,
    workers: int,
    as_json: bool,  # noqa: FBT001 - click passes flags by name
) -> int:
    """Rebuild what happened in recorded runs and estimate durations, overlaps and synergies.

    LOG is a log, a folder of logs, a glob or a ROS bag. Tables go to standard output; JSON, Parquet and Rerun
    recordings into the output folder.

    \b
    Example:
      hrclog analyze runs/*.mcap -o results
    """  # noqa: D301 - click's \b keeps the line breaks
    analysis = analyse(
        logs, output, estimator, outliers, bootstrap=bootstrap, seed=seed, workers=workers, as_json=as_json
    )
    return tell(analysis.diagnostics)


def analyse(
    logs: Sequence[str | Path],
    output: Path,
    estimator: str = "aft",
    outliers: str = "none",
    *,
    bootstrap: int = 0,
    seed: int = 0,
    workers: int = 1,
    as_json: bool = False,
) -> Analysis:
    """Analyse logs, write everything to a folder and print the result."""
    from hrclog.analyzers.analysis import analyze
    from hrclog.analyzers.output import check_writable, save
    from hrclog.cli.summary import summary

    check_writable(output)
    reading = Progress("reading logs")
    kept: Outliers = "isolation-forest" if outliers == "isolation-forest" else "none"
    draws = Progress("drawing runs anew", bootstrap)
    analysis = analyze(
        logs,
        estimator,
        kept,
        reading,
        bootstrap=bootstrap,
        seed=seed,
        workers=workers,
        on_draws=draws.advance,
    )
    draws.done()
    reading.done()
    drawing = Progress("drawing runs", analysis.runs.height + 1)
    save(analysis, output, drawing)
    drawing.done()
    click.echo(analysis.to_json() if as_json else summary(analysis, output))
    return analysis
