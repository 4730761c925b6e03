"""Delimited text - CSV, TSV and the like - into a grid, whatever its encoding and delimiter."""

from __future__ import annotations

import codecs
import csv
import io
from collections import Counter
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Final

from hrclog.errors import ImportDataError
from hrclog.recorders.importers.table.tables import Grid, Row, grid_of

_MARKS: Final = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_FALLBACK: Final = "cp1252"
_DELIMITERS: Final = ",;\t|"
_SNIFFED_ROWS: Final = 100
_LARGEST_CELL: Final = 1 << 24


def text_grid(path: Path, data: bytes, encoding: str = "", delimiter: str = "") -> Grid:
    """Return the rows of a text file.

    Args:
        path: of the file, for errors.
        data: its bytes.
        encoding: its encoding; "" for that of its byte order mark, else UTF-8, else Windows-1252.
        delimiter: between columns; "" for the one that gives rows of one length.

    Raises:
        ImportDataError: it is no text.
    """
    text, note = decode_text(path, data, encoding)
    sign = delimiter or _find_delimiter(text)
    csv.field_size_limit(_LARGEST_CELL)

    def rows() -> Iterator[Row]:
        reader = csv.reader(io.StringIO(text, newline=""), delimiter=sign)
        line = 1
        while True:
            try:
                row = next(reader)
            except StopIteration:
                return
            except csv.Error as error:
                raise ImportDataError(path, f"line {line}: {error}", "a table", "check its quotes") from error
            yield line, row
            line = reader.line_num + 1

    return grid_of(path, rows, note)


def decode_text(path: Path, data: bytes, encoding: str = "") -> tuple[str, str]:
    """Return the text of bytes, and what was assumed of its encoding.

    Raises:
        ImportDataError: it is no text in that encoding.
    """
    marked = next((name for mark, name in _MARKS if data.startswith(mark)), "")
    named = encoding or marked
    if not named and data[:2000].count(0) > len(data[:2000]) // 4:
        named = "utf-16-le" if data[1:2] == b"\0" else "utf-16-be"
    try:
        text = data.decode(named or "utf-8", errors="strict" if encoding or not named else "replace")
    except LookupError as error:
        raise ImportDataError(path, f"the encoding {encoding!r}", "one that Python knows, e.g. utf-8") from error
    except UnicodeDecodeError as error:
        if named:
            problem = f"bytes that are not {named} (byte {error.start})"
            raise ImportDataError(path, problem, f"text in {named}", "say which it is with --encoding") from error
        return _fallback_text(path, data)
    if text[:2000].count("\0") > len(text[:2000]) // 20:
        raise ImportDataError(path, "a binary file", "CSV, TSV, JSON lines, Parquet, Arrow or XLSX")
    return text.removeprefix("\ufeff"), ""


def _fallback_text(path: Path, data: bytes) -> tuple[str, str]:
    if 0 in data[:2000]:
        raise ImportDataError(path, "a binary file", "CSV, TSV, JSON lines, Parquet, Arrow or XLSX")
    return data.decode(_FALLBACK, errors="replace"), "not UTF-8, read as Windows-1252 (--encoding says otherwise)"


def _find_delimiter(text: str) -> str:
    """Return the delimiter that splits most of the first rows into as many cells, at best more than one."""
    best, best_score = ",", (0.0, 0)
    for sign in _DELIMITERS:
        try:
            rows = [
                row for row in islice(csv.reader(io.StringIO(text, newline=""), delimiter=sign), _SNIFFED_ROWS) if row
            ]
        except csv.Error:
            continue
        widths = Counter(len(row) for row in rows if len(row) > 1)
        if not widths:
            continue
        width, count = max(widths.items(), key=lambda item: (item[1], item[0]))
        score = (round(count / len(rows), 3), width)
        if score > best_score:
            best, best_score = sign, score
    return best
