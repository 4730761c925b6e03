"""`hrclog view`: open a log or a recording in the Rerun viewer."""

from __future__ import annotations

import tempfile
from pathlib import Path

import click

from hrclog.cli.common import EXIT_FAILED, EXIT_FINE, tell


@click.command(name="view")
@click.argument("target", metavar="LOG|RRD|FOLDER", type=click.Path(path_type=Path))
@click.option("--web", is_flag=True, help="Serve the viewer to a browser instead of opening a window.")
@click.option("--port", default=9090, show_default=True, help="Port of the web viewer.")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), help="Where to analyse a log.  [default: a temporary folder]"
)
def command(target: Path, web: bool, port: int, output: Path | None) -> int:  # noqa: FBT001 - click passes flags by name
    """Open a log (analysing it first), an .rrd or the folder of an analysis in the Rerun viewer.

    \b
    Example:
      hrclog view hrclog-out
      hrclog view run.mcap --web
    """  # noqa: D301 - click's \b keeps the line breaks
    from hrclog.analyzers.viewer import check_viewer, open_viewer, recordings_at

    recordings = recordings_at(target)
    check_viewer(recordings or [], web=web)
    code = EXIT_FINE
    if recordings is None:
        from hrclog.analyzers.analysis import analyze
        from hrclog.analyzers.output import save

        folder = output or Path(tempfile.mkdtemp(prefix="hrclog-view-"))
        click.echo(f"analysing {target} into {folder}", err=True)
        analysis = analyze([target])
        save(analysis, folder)
        code = tell(analysis.diagnostics)
        recordings = recordings_at(folder) or []
    return code if open_viewer(recordings, web_port=port if web else None) == 0 else EXIT_FAILED
