"""`hrclog check`: damage and doubtful data."""

from __future__ import annotations

import click

from hrclog.cli.clock_option import clock_option
from hrclog.cli.common import EXIT_FAILED, Progress, echo, json_option, logs_argument, print_json, tell
from hrclog.cli.hints import hinted
from hrclog.cli.where_option import where_option
from hrclog.wording import counted


@click.command(name="check")
@logs_argument
@click.option("--strict", is_flag=True, help="Exit 1 on warnings too.")
@clock_option
@where_option
@json_option
def command(
    logs: tuple[str, ...], strict: bool, clocks: dict[str, int], conditions: tuple[str, ...], as_json: bool
) -> int:
    """Check logs for damage and doubtful data; writes nothing.

    Exit code: 0 all is there, 3 data was lost or cannot be used, with --strict 1 on warnings.

    \b
    Example:
      hrclog check --strict runs/*.mcap
    """
    from hrclog.analyzers.projections.diagnostics import lint
    from hrclog.analyzers.projections.intervals import rebuild
    from hrclog.analyzers.projections.overlaps import overlaps
    from hrclog.analyzers.projections.runs import runs
    from hrclog.log.reader import read_logs

    reading = Progress("reading logs")
    read = read_logs(logs, signals=True, on_file=reading, clocks=clocks, where=conditions)
    reading.done()
    executions, illegal = rebuild(read.events)
    table = runs(read.events, executions)
    findings = [*read.diagnostics, *illegal, *lint(read.events, executions, overlaps(executions), table)]
    code = tell(findings, info=True)
    counts = {severity: sum(f.severity == severity for f in findings) for severity in ("error", "warning", "info")}
    if as_json:
        print_json({"diagnostics": [finding.as_dict() for finding in hinted(findings)], "counts": counts})
    else:
        n_executions = int(table["n_executions"].sum())
        runs_held, events_held = counted(table.height, "run"), counted(read.events.height, "event")
        problems = f"{counted(counts['error'], 'error')}, {counted(counts['warning'], 'warning')}"
        remarks = counted(counts["info"], "remark")
        echo(f"{runs_held}, {events_held}, {counted(n_executions, 'execution')}: {problems}, {remarks}")
    return EXIT_FAILED if strict and not code and counts["warning"] else code
