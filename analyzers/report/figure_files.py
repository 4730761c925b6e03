"""A report's figures as files for papers and slides."""

from __future__ import annotations

import unicodedata
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Final

from hrclog.analyzers.figures.plot import Plot
from hrclog.analyzers.report.document import Report
from hrclog.file_names import file_stem

_LONGEST_PART: Final = 60  # bytes
_LONGEST_NAME: Final = 200  # bytes, of the 255 that file systems take


def figure_names(plots: Iterable[Plot]) -> list[str]:
    """Return a file name without ending per plot, made of its path. Numbers distinguish names that would be equal."""
    used_names: set[str] = set()
    names = []
    for plot in plots:
        stem = "-".join(filter(None, (file_stem(part, _LONGEST_PART) for part in plot.path)))
        stem = file_stem(stem, _LONGEST_NAME) or "figure"
        name, number = stem, 1
        while _fold_name(name) in used_names:
            number += 1
            name = f"{stem}-{number}"
        used_names.add(_fold_name(name))
        names.append(name)
    return names


def save_figures(
    plots: list[Plot], folder: Path, ending: str, save: Callable[[Plot, Path], None], on_step: Callable[[], None]
) -> list[str]:
    """Write one file per plot into a folder that is there, and return their names.

    Raises:
        OutputError: a file cannot be written.
    """
    names = [f"{name}{ending}" for name in figure_names(plots)]
    for plot, name in zip(plots, names, strict=True):
        save(plot, folder / name)
        on_step()
    return names


def report_plots(report: Report) -> list[Plot]:
    """Return the plots of a report in order, titled with their numbers. Plots of a run also carry the run's name."""
    of_all = [(figure, "") for section in report.sections for figure in section.figures]
    of_runs = [(figure, f"{run.entry}: ") for run in report.runs for figure in run.figures]
    return [
        replace(figure.plot, title=f"Figure {figure.number}. {name}{figure.plot.title}")
        for figure, name in (*of_all, *of_runs)
    ]


def _fold_name(name: str) -> str:
    return unicodedata.normalize("NFD", unicodedata.normalize("NFD", name).casefold())
