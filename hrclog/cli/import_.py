"""`hrclog import`: other systems' records into logs."""

from __future__ import annotations

from pathlib import Path

import click

from hrclog.cli.common import Progress, json_option, print_json, table, tell
from hrclog.wording import agree, counted


@click.group(name="import")
def command() -> None:
    """Turn other systems' records into logs."""


@command.command(name="mongo")
@click.argument("sources", nargs=-1, required=True, metavar="FILE...", type=click.Path(path_type=Path))
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="Folder for the logs.")
@click.option(
    "--report-gaps", is_flag=True, help="Report gaps in the numbering of the recipes: attempts deleted upstream."
)
@json_option
def mongo(sources: tuple[Path, ...], output: Path, report_gaps: bool, as_json: bool) -> int:
    """Import task_results dumps of the paper authors' stack, one log per recipe.

    Every id is derived from its row, so importing twice adds nothing.

    \b
    Example:
      hrclog import mongo task_results.json -o runs --report-gaps
    """
    from hrclog.recorders.importers.gaps import gap_report
    from hrclog.recorders.importers.mongo import import_mongo

    importing = Progress("importing recipes")
    result = import_mongo(sources, output, importing)
    importing.done()
    gaps = gap_report(result.recipes) if report_gaps else []
    missing, attempts = sum(gap.n_missing for gap in gaps), sum(gap.n_attempts for gap in gaps)
    if as_json:
        print_json(
            {
                "n_runs": len(result.recipes),
                "n_executions": result.n_executions,
                "written": [str(path) for path in result.written],
                "unchanged": [str(path) for path in result.unchanged],
                "gaps": [
                    {"prefix": gap.prefix, "n_attempts": gap.n_attempts, "n_missing": gap.n_missing} for gap in gaps
                ]
                if report_gaps
                else None,
                "diagnostics": [finding.as_dict() for finding in result.diagnostics],
            }
        )
    else:
        click.echo(
            f"{counted(len(result.recipes), 'run')}, {counted(result.n_executions, 'execution')}: "
            f"{counted(len(result.written), 'log')} written to {output}, {len(result.unchanged)} there already"
        )
        if report_gaps:
            click.echo(
                f"{missing} of {counted(attempts, 'attempt')} {agree(missing, 'is', 'are')} missing from the numbering "
                "(deleted upstream, probably failed):"
            )
            click.echo(
                table(
                    ("planner", "missing", "attempts"), [(g.prefix, str(g.n_missing), str(g.n_attempts)) for g in gaps]
                )
            )
    return tell(result.diagnostics)
