"""`hrclog export`: the projections as plain tables."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from hrclog.analyzers.exporters.exporters import EXPORTERS
from hrclog.cli.clock_option import clock_option
from hrclog.cli.common import Progress, echo, json_option, logs_argument, print_json, tell
from hrclog.cli.names import NameOf
from hrclog.cli.where_option import where_option
from hrclog.wording import counted

if TYPE_CHECKING:
    from hrclog.analyzers.exporters.exporter import Exporter

TABLES = (
    "events", "intervals", "executions", "overlaps", "pair_overlaps", "durations", "synergies", "runs", "metrics",
    "signals",
)  # fmt: skip


@click.command(name="export")
@logs_argument
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="Folder for the tables.")
@click.option(
    "--format",
    "kind",
    type=NameOf(EXPORTERS),
    default=EXPORTERS.default,
    show_default=True,
    help="File format; package.module:NAME for one of yours.",
)
@click.option(
    "--table", "tables", type=click.Choice(TABLES), multiple=True, help="Only this table (repeatable).  [default: all]"
)
@click.option(
    "--keep-formulas",
    is_flag=True,
    help="Of csv: leave texts as they are that a spreadsheet would run; else they get a leading '.",
)
@clock_option
@where_option
@json_option
def command(
    logs: tuple[str, ...],
    output: Path,
    kind: str,
    tables: tuple[str, ...],
    keep_formulas: bool,
    clocks: dict[str, int],
    conditions: tuple[str, ...],
    as_json: bool,
) -> int:
    """Write events, intervals, executions, overlaps, durations, synergies, runs, metrics and signals as tables.

    The table executions is the long one for statistics. Instants are whole nanoseconds, durations seconds. The columns
    are described in docs/tables.md.

    \b
    Example:
      hrclog export runs/*.mcap -o tables --format csv --table intervals
    """
    from hrclog.analyzers.analysis import analyze
    from hrclog.analyzers.exporters.exporter import write_tables
    from hrclog.analyzers.output import check_writable

    if keep_formulas and kind != "csv":
        raise click.UsageError(f"--keep-formulas is for --format csv; {kind} keeps all texts as they are")
    check_writable(output)
    reading = Progress("reading logs")
    analysis = analyze(logs, on_file=reading, clocks=clocks, where=conditions)
    reading.done()
    exporter = _exporter(kind, keep_formulas=keep_formulas)
    written = write_tables(exporter, {name: getattr(analysis, name) for name in tables or TABLES}, output)
    if as_json:
        print_json({"written": [{"path": str(path), "rows": rows} for path, rows in written]})
    else:
        for path, rows in written:
            echo(f"{path}: {counted(rows, 'row')}")
    return tell(analysis.diagnostics)


def _exporter(kind: str, *, keep_formulas: bool) -> Exporter:
    from hrclog.analyzers.exporters.tables import Csv

    return Csv(keep_formulas=True) if keep_formulas else EXPORTERS[kind]
