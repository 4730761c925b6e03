"""`hrclog info`: what a log holds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from hrclog.cli.clock_option import clock_option
from hrclog.cli.common import echo, echo_lines, json_option, logs_argument, number, print_json, table, tell

if TYPE_CHECKING:
    from hrclog.log.reader import Logs


@click.command(name="info")
@logs_argument
@clock_option
@json_option
def command(logs: tuple[str, ...], clocks: dict[str, int], as_json: bool) -> int:
    """Show what logs hold: files, runs, agents, events, span, and whether they were closed.

    \b
    Example:
      hrclog info run.mcap
    """
    from hrclog.log.reader import read_logs

    read = read_logs(logs, signals=True, clocks=clocks)
    files, runs = _files(read), _runs(read)
    if as_json:
        print_json({"files": files, "runs": runs, "diagnostics": [finding.as_dict() for finding in read.diagnostics]})
    else:
        echo_lines(_file_table(files))
        echo()
        echo_lines(_run_table(runs))
    return tell(read.diagnostics)


def _files(read: Logs) -> list[dict[str, Any]]:
    unfinished = {
        finding.path for finding in read.diagnostics if finding.code in ("unfinished_log", "no_header", "truncated")
    }
    counts = dict(read.events.group_by("path").len().iter_rows())
    return [
        {
            "path": str(path),
            "bytes": path.stat().st_size if path.is_file() else sum(f.stat().st_size for f in path.iterdir()),
            "n_events": counts.get(str(path), 0),
            "finished": str(path) not in unfinished,
        }
        for path in read.paths
    ]


def _runs(read: Logs) -> list[dict[str, Any]]:
    import polars as pl

    from hrclog.analyzers.projections.intervals import intervals
    from hrclog.analyzers.projections.runs import runs

    events = read.events.group_by("run_id").agg(
        pl.len().alias("n_events"), pl.col("time_ns").min().alias("first_ns"), pl.col("time_ns").max().alias("last_ns")
    )
    samples = read.signals.group_by("run_id").agg(pl.len().alias("n_signal_samples"))
    rows = (
        runs(read.events, intervals(read.events))
        .join(events, on="run_id", how="left")
        .join(samples, on="run_id", how="left")
    )
    return rows.with_columns(pl.col("n_signal_samples").fill_null(0)).to_dicts()


def _file_table(files: list[dict[str, Any]]) -> str:
    rows = [(row["path"], str(row["bytes"]), str(row["n_events"]), "yes" if row["finished"] else "no") for row in files]
    return table(("file", "bytes", "events", "closed"), rows)


def _run_table(runs: list[dict[str, Any]]) -> str:
    from datetime import UTC, datetime

    rows = [
        (
            row["name"],
            datetime.fromtimestamp(row["first_ns"] / 1e9, UTC).strftime("%Y-%m-%d %H:%M:%S")
            if _is_date(row["first_ns"])
            else str(row["first_ns"]),
            ", ".join(row["agents"]),
            str(row["n_executions"]),
            str(row["n_failed"]),
            str(row["n_open"]),
            number(row["makespan_s"], 1),
            row["outcome"] or "n/a",
        )
        for row in runs
    ]
    header = ("run", "began (UTC)", "agents", "executions", "failed", "open", "makespan s", "outcome")
    return table(header, rows, lambda i: 2 < i < 7)


def _is_date(time_ns: int) -> bool:
    return 0 <= time_ns < 4e18
