"""`hrclog check`: damage and doubtful data."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from hrclog.cli.clock_option import clock_option
from hrclog.cli.code_option import DiagnosticCode
from hrclog.cli.common import EXIT_FAILED, EXIT_FINE, Progress, echo, json_option, print_json, tell
from hrclog.cli.hints import hinted
from hrclog.cli.where_option import where_option
from hrclog.diagnostic import CODES
from hrclog.wording import counted

if TYPE_CHECKING:
    import polars as pl

    from hrclog.diagnostic import Diagnostic
    from hrclog.log.clocks.correction import Clocks


INCOMPLETE = ("missing_from_plan", "short_run", "run_not_ended")
"""Codes of runs of which a part is not there."""


@click.command(name="check")
@click.argument("logs", nargs=-1, metavar="LOG...", type=click.Path())
@click.option("--strict", is_flag=True, help="Exit 1 on warnings too.")
@click.option(
    "--only",
    multiple=True,
    type=DiagnosticCode(),
    metavar="CODE",
    help="Only findings of this code count, for the exit code too. Repeatable.",
)
@click.option(
    "--explain",
    type=DiagnosticCode(),
    metavar="CODE",
    help="Say what a code means, what causes it and what to do, and read no log.",
)
@click.option("--annotate", is_flag=True, help=f"Exclude incomplete runs ({', '.join(INCOMPLETE)}), by annotations.")
@click.option("--author", default="", metavar="NAME", help="With --annotate: who says so.")
@clock_option
@where_option
@json_option
@click.pass_context
def command(
    context: click.Context,
    logs: tuple[str, ...],
    strict: bool,
    only: tuple[str, ...],
    explain: str | None,
    annotate: bool,
    author: str,
    clocks: dict[str, int],
    conditions: tuple[str, ...],
    as_json: bool,
) -> int:
    """Check logs for damage and doubtful data; without --annotate it writes nothing.

    Exit code: 0 all is there, 3 data was lost or cannot be used, with --strict 1 on warnings.

    \b
    Example:
      hrclog check --strict runs/*.mcap
      hrclog check runs/*.mcap --only short_run --only missing_from_plan
      hrclog check --explain short_run
    """
    if explain:
        return _explain(explain, as_json=as_json)
    if not logs:
        raise click.MissingParameter(ctx=context, param=context.command.params[0])
    events, runs, every = _findings(logs, clocks, conditions)
    findings = [finding for finding in every if not only or finding.code in only]
    code = tell(findings, info=True)
    severities = Counter(finding.severity for finding in findings)
    counts = {severity: severities[severity] for severity in ("error", "warning", "info")}
    n_left_out = len(every) - len(findings)
    excluded = _exclude_incomplete(findings, author) if annotate else []
    if as_json:
        listed = [finding.as_dict() for finding in hinted(findings)]
        print_json({"diagnostics": listed, "counts": counts, "left_out": n_left_out, "excluded": excluded})
    else:
        n_executions = int(runs["n_executions"].sum())
        held = f"{counted(runs.height, 'run')}, {counted(events.height, 'event')}, {counted(n_executions, 'execution')}"
        problems = f"{counted(counts['error'], 'error')}, {counted(counts['warning'], 'warning')}"
        left_out = f"; {n_left_out:,} of other codes" if only else ""
        echo(f"{held}: {problems}, {counted(counts['info'], 'remark')}{left_out}")
        if annotate:
            echo(f"{counted(len(excluded), 'incomplete run')} excluded")
    return EXIT_FAILED if strict and not code and counts["warning"] else code


def _exclude_incomplete(findings: Sequence[Diagnostic], author: str) -> list[str]:
    """Exclude the runs that findings call incomplete, and return their ids."""
    from hrclog.recorders.annotate import annotate

    incomplete: dict[str, Diagnostic] = {}
    for finding in findings:
        if finding.code in INCOMPLETE and finding.run_id:
            incomplete.setdefault(finding.run_id, finding)
    for run, finding in incomplete.items():
        reason = f"{finding.message} ({finding.code})"
        annotate(finding.path, exclude=["run"], reason=reason, author=author, runs=[run])
    return sorted(incomplete)


def _findings(
    logs: Sequence[str], clocks: Clocks, conditions: Sequence[str]
) -> tuple[pl.DataFrame, pl.DataFrame, list[Diagnostic]]:
    """Read logs and return their events, their runs, and what is remarkable about them."""
    from hrclog.analyzers.projections.intervals import rebuild
    from hrclog.analyzers.projections.lints.lints import lint
    from hrclog.analyzers.projections.overlaps import overlaps
    from hrclog.analyzers.projections.runs import runs
    from hrclog.log.reader import read_logs

    reading = Progress("reading logs")
    read = read_logs(logs, signals=True, on_file=reading, clocks=clocks, where=conditions)
    reading.done()
    executions, illegal = rebuild(read.events)
    table = runs(read.events, executions)
    lints = lint(read.events, executions, overlaps(executions), table)
    return read.events, table, [*read.diagnostics, *illegal, *lints]


def _explain(code: str, *, as_json: bool) -> int:
    from hrclog.explanations import EXPLANATIONS

    severity, meaning = CODES[code]
    explanation = EXPLANATIONS[code]
    if as_json:
        facts = {"code": code, "severity": severity, "meaning": meaning}
        print_json(facts | {"cause": explanation.cause, "remedy": explanation.remedy})
    else:
        echo(f"{code} ({severity}): {meaning}{'' if meaning.endswith('?') else '.'}")
        echo(f"Cause: {explanation.cause}")
        echo(f"What to do: {explanation.remedy}")
    return EXIT_FINE
