"""Tables as CSV or Parquet files."""

from __future__ import annotations

from pathlib import Path

import polars as pl

from hrclog.analyzers.exporters.exporter import Exporter


class Csv(Exporter):
    """Comma-separated values; lists become texts joined by "|"."""

    name = "csv"
    summary = "comma-separated values"
    suffix = ".csv"

    def write(self, frame: pl.DataFrame, path: Path) -> None:
        """Write a frame."""
        frame.with_columns(pl.col(pl.List(pl.String)).list.join("|")).write_csv(path)


class Parquet(Exporter):
    """Apache Parquet."""

    name = "parquet"
    summary = "Apache Parquet"
    suffix = ".parquet"

    def write(self, frame: pl.DataFrame, path: Path) -> None:
        """Write a frame."""
        frame.write_parquet(path)
