"""JSON lines, or one JSON array, of objects into a table."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import polars as pl

from hrclog.errors import ImportDataError
from hrclog.json_text import JsonLimitError, check_depth, parse_json
from hrclog.recorders.importers.table.skipped import Skip
from hrclog.recorders.importers.table.tables import LINE, Table, table_of_frame


def json_table(path: Path, text: str) -> Table:
    """Return the table of a JSON text: a row per object, a column per key.

    Raises:
        ImportDataError: it holds no object.
    """
    rows, skips = _array(text) if text.lstrip().startswith("[") else _lines(text)
    if not rows:
        raise ImportDataError(path, "no JSON object", "an object per line, or an array of them")
    names = dict.fromkeys(name for _, row in rows for name in row)
    columns = [pl.Series(LINE, [line for line, _ in rows], pl.Int64)]
    columns += [_series(name, [row.get(name) for _, row in rows]) for name in names if name != LINE]
    return table_of_frame(path, pl.DataFrame(columns), skips)


def _series(name: str, values: list[Any]) -> pl.Series:
    kinds = {type(value) for value in values if value is not None}
    try:
        if kinds <= {int, float}:
            return pl.Series(name, values, pl.Int64 if kinds == {int} else None, strict=float not in kinds)
        if len(kinds) <= 1 and dict not in kinds:
            return pl.Series(name, values)
    except (TypeError, ValueError, OverflowError, pl.exceptions.PolarsError):
        pass
    texts = [value if value is None or isinstance(value, str) else json.dumps(value) for value in values]
    return pl.Series(name, texts, pl.String)


def _lines(text: str) -> tuple[list[tuple[int, dict[str, Any]]], list[Skip]]:
    rows: list[tuple[int, dict[str, Any]]] = []
    skips: list[Skip] = []
    for line, part in enumerate(text.split("\n"), 1):
        if not part.strip():
            continue
        try:
            value = parse_json(part)
        except JsonLimitError as error:
            skips.append(Skip(line, str(error)))
            continue
        except ValueError:
            skips.append(Skip(line, "it is no JSON"))
            continue
        if isinstance(value, dict):
            rows.append((line, value))
        else:
            skips.append(Skip(line, f"it is a JSON {type(value).__name__}, expected an object"))
    return rows, skips


def _array(text: str) -> tuple[list[tuple[int, dict[str, Any]]], list[Skip]]:
    """Return the objects of an array by their number; of one that is cut off, those before the cut."""
    decoder = json.JSONDecoder()
    rows: list[tuple[int, dict[str, Any]]] = []
    skips: list[Skip] = []
    at, number = text.index("[") + 1, 0
    while True:
        while at < len(text) and text[at] in " \t\r\n,":
            at += 1
        if at >= len(text) or text[at] == "]":
            return rows, skips
        number += 1
        try:
            value, at = decoder.raw_decode(text, at)
            check_depth(value)
        except (ValueError, RecursionError):
            skips.append(Skip(number, "it is no JSON, and what follows it was not read"))
            return rows, skips
        if isinstance(value, dict):
            rows.append((number, value))
        else:
            skips.append(Skip(number, f"it is a JSON {type(value).__name__}, expected an object"))
