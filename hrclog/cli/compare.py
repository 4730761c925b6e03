"""`hrclog compare`: two sets of runs and how they differ."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from hrclog.cli.clock_option import clock_option
from hrclog.cli.common import (
    Progress,
    bootstrap_options,
    echo_json,
    echo_lines,
    estimator_option,
    json_option,
    number,
    outliers_option,
    printable,
    table,
    tell,
)
from hrclog.cli.where_option import where_option, where_options
from hrclog.wording import counted

if TYPE_CHECKING:
    import polars as pl

    from hrclog.analyzers.comparison.compare import Comparison, Side
    from hrclog.analyzers.result import Analysis

JSON_NAME: Final = "compare.json"

_MOST_ROWS: Final = 40

Row = dict[str, Any]


@click.command(name="compare")
@click.argument("sides", nargs=-1, required=True, metavar="A B", type=click.Path())
@click.option("-o", "--output", type=click.Path(path_type=Path), help=f"Folder for {JSON_NAME}.  [default: none]")
@estimator_option
@outliers_option
@bootstrap_options(200)
@clock_option
@where_option
@where_options("--where-a", "conditions_a", "Of A read only runs whose tags are so. Repeatable.")
@where_options("--where-b", "conditions_b", "Of B read only runs whose tags are so. Repeatable.")
@json_option
def command(
    sides: tuple[str, ...],
    output: Path | None,
    estimator: str,
    outliers: str,
    bootstrap: int,
    seed: int,
    workers: int,
    clocks: dict[str, int],
    conditions: tuple[str, ...],
    conditions_a: tuple[str, ...],
    conditions_b: tuple[str, ...],
    as_json: bool,
) -> int:
    """Compare two sets of runs: planners, days, safety settings.

    A and B are each a log, a folder of logs or a glob in quotes. Differences are B - A, ratios B / A, with 95 %
    intervals from whole runs drawn with repetition. With --where-a and --where-b one argument does: the runs of both
    are told apart by their tags. The columns are described in docs/compare.md.

    \b
    Example:
      hrclog compare 'runs/baseline_*.mcap' 'runs/synergistic_*.mcap'
      hrclog compare runs --where-a condition=baseline --where-b condition=synergy
    """
    from hrclog.analyzers.analysis import analyze
    from hrclog.analyzers.comparison.compare import compare
    from hrclog.analyzers.output import check_finished, check_writable

    if len(sides) == 1 and conditions_a and conditions_b:
        sides = sides * 2
    if len(sides) != 2:
        raise click.UsageError(f"found {len(sides)} arguments, expected A and B; put a glob in quotes: 'runs/a_*.mcap'")
    for side in sides:
        check_finished(side)
    if output is not None:
        check_writable(output)
    reading = Progress("reading logs")
    wanted = ((*conditions, *conditions_a), (*conditions, *conditions_b))
    a, b = (
        analyze(side, estimator, outliers, reading, clocks=clocks, where=where)
        for side, where in zip(sides, wanted, strict=True)
    )
    reading.done()
    drawing = Progress("drawing runs anew", 2 * bootstrap)
    comparison = compare(a, b, bootstrap=bootstrap, seed=seed, workers=workers, on_draws=drawing.advance)
    drawing.done()
    if output is not None:
        _save(comparison, output)
    if as_json:
        echo_json(comparison.to_json())
    else:
        names = tuple(map(_side_name, sides, (conditions_a, conditions_b)))
        echo_lines(_summary(comparison, names, (a, b)))
    return tell(comparison.diagnostics)


def _save(comparison: Comparison, folder: Path) -> None:
    from hrclog.files import write_output

    write_output(folder / JSON_NAME, f"{comparison.to_json()}\n".encode(), makes_folder=True)


def _side_name(side: str, wanted: tuple[str, ...]) -> str:
    return f"{side} where {', '.join(wanted)}" if wanted else side


def _summary(comparison: Comparison, names: tuple[str, ...], analyses: tuple[Analysis, Analysis]) -> str:
    sides = (comparison.a, comparison.b)
    side_columns = zip("AB", names, sides, analyses, strict=True)
    others = comparison.metrics.filter(comparison.metrics["metric"] != "makespan_s")
    rates = comparison.success_rates
    parts = [
        "\n".join([*(_side_line(*columns) for columns in side_columns), *_makespan(comparison.metrics)]),
        "\n".join(map(printable, comparison.notes)),
        _means("Metrics per run (fractions of the makespan, *_s in seconds; docs/metrics.md)", others, "of", 3),
        _means("Durations in s (of executions that succeeded)", comparison.durations, "task"),
        # omit tasks that never failed
        _means("Success rates", rates.filter((rates["mean_a"] < 1) | (rates["mean_b"] < 1)), "task"),
        _means("Plan and reality in s", comparison.plan, "agent"),
        _synergies(comparison),
        _caution(comparison),
    ]
    return "\n\n".join(part for part in parts if part)


def _side_line(letter: str, name: str, side: Side, analysis: Analysis) -> str:
    executions = counted(int(analysis.runs["n_executions"].sum()), "execution")
    agents = ", ".join(side.agents)
    return printable(f"{letter}: {name}: {counted(len(side.run_ids), 'run')}, {executions}, agents: {agents}")


def _makespan(metrics: pl.DataFrame) -> list[str]:
    return [
        f"makespan {number(row['mean_a'], 1)} s in A, {number(row['mean_b'], 1)} s in B: "
        f"{_signed(row['difference'], 1)} s, interval {_interval(row, _signed, 1)}, {_percent(row['relative'])}"
        for row in metrics.filter(metrics["metric"] == "makespan_s").iter_rows(named=True)
    ]


def _means(title: str, frame: pl.DataFrame, second: str, digits: int = 2) -> str:
    if frame.is_empty():
        return ""
    first = frame.columns[0]
    rows = [
        (
            row[first],
            row[frame.columns[1]],
            number(row["mean_a"], digits),
            number(row["mean_b"], digits),
            _signed(row["difference"], digits),
            _interval(row, _signed, digits),
            _flag(row["differs"]),
            str(row["n_a"]),
            str(row["n_b"]),
        )
        for row in frame.head(_MOST_ROWS).iter_rows(named=True)
    ]
    header = (first, second, "A", "B", "B - A", "95 % interval", "differs", "n A", "n B")
    return f"{title}\n{table(header, rows, lambda i: i > 1)}{_omitted_note(frame.height)}"


def _synergies(comparison: Comparison) -> str:
    frame = comparison.synergies
    observed = frame.filter((frame["n_a"] > 0) & (frame["n_b"] > 0))
    if frame.is_empty():
        return ""
    rows = [
        (
            f"{row['agent']}: {row['task']}",
            f"{row['other_agent']}: {row['other_task']}",
            number(row["synergy_a"]),
            number(row["synergy_b"]),
            number(row["ratio"]),
            _interval(row, number),
            _flag(row["differs"]),
            str(row["n_a"]),
            str(row["n_b"]),
            row["status_a"] if row["status_a"] == row["status_b"] else f"{row['status_a']} | {row['status_b']}",
        )
        for row in observed.head(_MOST_ROWS).iter_rows(named=True)
    ]
    title = (
        f"Synergies by {comparison.estimator}: factor on a task's mean duration of its side while another's task runs"
    )
    header = ("task", "while", "A", "B", "B / A", "95 % interval", "differs", "n A", "n B", "status")
    rows_text = (
        f"\n{table(header, rows, lambda i: 1 < i < len(header) - 1)}{_omitted_note(observed.height)}" if rows else ""
    )
    missing = frame.height - observed.height
    note = (
        f"\n{counted(missing, 'pair')} of tasks overlapped on one side or none: nothing to compare" if missing else ""
    )
    return f"{title}{rows_text}{note}"


def _caution(comparison: Comparison) -> str:
    if not comparison.compared:
        return ""
    return (
        f"{counted(comparison.compared, 'interval was', 'intervals were')} looked at, "
        f"{counted(comparison.differing, 'of them excludes', 'of them exclude')} no difference; about "
        f"{comparison.compared / 20:.0f} would by chance alone (one in twenty).\n"
        "What else differs between A and B than what you ask about (day, people, plans) is in these numbers too."
    )


def _interval(row: Row, format_number: Callable[[float | None, int], str], digits: int = 2) -> str:
    return (
        "n/a"
        if row["ci_low"] is None
        else f"[{format_number(row['ci_low'], digits)}, {format_number(row['ci_high'], digits)}]"
    )


def _signed(value: float | None, digits: int) -> str:
    # show values that round to zero as 0, not -0
    return "n/a" if value is None else f"{round(value, digits) + 0.0:+.{digits}f}"


def _percent(value: float | None) -> str:
    return "n/a" if value is None else f"{100 * value:+.1f} %"


def _flag(differs: bool | None) -> str:
    return "n/a" if differs is None else "yes" if differs else "no"


def _omitted_note(height: int) -> str:
    return f"\n... and {counted(height - _MOST_ROWS, 'more row')}, see --json" if height > _MOST_ROWS else ""
