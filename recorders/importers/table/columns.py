"""A mapping against the columns that a table has: which are read, and the values that each source gives."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from difflib import get_close_matches
from typing import Any, Final

import polars as pl

from hrclog.errors import ImportDataError
from hrclog.recorders.importers.table.mapping import Source, TableMapping
from hrclog.recorders.importers.table.skipped import Skip
from hrclog.recorders.importers.table.tables import LINE, Cells, Table

_MOST_NAMES: Final = 40  # that a message lists
TIER: Final = "\0tier"
"""Column of the agent that the name of a tier tells."""
_TIER_TASK: Final = "\0tier task"
_NUMBERED: Final = re.compile(r"#(-?\d+)")


@dataclass(frozen=True, slots=True)
class Bound:
    """A mapping whose columns all are there, and the cells of those.

    Attributes:
        mapping: its columns are the table's.
        cells: of those columns, a row per row, or per entry of rows that hold lists.
    """

    mapping: TableMapping
    cells: Cells

    def values(self, source: Source | None) -> pl.Series | None:
        """Return what a source gives for each row, None where there is no source."""
        if source is None:
            return None
        if not source.column:
            return pl.Series("constant", [source.constant], pl.String).new_from_index(0, self.cells.frame.height)
        values = self.cells.frame[source.column]
        if not source.pattern:
            return values
        return values.cast(pl.String).str.extract(source.pattern, 1)


def bind(table: Table, mapping: TableMapping) -> Bound:
    """Return a mapping with the columns of a table, and their cells.

    Args:
        table: the table.
        mapping: what its columns mean.

    Raises:
        ImportDataError: the table lacks a column.
    """
    bound = _with_names_of(table, mapping)
    tiers = _tiers(table, bound)
    names = [name for name in bound.columns() if name != TIER]
    if bound.run_start in table.names:
        names.append(bound.run_start)
    cells = table.read(list(dict.fromkeys([*names, *tiers])))
    if tiers:
        cells = _unpivoted(cells, names, tiers)
        bound = replace(bound, agent=Source(column=TIER), task=Source(column=_TIER_TASK))
    return Bound(bound, _exploded(cells))


def _with_names_of(table: Table, mapping: TableMapping) -> TableMapping:
    """Return a mapping whose numbered and abbreviated columns have the names of a table."""
    changes: dict[str, Any] = {}
    for spec in fields(mapping):
        value = getattr(mapping, spec.name)
        if isinstance(value, Source) and value.column:
            changes[spec.name] = replace(value, column=_named(table, value.column))
    changes["run"] = tuple(
        part for source in mapping.run for part in _split_run(table, source)
    )  # fmt: skip
    changes["tag_columns"] = tuple(_named(table, name) for name in mapping.tag_columns)
    changes["pair_by"] = tuple(name for pattern in mapping.pair_by for name in _begin_so(table, pattern))
    return replace(mapping, **changes)


def _split_run(table: Table, source: Source) -> list[Source]:
    """Return the columns of `--run A,B`; a comma may also be part of a column's name."""
    if not source.column or source.column in table.names or "," not in source.column:
        return [replace(source, column=_named(table, source.column)) if source.column else source]
    return [replace(source, column=_named(table, part.strip())) for part in source.column.split(",") if part.strip()]


def _begin_so(table: Table, pattern: str) -> list[str]:
    if pattern.endswith("*"):
        return [name for name in table.names if name.startswith(pattern[:-1])]
    return [_named(table, pattern)]


def _named(table: Table, name: str) -> str:
    """Return the table's name of a column.

    Raises:
        ImportDataError: it has no such column.
    """
    if name in table.names:
        return name
    numbered = _NUMBERED.fullmatch(name)
    if numbered and 0 < abs(int(numbered[1])) <= len(table.names):
        position = int(numbered[1])
        return table.names[position - 1 if position > 0 else position]
    listed = ", ".join(map(repr, table.names[:_MOST_NAMES]))
    others = len(table.names) - _MOST_NAMES
    expected = f"one of {listed}{f' and {others:,} more' if others > 0 else ''}"
    close = get_close_matches(name, table.names[:10_000], 1)
    raise ImportDataError(table.path, f"no column {name!r}", expected, f"did you mean {close[0]!r}?" if close else "")


def _tiers(table: Table, mapping: TableMapping) -> dict[str, str]:
    """Return the columns that each hold the tasks of one agent, and the agents."""
    if not mapping.tiers:
        return {}
    matches = {name: re.search(mapping.tiers, name) for name in table.names}
    tiers = {name: match[1] for name, match in matches.items() if match}
    if not tiers:
        listed = ", ".join(map(repr, table.names[:_MOST_NAMES]))
        raise ImportDataError(table.path, f"no column like {mapping.tiers!r}", f"some among {listed}")
    return tiers


def _unpivoted(cells: Cells, names: Sequence[str], tiers: dict[str, str]) -> Cells:
    """Return a row per filled cell of the tiers."""
    rows = cells.frame.unpivot(
        on=list(tiers), index=[LINE, *names], variable_name=TIER, value_name=_TIER_TASK
    ).with_columns(pl.col(TIER).replace_strict(tiers, return_dtype=pl.String))
    filled = pl.col(_TIER_TASK).cast(pl.String).str.strip_chars().fill_null("") != ""
    return Cells(rows.filter(filled).sort(LINE, maintain_order=True), cells.skips)


def _exploded(cells: Cells) -> Cells:
    """Return a row per entry of the lists that rows hold; rows whose lists differ in length are skipped."""
    arrays = [name for name, kind in cells.frame.schema.items() if isinstance(kind, pl.Array)]
    frame = cells.frame.with_columns(pl.col(name).arr.to_list() for name in arrays)
    lists = [name for name, kind in frame.schema.items() if isinstance(kind, pl.List)]
    if not lists:
        return cells
    frame = frame.with_columns(pl.col(name).cast(pl.List(pl.Null)) for name in lists if frame.schema[name] == pl.Null)
    lengths = frame.select(pl.col(lists).list.len())
    longest = lengths.select(pl.max_horizontal(lists)).to_series()
    even = lengths.select(pl.all_horizontal((pl.col(name) == longest) | pl.col(name).is_null() for name in lists))
    is_even = even.to_series()
    reason = f"its lists of {', '.join(lists)} differ in length"
    skips = [*cells.skips, *(Skip(line, reason) for line in frame.filter(~is_even)[LINE])]
    filled = frame.filter(is_even & (longest > 0).fill_null(value=False))
    # a list that is missing beside others is missing in each of its rows
    whole = [name for name in lists if filled[name].null_count() == 0]
    empty = [name for name in lists if name not in whole]
    rows = filled.with_columns(pl.lit(None).alias(name) for name in empty)
    return Cells(rows.explode(whole) if whole else rows.clear(), skips)
