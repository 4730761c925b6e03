"""Write a table by the ending of its file's name."""

from __future__ import annotations

from pathlib import Path

import polars as pl

from hrclog.analyzers.exporters.exporter import write_frame
from hrclog.analyzers.exporters.exporters import EXPORTERS
from hrclog.errors import HrclogError


def save_table(frame: pl.DataFrame, path: str | Path) -> None:
    """Write a table of an analysis: .csv for R and spreadsheets, .sav for SPSS, .parquet for others.

    Args:
        frame: such as `analysis.executions`.
        path: of the file, whose ending tells the format; folders are made.

    Raises:
        HrclogError: the frame is none of polars, or no exporter writes files of that ending.
        OutputError: the file cannot be written.
    """
    path = Path(path)
    _check_table(frame)
    exporters = {exporter.suffix: exporter for exporter in reversed(list(EXPORTERS.values()))}
    if path.suffix.lower() not in exporters:
        endings = ", ".join(sorted(exporters))
        raise HrclogError(f"{path}: found the ending {path.suffix!r}, expected one of {endings}")
    write_frame(exporters[path.suffix.lower()], frame, path)


def _check_table(frame: object) -> None:
    if not isinstance(frame, pl.DataFrame):
        found = type(frame).__name__
        raise HrclogError(f"save_table: found {found}, expected a polars DataFrame, such as analysis.executions")
