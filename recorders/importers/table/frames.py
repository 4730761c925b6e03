"""Tables in memory, of any library that narwhals knows, as polars frames.

Frames of pandas need care: what is not there is NaN, NaT or None, an index may hold what others keep in columns, and a
column of objects may hold several types. Cells of such a column are read as their texts, as they are in a file.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime, timedelta
from typing import Any, Final

import polars as pl

from hrclog.errors import HrclogError
from hrclog.recorders.importers.table.tables import unique_names

_EXPECTED: Final = "expected a frame of polars, pandas, pyarrow, duckdb or another library that narwhals knows"
_LONGEST_REASON: Final = 300
_AS_TEXTS: Final = ("period", "interval", "complex")
"""Beginnings of the names of pandas' types that polars has nothing like."""


def as_polars(frame: Any) -> pl.DataFrame:  # noqa: ANN401 - a frame of any library
    """Return a table of any library that narwhals knows, or that speaks Arrow, as a polars frame.

    Raises:
        HrclogError: it is no table, or cannot be read.
    """
    if isinstance(frame, pl.DataFrame):
        return frame
    try:
        polars_frame = _converted(frame)
    except Exception as error:  # a lazy frame is computed here, and its library may raise anything
        reason = " ".join(str(error).split())[:_LONGEST_REASON] or type(error).__name__
        raise _no_table(frame, f" ({reason})") from error
    if polars_frame is None:
        raise _no_table(frame, "")
    return polars_frame


def _no_table(frame: object, reason: str) -> HrclogError:
    return HrclogError(f"from_table: found {type(frame).__name__} that is no table{reason}, {_EXPECTED}")


def _converted(frame: Any) -> pl.DataFrame | None:  # noqa: ANN401 - as `as_polars`
    """Return a frame in polars, None if it is no table."""
    import narwhals.stable.v2 as nw

    known = nw.from_native(nw.to_native(frame, pass_through=True), pass_through=True)
    if isinstance(known, nw.LazyFrame):
        known = known.collect("polars")
    if not isinstance(known, nw.DataFrame):
        is_table = hasattr(frame, "__arrow_c_stream__") or isinstance(frame, Mapping | list)
        return pl.DataFrame(frame) if is_table and not hasattr(frame, "to_frame") else None
    if known.implementation.is_pandas_like():
        return _from_pandas(known.to_pandas())
    return known.to_polars()


def _from_pandas(frame: Any) -> pl.DataFrame:  # noqa: ANN401 - pandas ships no types
    whole = _with_index(frame)
    names = unique_names([_name(label) for label in whole.columns])
    return pl.DataFrame([_column(whole.iloc[:, at]).alias(name) for at, name in enumerate(names)])


def _with_index(frame: Any) -> Any:  # noqa: ANN401 - as `_from_pandas`
    """Return a frame with the levels of its index as columns, but for numbers of rows and what is a column already."""
    columns = {_name(label) for label in frame.columns}
    levels = [frame.index.get_level_values(at).to_series(index=frame.index) for at in range(frame.index.nlevels)]
    whole = frame.copy(deep=False)
    for level in reversed(levels):
        is_number_of_row = level.name is None and level.dtype.kind in "iu"
        name = "index" if level.name is None else level.name
        if not is_number_of_row and _name(name) not in columns and len(level):
            whole.insert(0, name, level.array, allow_duplicates=True)
    return whole


def _name(label: object) -> str:
    """Return the name of a column; one of several levels has them joined, as in start_min."""
    parts = label if isinstance(label, tuple) else (label,)
    return "_".join(str(part) for part in parts if part != "")


def _column(column: Any) -> pl.Series:  # noqa: ANN401 - as `_from_pandas`
    known = column.sparse.to_dense() if str(column.dtype).startswith("Sparse") else column
    series = _objects(known) if known.dtype == object else _typed(known)
    return _texts(known) if series is None or series.dtype == pl.Object else series


def _typed(column: Any) -> pl.Series | None:  # noqa: ANN401 - as `_from_pandas`
    """Return a column whose cells have one type, None if polars has nothing like it."""
    if column.dtype == object or str(column.dtype).startswith(_AS_TEXTS):
        return None
    try:
        series: pl.Series = pl.Series(pl.from_pandas(column))
    except Exception:  # noqa: BLE001 - pyarrow has many reasons for not knowing a type
        return None
    return series


def _objects(column: Any) -> pl.Series | None:  # noqa: ANN401 - as `_from_pandas`
    """Return a column of objects that are all of one type, None where they are not."""
    cells = [None if is_null else cell for cell, is_null in zip(column.tolist(), column.isna().tolist(), strict=True)]
    kinds = {type(cell) for cell in cells} - {type(None)}
    if kinds and all(issubclass(kind, datetime | timedelta) for kind in kinds):
        return _typed(column.infer_objects())  # which keeps instants of different zones as objects
    if len(kinds) > 1:
        return None
    try:
        return pl.Series(values=cells)
    except Exception:  # noqa: BLE001 - such as numbers beyond 64 bits
        return None


def _texts(column: Any) -> pl.Series:  # noqa: ANN401 - as `_from_pandas`
    cells = zip(column.tolist(), column.isna().tolist(), strict=True)
    return pl.Series(values=[None if is_null else str(cell) for cell, is_null in cells], dtype=pl.String)
