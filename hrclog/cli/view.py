"""`hrclog view`: open a log or a recording in the Rerun viewer, or follow runs while they are recorded."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hrclog.cli.clock_option import clock_option
from hrclog.cli.common import EXIT_FAILED, EXIT_FINE, Progress, echo, tell
from hrclog.cli.where_option import where_option
from hrclog.errors import HrclogError, LogReadError
from hrclog.wording import counted

_Reading = tuple[dict[str, int], tuple[str, ...]]
"""The options of reading: offsets of clocks by agent, conditions on tags."""

if TYPE_CHECKING:
    from hrclog.analyzers.rerun.selection import Chosen
    from hrclog.analyzers.result import Analysis


@click.command(name="view")
@click.argument("target", metavar="LOG|RRD|FOLDER", type=click.Path(path_type=Path))
@click.option(
    "--run",
    "names",
    multiple=True,
    metavar="NAME",
    help="Of a folder, runs with this in their name; or a glob. Repeatable.",
)
@click.option("--live", is_flag=True, help="Follow the runs that are being recorded into FOLDER.")
@click.option(
    "--until-idle",
    type=click.FloatRange(min=0, min_open=True),
    metavar="SECONDS",
    help="With --live: end after so long without anything new.",
)
@click.option(
    "--every",
    type=click.FloatRange(min=0.05),
    default=0.5,
    show_default=True,
    metavar="SECONDS",
    help="With --live: how often to look.",
)
@click.option("--web", is_flag=True, help="Serve the viewer to a browser instead of opening a window.")
@click.option("--port", type=click.IntRange(1, 65535), default=9090, show_default=True, help="Port of the web viewer.")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), help="Where to analyse a log.  [default: a temporary folder]"
)
@clock_option
@where_option
def command(
    target: Path,
    names: tuple[str, ...],
    live: bool,
    until_idle: float | None,
    every: float,
    web: bool,
    port: int,
    output: Path | None,
    clocks: dict[str, int],
    conditions: tuple[str, ...],
) -> int:
    """Open a log (analysing it first), an .rrd or the folder of an analysis in the Rerun viewer.

    With --live, FOLDER is where runs are being recorded: each is drawn while it goes on, and statistics follow as each
    ends, until the viewer is closed or Ctrl-C.

    \b
    Example:
      hrclog view hrclog-out
      hrclog view run.mcap --web
      hrclog view runs --live
    """
    web_port = port if web else None
    if live:
        if names or output is not None or clocks or conditions:
            raise click.UsageError("--live takes none of --run, --clock, --where, -o: it shows what is being recorded")
        return _follow_runs(target, web_port, every, until_idle)
    if until_idle is not None:
        raise click.UsageError("--until-idle is for --live")
    if names and target.suffix == ".rrd" and not target.is_dir():
        raise click.UsageError("--run chooses among the runs of a log or a folder, not within a recording")
    return _open_recordings(target, names, web_port, output, (clocks, conditions))


def _open_recordings(
    target: Path, names: tuple[str, ...], web_port: int | None, output: Path | None, reading: _Reading
) -> int:
    from hrclog.analyzers.rerun.selection import recordings_at
    from hrclog.analyzers.rerun.viewer import check_viewer, open_viewer

    chosen = recordings_at(target, names)
    if chosen is not None and any(reading):
        raise click.UsageError("--clock and --where are for logs: a recording shows what it was made with")
    check_viewer(chosen.paths if chosen is not None else (), web_port)
    code = EXIT_FINE
    if chosen is None:
        chosen, code = _analyse(target, names, output or Path(tempfile.mkdtemp(prefix="hrclog-view-")), reading)
    if chosen.note:
        echo(chosen.note, err=True)
    if len(chosen.paths) > 1:
        echo(f"{len(chosen.paths)} recordings: the panel on the left (Ctrl-Shift-B) lists them", err=True)
    return code if open_viewer(chosen.paths, web_port) == 0 else EXIT_FAILED


def _analyse(target: Path, names: tuple[str, ...], folder: Path, options: _Reading) -> tuple[Chosen, int]:
    """Analyse logs into a folder, and return the recordings there and the exit code."""
    from hrclog.analyzers.analysis import analyze
    from hrclog.analyzers.output import (
        RECORDING_NAME,
        RUNS_FOLDER,
        check_writable,
        drawn_runs,
        recording_names,
        save,
    )
    from hrclog.analyzers.rerun.selection import MOST_RUNS, Chosen, matching_runs

    check_writable(folder)
    reading = Progress("reading logs")
    clocks, conditions = options
    analysis = analyze([target], on_file=reading, clocks=clocks, where=conditions)
    reading.done()
    _check_content(target, analysis)
    chosen = matching_runs(analysis.runs, names, target) if names else drawn_runs(analysis.runs, MOST_RUNS)
    echo(f"analysing {target} into {folder}", err=True)
    drawing = Progress("drawing runs", len(chosen) + 1)
    save(analysis, folder, drawing, drawn=chosen)
    drawing.done()
    names_of_files = recording_names(analysis.runs)
    paths = [folder / RUNS_FOLDER / names_of_files[run_id] for run_id in chosen]
    n_left_out = 0 if names else analysis.runs.height - len(chosen)
    note = (
        f"opening {len(chosen)} of {analysis.runs.height:,} runs, evenly spread; --run NAME chooses"
        if n_left_out
        else ""
    )
    campaign = folder / RECORDING_NAME
    opened = (campaign, *reversed(paths)) if names else (*paths, campaign)
    return Chosen(opened, note), tell(analysis.diagnostics)


def _check_content(target: Path, analysis: Analysis) -> None:
    """Raise if there is nothing to see."""
    agents = analysis.runs["agents"].explode().drop_nulls()
    if analysis.events.is_empty() or agents.is_empty():
        found = "no events" if analysis.events.is_empty() else "events of no agent"
        remedy = f"hrclog info {target} says what is in it"
        raise LogReadError(target, found, "agents that do something", remedy)


def _follow_runs(folder: Path, web_port: int | None, every_s: float, until_idle_s: float | None) -> int:
    from hrclog.analyzers.rerun.stop_request import StopRequest
    from hrclog.analyzers.rerun.viewer import running_viewer
    from hrclog.log.watch import list_folder

    list_folder(folder)
    with StopRequest() as stop, running_viewer(web_port) as viewer:
        if viewer.page:
            echo(f"open {viewer.page} in a browser; Ctrl-C ends it", err=True)
        # after its window is closed, Rerun would print here that it cannot send data
        os.environ.setdefault("RUST_LOG", "off")
        from hrclog.analyzers.live.follow import Followed, follow

        reading = Progress("reading logs")
        followed = Followed()

        def enough(seconds: float) -> bool:
            return stop.wait(seconds) or not viewer.is_open()

        try:
            follow(
                folder,
                viewer.url,
                enough,
                every_s=every_s,
                until_idle_s=until_idle_s,
                tell=lambda text: echo(text, err=True),
                on_file=reading,
                followed=followed,
            )
        finally:
            reading.done()
            n_runs, n_ended = len(followed.runs), len(followed.ended)
            echo(f"followed {counted(n_runs, 'run')}, {n_ended:,} ended", err=True)
        code = viewer.process.poll()
    if code:
        raise HrclogError(f"the Rerun viewer ended with code {code}")
    return EXIT_FINE
