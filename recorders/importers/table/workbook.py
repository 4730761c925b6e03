"""Spreadsheets (XLSX, XLS, ODS) into a grid of texts: instants as ISO, durations and times of day as HH:MM:SS."""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from hrclog.errors import HrclogError, ImportDataError
from hrclog.recorders.importers.table.tables import Grid, Row, grid_of

_BASE: Final = datetime(1899, 12, 31)  # noqa: DTZ001 - a cell has no zone; times without a date count from it
_WITHOUT_DATE: Final = re.compile(r"(1899-12-3[01]|19[0-3]\d-\d\d-\d\d) (\d\d:\d\d:\d\d)(\.\d+)?")


def workbook_grid(path: Path, sheet: str = "") -> Grid:
    """Return the rows of a sheet.

    Args:
        path: of the workbook.
        sheet: its name; "" for the first that has a row.

    Raises:
        HrclogError: the library that reads workbooks is not installed.
        ImportDataError: the file is no workbook, or has no such sheet.
    """
    try:
        import fastexcel
    except ImportError as error:
        raise HrclogError(
            f"{path}: a workbook needs fastexcel: pip install 'hrclog[xlsx]', or save the sheet as CSV"
        ) from error
    try:
        book = fastexcel.read_excel(path)
        names = list(book.sheet_names)
        if sheet and sheet not in names:
            raise ImportDataError(path, f"no sheet {sheet!r}", f"one of {', '.join(names)}")
        for name in [sheet] if sheet else names:
            rows = [tuple(row) for row in book.load_sheet(name, header_row=None, dtypes="string").to_polars().rows()]
            if rows:
                break
    except fastexcel.FastExcelError as error:
        problem = f"a workbook that cannot be read ({str(error).splitlines()[0]})"
        raise ImportDataError(path, problem, "XLSX, XLS or ODS") from error
    others = "" if sheet or len(names) == 1 else f"sheet {name!r} of {len(names)} was read (--sheet says otherwise)"

    def grid_rows() -> Iterator[Row]:
        for line, row in enumerate(rows, 1):
            yield line, [_text(cell) for cell in row]

    return grid_of(path, grid_rows, others)


def _text(cell: Any) -> str:  # noqa: ANN401 - a text or None
    if not cell:
        return ""
    dateless = _WITHOUT_DATE.fullmatch(cell)
    if dateless is None:
        return str(cell)
    since = datetime.fromisoformat(f"{dateless[1]} {dateless[2]}") - _BASE
    seconds = round(since.total_seconds())
    return f"{seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d}{dateless[3] or ''}"
