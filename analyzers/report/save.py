"""Write a report, and its figures as files."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from hrclog.analyzers import drawing
from hrclog.analyzers.output import check_writable
from hrclog.analyzers.report.document import DEFAULT_RUNS, Report, report
from hrclog.analyzers.report.figure_files import report_plots, save_figures
from hrclog.analyzers.report.render import render
from hrclog.file_sets import replaced_set
from hrclog.files import output_errors, write_output

if TYPE_CHECKING:
    from hrclog.analyzers.figures.plot import Plot
    from hrclog.analyzers.result import Analysis

PictureKind = Literal["png", "svg"]


def save_report(
    analysis: Analysis, path: str | Path, *, runs: int = DEFAULT_RUNS, title: str = "", command: str = ""
) -> None:
    """Write a report on an analysis as one HTML file.

    Args:
        analysis: what is reported on.
        path: of the file; its folder is made where it is missing.
        runs: how many single runs are shown.
        title: of the report; "" says how many runs it is about.
        command: how it was asked for; "" leaves that out.

    Raises:
        HrclogError: no agent did anything, or an argument is not what it should be.
        OutputError: the file cannot be written.
    """
    check_writable(Path(path).parent)
    write_report(report(analysis, runs=runs, title=title, command=command), Path(path))


def write_report(said: Report, path: Path, on_step: Callable[[], None] = lambda: None) -> None:
    """Draw a report and write it as HTML.

    Args:
        said: what it says.
        path: of the file; its folder is made where it is missing.
        on_step: called after each picture, for progress.

    Raises:
        OutputError: the file cannot be written.
    """

    def draw(plot: Plot) -> str:
        svg = drawing.svg(plot)
        on_step()
        return svg

    write_output(path, render(said, draw).encode(), makes_folder=True)


def write_pdf(said: Report, path: Path) -> None:
    """Write a report's figures as one PDF, a page each.

    Raises:
        OutputError: the file cannot be written.
    """
    with output_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    drawing.save_pdf(report_plots(said), path)


def write_pictures(
    said: Report, folder: Path, kind: PictureKind, on_step: Callable[[], None] = lambda: None
) -> list[str]:
    """Write a report's figures into a folder that is there, one file each, named by what they show; return their names.

    Raises:
        OutputError: a file cannot be written.
    """
    save = drawing.save_png if kind == "png" else drawing.save_svg
    return save_figures(report_plots(said), folder, f".{kind}", save, on_step)


def replaced_pictures(folder: Path, kind: PictureKind) -> AbstractContextManager[Path]:
    """Return a context with a hidden folder for pictures; at the end they replace those of an earlier report.

    Raises:
        OutputError: the folder cannot be written.
    """
    return replaced_set(folder, f"figures-{kind}")
