"""Tables as a page shows them: short texts to read, full values to sort by and to copy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import polars as pl

from hrclog.analyzers.figures.table import DataTable, number
from hrclog.analyzers.figures.text import printable, shorten

SHOWN: Final = 200
"""Rows that are shown at once."""
KEPT: Final = 5_000
"""Rows that a page holds, to sort, filter, copy and download."""
FILTER_FROM: Final = 20
"""More rows than this can be filtered."""

_NOTHING: Final = "n/a"
_LONGEST_WORD: Final = 40
_LAST: Final = ("run_id", "path")
"""Columns that are looked up rather than read."""


@dataclass(frozen=True, slots=True)
class Cell:
    """What is read, and the value in full where it is another text; "" for no value."""

    text: str
    value: str | None = None

    @property
    def long(self) -> bool:
        """Return whether this is a text of several lines."""
        return len(self.text) > _LONGEST_WORD


@dataclass(frozen=True, slots=True)
class Column:
    """A heading, and whether numbers stand below it."""

    name: str
    numeric: bool


@dataclass(frozen=True, slots=True)
class PageTable:
    """A table for a page: `rows` are shown from the start, `more` after sorting or filtering."""

    anchor: str
    title: str
    caption: str
    file_name: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    more: tuple[tuple[Cell, ...], ...]
    notes: tuple[str, ...]
    filterable: bool


def page_table(table: DataTable, anchor: str) -> PageTable:
    """Return a table for a page.

    Args:
        table: what it shows.
        anchor: its id in the page, and the name of its download.
    """
    frame = table.frame.select(sorted(table.frame.columns, key=lambda name: name in _LAST))
    columns = tuple(Column(name, dtype.is_numeric()) for name, dtype in frame.schema.items())
    cells = [
        tuple(_cell(value, column.numeric) for value, column in zip(row, columns, strict=True))
        for row in frame.head(KEPT).iter_rows()
    ]
    return PageTable(
        anchor=anchor,
        title=table.title,
        caption=table.caption,
        file_name=f"{anchor}.csv",
        columns=columns,
        rows=tuple(cells[:SHOWN]),
        more=tuple(cells[SHOWN:]),
        notes=_notes(frame.height),
        filterable=frame.height > FILTER_FROM,
    )


def _notes(height: int) -> tuple[str, ...]:
    if height > KEPT:
        held = f"This page holds the first {KEPT:,} of {height:,} rows and shows {SHOWN:,} of them at once"
        return (f"{held}; hrclog export writes all.",)
    if height > SHOWN:
        return (f"{SHOWN:,} of {height:,} rows are shown at once; sorting, filtering, copying and the CSV take all.",)
    return ()


def _cell(value: object, is_number: bool) -> Cell:  # noqa: FBT001 - the kind of the column
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return Cell(_NOTHING if is_number else "", "" if is_number else None)
    if isinstance(value, float):
        text, full = number(value), repr(value)
        return Cell(text, None if text == full else full)
    if isinstance(value, Sequence | pl.Series) and not isinstance(value, str):
        value = ", ".join(str(item) for item in value)
    text = printable(str(value)) if str(value) else ""
    if len(text) <= _LONGEST_WORD or " " in text:
        return Cell(text)
    return Cell(shorten(text, _LONGEST_WORD), text)
