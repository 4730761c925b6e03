"""A table for readers: typed columns, and the same table as markdown."""

from __future__ import annotations

import math
from dataclasses import dataclass

import polars as pl

from hrclog.analyzers.figures.text import markdown_escape, shorten
from hrclog.arrays import IntArray


@dataclass(frozen=True, slots=True, eq=False)
class DataTable:
    """Rows of a frame under a title. `frame` holds full values; a column `*_s` is in seconds.

    `times_ns` places each row in its run, ns since the first event.
    """

    name: str
    title: str
    frame: pl.DataFrame
    caption: str = ""
    times_ns: IntArray | None = None


def markdown(table: DataTable, max_rows: int, width: int = 60) -> str:
    """Return the table as markdown: title, caption, at most `max_rows` rows, and a note if rows are left out."""
    frame = table.frame.head(max_rows)
    lines = [f"### {table.title}", ""]
    if table.caption:
        lines += [table.caption, ""]
    if frame.height < table.frame.height:
        lines += [f"**The first {max_rows:,} of {table.frame.height:,} rows.**", ""]
    if not frame.height:
        return "\n".join([*lines, "Nothing to list."])
    lines += ["| " + " | ".join(markdown_escape(name) for name in frame.columns) + " |", "|:--" * frame.width + "|"]
    lines += ["| " + " | ".join(_cell(value, width) for value in row) + " |" for row in frame.iter_rows()]
    return "\n".join(lines)


def _cell(value: object, width: int) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return number(value)
    if isinstance(value, list):
        value = ", ".join(str(item) for item in value)
    text = str(value)
    return markdown_escape(shorten(text, width)) if text else ""


def number(value: float) -> str:
    """Return a number as readers need it: with three decimals, or fewer from 100 on."""
    if not math.isfinite(value):
        return "n/a"
    if value == 0 or 1e-3 <= abs(value) < 1e6:
        return f"{value:.3f}" if abs(value) < 100 else f"{value:,.1f}"
    return f"{value:.2e}"
