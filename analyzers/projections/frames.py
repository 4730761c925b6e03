"""The frames that public functions expect, and the error message for anything else."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import PurePath
from typing import Final

import polars as pl

from hrclog.analyzers.projections import schemas
from hrclog.errors import HrclogError
from hrclog.log.messages.message import EVENTS
from hrclog.wording import counted

_MOST_NAMED: Final = 4
"""Columns that a message names."""


@dataclass(frozen=True, slots=True)
class FrameKind:
    """A kind of frame: what it holds, its columns, the Python that makes one, and the page on its columns."""

    name: str
    schema: pl.Schema
    made_by: str
    page: str = "docs/tables.md"


EVENTS_FRAME: Final = FrameKind("events", EVENTS, "hrclog.read_events(LOGS)", page="docs/events.md")
INTERVALS_FRAME: Final = FrameKind("intervals", schemas.INTERVALS, "hrclog.intervals(hrclog.read_events(LOGS))")
SIGNALS_FRAME: Final = FrameKind("signals", schemas.SIGNALS, "hrclog.read_logs(LOGS, signals=True).signals")

_KNOWN: Final = {
    "events": EVENTS,
    "intervals": schemas.INTERVALS,
    "overlaps": schemas.OVERLAPS,
    "durations": schemas.DURATIONS,
    "synergies": schemas.SYNERGIES,
    "runs": schemas.RUNS,
    "metrics": schemas.METRICS,
    "signals": schemas.SIGNALS,
}


def check_frame(frame: object, kind: FrameKind) -> None:
    """Refuse what is no frame of a kind; further columns are allowed, and rows are not looked at.

    Raises:
        HrclogError: says what was found, what was expected, and what makes such a frame.
    """
    if not isinstance(frame, pl.DataFrame):
        raise _error(kind, _describe_value(frame, kind))
    schema = frame.schema
    if any(schema.get(name) != dtype for name, dtype in kind.schema.items()):
        raise _error(kind, f"{_guess_kind(schema)} {' and '.join(_differences(schema, kind.schema))}")


def _error(kind: FrameKind, description: str) -> HrclogError:
    expected = f"a polars DataFrame with the columns of {kind.name} ({kind.page})"
    return HrclogError(f"{kind.name}: found {description}, expected {expected}; {kind.made_by} makes one")


def _describe_value(value: object, kind: FrameKind) -> str:
    """Describe a value that is no polars DataFrame, and how to make one of it."""
    if value is None:
        return "None"
    if isinstance(value, str | PurePath):
        return f"the path {str(value)!r}"
    if isinstance(value, pl.LazyFrame):
        return "a LazyFrame (its collect() makes a DataFrame)"
    package = type(value).__module__.partition(".")[0]
    if package == "pandas":
        return f"a pandas {type(value).__name__} (polars.from_pandas makes a DataFrame)"
    # logs hold events, an analysis holds intervals too
    holds_frame = isinstance(getattr(value, kind.name, None), pl.DataFrame)
    return f"a value of type {type(value).__name__}{f' (its .{kind.name} is such a frame)' if holds_frame else ''}"


def _guess_kind(schema: pl.Schema) -> str:
    """Guess which kind of frame a schema belongs to."""
    kinds = [name for name, known in _KNOWN.items() if known.keys() <= schema.keys()]
    return f"a frame of {kinds[0]}" if kinds else "a frame"


def _differences(schema: pl.Schema, expected: pl.Schema) -> Iterator[str]:
    missing = [name for name in expected if name not in schema]
    if missing:
        yield f"without {_list_names(missing)}"
    wrong = [
        f"{name} as {schema[name]} instead of {dtype}"
        for name, dtype in expected.items()
        if name in schema and schema[name] != dtype
    ]
    if wrong:
        yield f"with {_list_names(wrong)}"


def _list_names(names: list[str]) -> str:
    rest = len(names) - _MOST_NAMED
    more = f" and {counted(rest, 'more column')}" if rest > 0 else ""
    return ", ".join(names[:_MOST_NAMED]) + more
