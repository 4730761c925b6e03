"""`hrclog analyze`: the main job."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hrclog.cli.common import Progress, json_option, logs_argument, tell

if TYPE_CHECKING:
    from hrclog.analyzers.analysis import Analysis


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
@click.option(
    "--estimator",
    type=click.Choice(["ols", "paper"]),
    default="ols",
    show_default=True,
    help="How synergies are estimated.",
)
@click.option(
    "--outliers",
    type=click.Choice(["none", "isolation-forest"]),
    default="none",
    show_default=True,
    help="Which rows of a regression are left out.",
)
@json_option
def command(logs: tuple[str, ...], output: Path, estimator: str, outliers: str, as_json: bool) -> int:  # noqa: FBT001 - click passes flags by name
    """Rebuild what happened in recorded runs and estimate durations, overlaps and synergies.

    LOG is a log, a folder of logs, a glob or a ROS bag. Tables go to standard output; JSON, Parquet and Rerun
    recordings into the output folder.

    \b
    Example:
      hrclog analyze runs/*.mcap -o results
    """  # noqa: D301 - click's \b keeps the line breaks
    analysis = analyse(logs, output, estimator, outliers, as_json=as_json)
    return tell(analysis.diagnostics)


def analyse(
    logs: Sequence[str | Path], output: Path, estimator: str = "ols", outliers: str = "none", *, as_json: bool = False
) -> Analysis:
    """Analyse logs, write everything to a folder and print the result."""
    from hrclog.analyzers.analysis import analyze
    from hrclog.analyzers.output import check_writable, save
    from hrclog.cli.summary import summary

    check_writable(output)
    reading = Progress("reading logs")
    analysis = analyze(logs, estimator, outliers, reading)  # type: ignore[arg-type]  # click.Choice keeps to the literals
    reading.done()
    drawing = Progress("drawing runs", analysis.runs.height + 1)
    save(analysis, output, drawing)
    drawing.done()
    click.echo(analysis.to_json() if as_json else summary(analysis, output))
    return analysis
