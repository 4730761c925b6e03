"""Frames as CSV or Parquet files."""

from __future__ import annotations

from pathlib import Path

import polars as pl

from hrclog.errors import OutputError


def write_table(frame: pl.DataFrame, path: Path) -> tuple[Path, int]:
    """Write a frame by the ending of `path`, .csv or .parquet; lists become texts joined by "|" in CSV.

    Returns:
        The path and the number of rows.

    Raises:
        OutputError: the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".parquet":
            frame.write_parquet(path)
        else:
            frame.with_columns(pl.col(pl.List(pl.String)).list.join("|")).write_csv(path)
    except OSError as error:
        raise OutputError(path, f"cannot be written ({error.strerror or error})") from error
    return path, frame.height
