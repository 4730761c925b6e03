"""Open a table's file, by what its first bytes are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import polars as pl

from hrclog.errors import ImportDataError
from hrclog.recorders.importers.table.json_lines import json_table
from hrclog.recorders.importers.table.mapping import TableMapping
from hrclog.recorders.importers.table.tables import LINE, Cells, Grid, Table, table_of_frame, table_of_grid
from hrclog.recorders.importers.table.text_files import decode_text, text_grid
from hrclog.recorders.importers.table.workbook import workbook_grid

_WORKBOOKS: Final = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")
_PARQUET: Final = b"PAR1"
_ARROW: Final = b"ARROW1"
_ARROW_STREAM: Final = b"\xff\xff\xff\xff"
_SAMPLE_ROWS: Final = 200
EXPECTED: Final = "CSV, TSV, JSON lines, Parquet, Arrow or XLSX"


def open_file(path: Path, reading: TableMapping) -> Grid | Table:
    """Return what a file holds: a table where the format names columns, else a grid in which its header is to be found.

    Args:
        path: of the file.
        reading: a mapping, for its delimiter, encoding and sheet.

    Raises:
        ImportDataError: the file cannot be read, or is in none of the formats.
    """
    try:
        with path.open("rb") as stream:
            head = stream.read(8)
            data = b"" if head[:4] in (*_WORKBOOKS, _PARQUET) or head[:6] == _ARROW else head + stream.read()
    except OSError as error:
        raise ImportDataError(path, f"a file that cannot be read ({error.strerror})", EXPECTED) from error
    if not head.strip():
        raise ImportDataError(path, "an empty file", EXPECTED)
    if head[:4] in _WORKBOOKS:
        return workbook_grid(path, reading.sheet)
    if head[:4] == _PARQUET or head[:6] == _ARROW or head[:4] == _ARROW_STREAM:
        return _columnar(path, head)
    if data.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] in (b"{", b"["):
        return json_table(path, decode_text(path, data, reading.encoding)[0])
    return text_grid(path, data, reading.encoding, reading.delimiter)


def table_in(content: Grid | Table, header: Sequence[str], *, has_header: bool = True) -> Table:
    """Return the table of what `open_file` returned.

    Args:
        content: a table, or a grid.
        header: names that stand in the header of a grid, where they are known.
        has_header: whether a grid has one.
    """
    return content if isinstance(content, Table) else table_of_grid(content, header, has_header=has_header)


def _columnar(path: Path, head: bytes) -> Table:
    try:
        if head[:4] == _ARROW_STREAM:
            return table_of_frame(path, pl.read_ipc_stream(path))
        lazy = pl.scan_parquet(path) if head[:4] == _PARQUET else pl.scan_ipc(path)
        names = lazy.collect_schema().names()
        sample = lazy.head(_SAMPLE_ROWS).collect()
    except (pl.exceptions.PolarsError, OSError) as error:
        problem = f"a file that cannot be read ({str(error).splitlines()[0]})"
        raise ImportDataError(path, problem, "a whole Parquet or Arrow file") from error

    def read(columns: Sequence[str]) -> Cells:
        frame = lazy.select(columns).collect().with_row_index(LINE, offset=1).with_columns(pl.col(LINE).cast(pl.Int64))
        return Cells(frame, [])

    return Table(path, names, sample, read)
