"""Tables as CSV or Parquet files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import polars as pl

from hrclog.analyzers.exporters.exporter import Exporter
from hrclog.frame_files import write_by

_FORMULA: Final = r"^[=+\-@\t\r]"
_NUMBER: Final = r"^[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?$"


class Csv(Exporter):
    """Comma-separated values; lists become texts joined by "|".

    A text that a spreadsheet would run gets a leading "'": its first character is one of = + - @, a tab or a carriage
    return, and it is no number.

    Args:
        keep_formulas: write all texts as they are.
    """

    name = "csv"
    summary = "comma-separated values"
    suffix = ".csv"

    def __init__(self, *, keep_formulas: bool = False) -> None:
        self.keep_formulas = keep_formulas

    def write(self, frame: pl.DataFrame, path: Path) -> None:
        """Write a frame."""
        texts = frame.with_columns(pl.col(pl.List(pl.String)).list.join("|"))
        if not self.keep_formulas:
            texts = texts.with_columns(_harmless(pl.col(pl.String))).rename(_harmless_names(texts.columns))
        write_by(texts.write_csv, path)


class Parquet(Exporter):
    """Apache Parquet."""

    name = "parquet"
    summary = "Apache Parquet"
    suffix = ".parquet"

    def write(self, frame: pl.DataFrame, path: Path) -> None:
        """Write a frame."""
        write_by(frame.write_parquet, path)


def _harmless_names(names: Sequence[str]) -> dict[str, str]:
    """Return the names of columns as they are written, each once: those of tags and agents are what users call them."""
    written: dict[str, str] = {}
    taken = set(names)
    for name, harmless in zip(
        names,
        pl.DataFrame({"name": names}, {"name": pl.String}).select(_harmless(pl.col("name"))).to_series(),
        strict=True,
    ):
        new = harmless
        while new != name and new in taken:
            new = f"'{new}"
        taken.add(new)
        written[name] = new
    return written


def _harmless(texts: pl.Expr) -> pl.Expr:
    runs = texts.str.contains(_FORMULA) & ~texts.str.contains(_NUMBER)
    return pl.when(runs).then(pl.lit("'") + texts).otherwise(texts).name.keep()
