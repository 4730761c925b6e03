"""Frames into rows that every database gives back as they were."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import polars as pl
from polars import selectors
from sqlalchemy import BigInteger, Double, Table, Text

_NUL: Final = "\0"
_SHOWN_NUL: Final = "\N{SYMBOL FOR NULL}"


def clean_text(text: str) -> str:
    """Return a text without NUL, which PostgreSQL has no place for."""
    return text.replace(_NUL, _SHOWN_NUL)


def clean(frame: pl.DataFrame) -> pl.DataFrame:
    """Return a frame without NUL in texts, numbers that are not finite (no JSON has them) and -0.0 (0.0 in SQLite)."""
    real = selectors.float()
    return frame.with_columns(
        selectors.string().str.replace_all(_NUL, _SHOWN_NUL, literal=True),
        pl.when(real.is_finite() & (real != 0.0)).then(real).when(real == 0.0).then(0.0),
    )


def frame_schema(table: Table) -> pl.Schema:
    """Return the columns of a table as those of a frame."""
    kinds: dict[type, type[pl.DataType]] = {Text: pl.String, BigInteger: pl.Int64, Double: pl.Float64}
    return pl.Schema({column.name: kinds[type(column.type)]() for column in table.columns})


def frame_of(rows: Sequence[Sequence[Any]], schema: pl.Schema) -> pl.DataFrame:
    """Return rows as a frame."""
    columns = zip(*rows, strict=True) if rows else ((),) * len(schema)
    return pl.DataFrame(
        [
            pl.Series(name, values, kind, strict=True)
            for (name, kind), values in zip(schema.items(), columns, strict=True)
        ]
    )
