"""A table of a file: its column names, a sample to guess from, and the cells of the columns that are asked for."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Final

import polars as pl

from hrclog.errors import ImportDataError
from hrclog.recorders.importers.table.skipped import Skip
from hrclog.wording import counted

LINE: Final = "\0line"
"""Column of the line, row or number that a row has in its file."""

_SAMPLE_ROWS: Final = 200
_SAMPLE_COLUMNS: Final = 500
_HEADER_ROWS: Final = 60  # in which the header is looked for
_NO_ROWS: Final = "check the file, or name its header's columns"

Row = tuple[int, list[str]]


@dataclass(frozen=True, slots=True)
class Cells:
    """The cells of some columns.

    Attributes:
        frame: those columns, and `LINE`.
        skips: rows that are no rows of the table.
    """

    frame: pl.DataFrame
    skips: list[Skip]


@dataclass(frozen=True, slots=True)
class Table:
    """A table of a file.

    Attributes:
        path: of the file.
        names: of its columns, each once.
        sample: its first rows, of its first columns.
        read: returns the cells of columns by their names.
        note: what was assumed when the file was opened; "" for nothing.
    """

    path: Path
    names: Sequence[str]
    sample: pl.DataFrame
    read: Callable[[Sequence[str]], Cells]
    note: str = ""


@dataclass(frozen=True, slots=True)
class Grid:
    """The rows of texts of a file, from its top.

    Attributes:
        path: of the file.
        rows: yields each row with its line.
        head: its first rows that are filled.
        note: what was assumed when the file was opened; "" for nothing.
    """

    path: Path
    rows: Callable[[], Iterator[Row]]
    head: Sequence[Row]
    note: str = ""

    def has_header(self, names: Sequence[str]) -> bool:
        """Return whether one of the first rows holds all of some names."""
        return any(set(names).issubset(map(str.strip, row)) for _, row in self.head)


def grid_of(path: Path, rows: Callable[[], Iterator[Row]], note: str = "") -> Grid:
    """Return a grid with its first rows."""
    head = [(line, row) for line, row in islice(rows(), _HEADER_ROWS) if any(map(str.strip, row))]
    return Grid(path, rows, head, note)


@dataclass(frozen=True, slots=True)
class _Layout:
    """Where a grid's table lies: its names, the line of the header, and what stands above it as key and value."""

    names: list[str]
    header_line: int
    constants: dict[str, str]


def table_of_frame(path: Path, frame: pl.DataFrame, skips: Sequence[Skip] = ()) -> Table:
    """Return a table that is in memory; rows count from 1 where it has no column `LINE`."""
    numbered = frame if LINE in frame.columns else frame.with_row_index(LINE, offset=1)
    numbered = numbered.with_columns(pl.col(LINE).cast(pl.Int64))
    names = [name for name in frame.columns if name != LINE]

    def read(columns: Sequence[str]) -> Cells:
        return Cells(numbered.select(LINE, *columns), list(skips))

    return Table(path, names, frame.select(names[:_SAMPLE_COLUMNS]).head(_SAMPLE_ROWS), read)


def table_of_grid(grid: Grid, header: Sequence[str], *, has_header: bool = True) -> Table:
    """Return the table within a grid.

    Args:
        grid: rows of texts.
        header: names that stand in the header, where they are known; they tell it from what stands above it.
        has_header: whether there is one.

    Raises:
        ImportDataError: the grid has no row.
    """
    layout = _header(grid, header) if has_header else _numbered(grid)
    names = [*layout.names, *layout.constants]

    def read(columns: Sequence[str]) -> Cells:
        return _cells(grid, layout, columns)

    top = replace(grid, rows=lambda: islice(grid.rows(), layout.header_line + _SAMPLE_ROWS))
    sample = _cells(top, layout, names[:_SAMPLE_COLUMNS]).frame.drop(LINE)
    return Table(grid.path, names, sample, read, grid.note)


def _header(grid: Grid, wanted: Sequence[str]) -> _Layout:
    """Return where the header is: the row that names the most of what is wanted, else the first that is filled."""
    first_rows = grid.head
    if not first_rows:
        raise ImportDataError(grid.path, "no row", "a table with a header", _NO_ROWS)
    names_wanted = set(wanted)
    best = max(len(names_wanted.intersection(map(str.strip, row))) for _, row in first_rows)
    rows = [(line, row) for line, row in first_rows if not _is_comment(row)] or first_rows
    line, row = next(
        ((line, row) for line, row in rows if len(names_wanted.intersection(map(str.strip, row))) == best), rows[0]
    )
    while row and not row[-1].strip():
        row = row[:-1]
    above = {
        cells[0].strip(): cells[1].strip()
        for other, cells in first_rows
        if other < line and len(cells) > 1 and cells[0].strip() and cells[1].strip()
    }
    names = unique_names(row)
    return _Layout(names, line, {key: value for key, value in above.items() if key not in names})


def _numbered(grid: Grid) -> _Layout:
    first_rows = [row for _, row in grid.head if not _is_comment(row)]
    if not first_rows:
        raise ImportDataError(grid.path, "no row", "a table", _NO_ROWS)
    width = Counter(map(len, first_rows)).most_common(1)[0][0]
    return _Layout([f"#{number}" for number in range(1, width + 1)], 0, {})


def _is_comment(row: Sequence[str]) -> bool:
    return row[0].lstrip().startswith("#") and not any(row[1:])


def unique_names(row: Sequence[str]) -> list[str]:
    """Return the names of a header, stripped; one that comes again, or is empty, gets a number."""
    names: list[str] = []
    taken: set[str] = set()
    for number, cell in enumerate(row, 1):
        name = cell.strip() or f"#{number}"
        if name in taken:
            name = f"{name} #{number}"
        names.append(name)
        taken.add(name)
    return names


def _cells(grid: Grid, layout: _Layout, columns: Sequence[str]) -> Cells:
    positions = [layout.names.index(name) for name in columns if name not in layout.constants]
    width = len(layout.names)
    lines: list[int] = []
    picked: list[list[str]] = []
    skips: list[Skip] = []
    for line, row in grid.rows():
        if line <= layout.header_line or not any(row) or _is_comment(row):
            continue
        if len(row) != width and (len(row) < width or any(row[width:])):
            expected = counted(width, "column")
            skips.append(Skip(line, f"found {counted(len(row), 'cell')}, expected {expected}"))
            continue
        lines.append(line)
        picked.append(row if len(positions) == len(row) else [row[position] for position in positions])
    texts = list(zip(*picked, strict=False)) if picked else [()] * width
    own = [name for name in columns if name not in layout.constants]
    series = {} if not own else dict(zip(own, _ordered(texts, positions, width, own), strict=True))
    frame = pl.DataFrame(
        [pl.Series(LINE, lines, pl.Int64), *(pl.Series(name, texts, pl.String) for name, texts in series.items())]
    ).with_columns(pl.lit(value).alias(name) for name, value in layout.constants.items() if name in columns)
    return Cells(frame.select(LINE, *columns), skips)


def _ordered(
    texts: Sequence[Sequence[str]], positions: Sequence[int], width: int, own: Sequence[str]
) -> list[Sequence[str]]:
    """Return the columns in the order of `own`; rows that were as long as `own` were kept whole."""
    if len(positions) == width:
        return [texts[position] for position in positions]
    return list(texts[: len(own)])
