"""Tables of a page: short texts for reading, full values for sorting and copying."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
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
_FACTORS: Final = ("synergy", "synergy_free")
_LEAST, _MOST = 1e-3, 1e6  # sizes of numbers that three decimals tell


@dataclass(frozen=True, slots=True)
class Cell:
    """The text that is shown, and the full value if it is a different text; "" for no value."""

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
    """Return a table for a page; rows whose factor is not known come last.

    Args:
        table: what it shows.
        anchor: its id in the page, and the name of its download.
    """
    frame = table.frame.select(sorted(table.frame.columns, key=lambda name: name in _LAST))
    has_factor = _has_factor(frame)
    page_rows = (
        frame.filter(has_factor).vstack(frame.filter(~has_factor)).head(_row_limit(frame.height, int(has_factor.sum())))
    )
    columns = tuple(Column(name, dtype.is_numeric()) for name, dtype in frame.schema.items())
    cells = list(zip(*(_cells(page_rows[column.name], is_number=column.numeric) for column in columns), strict=True))
    return PageTable(
        anchor=anchor,
        title=table.title,
        caption=table.caption,
        file_name=f"{anchor}.csv",
        columns=columns,
        rows=tuple(cells[:SHOWN]),
        more=tuple(cells[SHOWN:]),
        notes=_notes(frame.height, int(has_factor.sum())),
        filterable=frame.height > FILTER_FROM,
    )


def _has_factor(frame: pl.DataFrame) -> pl.Series:
    """Return which rows have a factor. In a table without factors, all rows count."""
    factors = [name for name in _FACTORS if name in frame.columns]
    if not factors:
        return pl.repeat(value=True, n=frame.height, eager=True)
    return frame.select(pl.any_horizontal(pl.col(factors).is_not_null())).to_series()


def _row_limit(height: int, n_known: int) -> int:
    """Return how many rows a page holds: of a long table those with a factor, and at least the rows shown at once."""
    return height if height <= KEPT else max(min(n_known, KEPT), SHOWN)


def _notes(height: int, n_known: int) -> tuple[str, ...]:
    if height > KEPT:
        numbered = f", {min(n_known, KEPT):,} of the {n_known:,} with a factor first" if n_known < height else ""
        limit = _row_limit(height, n_known)
        shown = f", and shows {SHOWN:,} of them at once" if limit > SHOWN else ""
        sentence = f"This page holds the first {limit:,} of {height:,} rows{numbered}{shown}"
        return (f"{sentence}; hrclog export writes all.",)
    if height > SHOWN:
        return (f"{SHOWN:,} of {height:,} rows are shown at once; sorting, filtering, copying and the CSV take all.",)
    return ()


def _cells(values: pl.Series, *, is_number: bool) -> list[Cell]:
    format_number = _number_format(values) if values.dtype.is_float() else number
    return [_cell(value, format_number, is_number=is_number) for value in values]


def _number_format(values: pl.Series) -> Callable[[float], str]:
    """Return how to write the numbers of a column: all with three decimals, unless their sizes differ too much."""
    sizes = [abs(value) for value in values if value and math.isfinite(value)]
    is_plain = all(_LEAST <= size < _MOST for size in sizes)
    return (lambda value: f"{value:,.3f}") if is_plain else number


def _cell(value: object, format_number: Callable[[float], str], *, is_number: bool) -> Cell:
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return Cell(_NOTHING if is_number else "", "" if is_number else None)
    if isinstance(value, float):
        text, full = format_number(value), repr(value)
        return Cell(text, None if text == full else full)
    if isinstance(value, Sequence | pl.Series) and not isinstance(value, str):
        value = ", ".join(str(item) for item in value)
    text = printable(str(value)) if str(value) else ""
    if len(text) <= _LONGEST_WORD or " " in text:
        return Cell(text)
    return Cell(shorten(text, _LONGEST_WORD), text)
