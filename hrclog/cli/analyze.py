"""`hrclog analyze`: the main job."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from hrclog.cli.common import Progress, json_option, logs_argument, number, table, tell

if TYPE_CHECKING:
    from hrclog.analyzers.analysis import Analysis

_MOST_ROWS = 40


@click.command(name="analyze")
@logs_argument
@click.option("-o", "--output", default="hrclog-out", show_default=True, type=click.Path(path_type=Path), help="Folder for the results.")
@click.option("--estimator", type=click.Choice(["ols", "paper"]), default="ols", show_default=True, help="How synergies are estimated.")
@click.option("--outliers", type=click.Choice(["none", "isolation-forest"]), default="none", show_default=True, help="Which rows of a regression are left out.")
@json_option
def command(logs: tuple[str, ...], output: Path, estimator: str, outliers: str, as_json: bool) -> int:  # noqa: FBT001 - click passes flags by name
    """Rebuild what happened in recorded runs and estimate durations, overlaps and synergies.

    LOG is a log, a folder of logs, a glob or a ROS bag. Tables go to standard output; JSON, Parquet and Rerun
    recordings into the output folder.

    \b
    Example:
      hrclog analyze runs/*.mcap -o results
    """  # noqa: D301 - click's \b keeps the line breaks
    from hrclog.analyzers.analysis import analyze
    from hrclog.analyzers.output import check_writable, save

    check_writable(output)
    reading = Progress("reading logs")
    analysis = analyze(logs, estimator, outliers, reading)  # type: ignore[arg-type]  # click.Choice keeps to the literals
    reading.done()
    drawing = Progress("drawing runs", analysis.runs.height + 1)
    save(analysis, output, drawing)
    drawing.done()
    click.echo(analysis.to_json() if as_json else summary(analysis, output))
    return tell(analysis.diagnostics)


def summary(analysis: Analysis, output: Path) -> str:
    """Return the tables that a person reads first."""
    parts = [_headline(analysis), _durations(analysis), _synergies(analysis)]
    parts.append(f"Written to {output}: analysis.json, *.parquet, analysis.rrd, runs/*.rrd\nLook at it: hrclog view {output}")
    return "\n\n".join(part for part in parts if part)


def _headline(analysis: Analysis) -> str:
    runs = analysis.runs
    agents = runs["agents"].explode(empty_as_null=False).unique().sort().to_list()
    makespans = runs["makespan_s"].drop_nulls()
    text = f"{runs.height} runs, {analysis.intervals.height} executions, agents: {', '.join(agents) or 'none'}"
    if len(makespans) > 1:
        text += f"\nmakespan {makespans.mean():.1f} s +- {makespans.std():.1f} (sample standard deviation, n = {len(makespans)})"
    elif len(makespans):
        text += f"\nmakespan {makespans[0]:.1f} s (n = 1)"
    return text


def _durations(analysis: Analysis) -> str:
    if analysis.durations.is_empty():
        return ""
    rows = [
        (row["agent"], row["task"], number(row["mean_s"]), number(row["std_s"]), number(row["median_s"]),
         number(row["min_s"]), number(row["max_s"]), str(row["count"]), str(row["n_failed"]), str(row["n_censored"]))
        for row in analysis.durations.head(_MOST_ROWS).iter_rows(named=True)
    ]
    header = ("agent", "task", "mean", "std", "median", "min", "max", "n", "failed", "open")
    return "Durations in s (of executions that succeeded)\n" + table(header, rows, lambda i: i > 1) + _more(analysis.durations.height)


def _synergies(analysis: Analysis) -> str:
    if analysis.synergies.is_empty():
        return ""
    seen = analysis.synergies.filter(analysis.synergies["n"] > 0)
    rows = [
        (f"{row['agent']}: {row['task']}", f"{row['other_agent']}: {row['other_task']}", number(row["synergy"]),
         f"[{number(row['ci_low'])}, {number(row['ci_high'])}]", str(row["n"]), number(row["overlap_s"], 1), row["status"])
        for row in seen.head(_MOST_ROWS).iter_rows(named=True)
    ]
    unobserved = analysis.synergies.height - seen.height
    title = f"Synergies by {analysis.estimator}: factor on a task's duration while another agent's task runs (> 1 is slower)"
    note = f"\n{unobserved} pairs of tasks never overlapped: not observed" if unobserved else ""
    header = ("task", "while", "factor", "95 % interval", "n", "overlap s", "status")
    return f"{title}\n{table(header, rows, lambda i: 1 < i < 6)}{_more(seen.height)}{note}"


def _more(height: int) -> str:
    return f"\n... and {height - _MOST_ROWS} more rows, see analysis.json" if height > _MOST_ROWS else ""
