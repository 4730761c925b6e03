"""`hrclog demo`: the sample runs, analysed."""

from __future__ import annotations

from pathlib import Path

import click

from hrclog.cli.common import echo, json_option, tell


@click.command(name="demo")
@click.option(
    "-o",
    "--output",
    default="hrclog-out/demo",
    show_default=True,
    type=click.Path(path_type=Path),
    help="Folder for the results.",
)
@json_option
def command(output: Path, as_json: bool) -> int:
    """Analyse the sample runs that come with hrclog, and say where the pictures are.

    \b
    Example:
      hrclog demo
    """
    import hrclog.sample_logs as samples
    from hrclog.cli.analyze import analyse

    campaign = Path(samples.__file__).parent / "campaign"
    analysis = analyse([campaign], output, as_json=as_json)
    if not as_json:
        echo()
        echo(f"The pictures: {output / 'analysis.rrd'} (all runs) and {output / 'runs'} (one each)")
        echo(f"One file to mail: hrclog report {campaign} -o report.html")
        echo(f"The samples: {campaign.parent}")
        echo("Your own runs: hrclog record, hrclog import or hrclog sim, then hrclog analyze LOG...")
    return tell(analysis.diagnostics)
