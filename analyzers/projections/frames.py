"""Check the frames that users hand to the projections, so that a wrong one ends in a sentence and no traceback."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import polars as pl

from hrclog.analyzers.projections.schemas import DURATIONS, INTERVALS, METRICS, OVERLAPS, RUNS, SIGNALS, SYNERGIES
from hrclog.errors import FrameError
from hrclog.log.message import EVENTS


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of frame: what it is called, its columns and where they are defined, and the call that makes one."""

    name: str
    schema: pl.Schema
    defined_as: str
    made_by: str


_SCHEMAS: Final = "hrclog.analyzers.projections.schemas"

EVENTS_FRAME: Final = Kind("events", EVENTS, "hrclog.log.message.EVENTS", "hrclog.read_events(paths)")
INTERVALS_FRAME: Final = Kind("intervals", INTERVALS, f"{_SCHEMAS}.INTERVALS", "hrclog.intervals(events)")
SIGNALS_FRAME: Final = Kind("signals", SIGNALS, f"{_SCHEMAS}.SIGNALS", "hrclog.read_logs(paths, signals=True).signals")

_KNOWN: Final[Mapping[str, pl.Schema]] = {
    "events": EVENTS,
    "intervals": INTERVALS,
    "signals": SIGNALS,
    "overlaps": OVERLAPS,
    "durations": DURATIONS,
    "synergies": SYNERGIES,
    "metrics": METRICS,
    "runs": RUNS,
}
"""The frames that a user may have at hand, to call a mistaken one by its name."""

_CONVERSIONS: Final[Mapping[str, str]] = {
    "pandas": "polars.from_pandas(frame) makes a polars frame of it",
    "pyarrow": "polars.from_arrow(table) makes a polars frame of it",
}


def check_frame(frame: object, kind: Kind) -> None:
    """Make sure that a value is a frame of a kind; further columns and any order of columns are fine.

    Args:
        frame: what a user handed over.
        kind: what it should be.

    Raises:
        FrameError: it is no polars frame, or columns are missing or of a wrong type.
    """
    if not isinstance(frame, pl.DataFrame):
        remedy = _conversion(frame, kind.name) or f"{kind.made_by} makes one"
        raise FrameError(_described(frame), _expected(kind), remedy)
    schema = frame.schema
    if schema == kind.schema:
        return
    if faults := [*_missing(schema, kind.schema), *_wrong_types(schema, kind.schema)]:
        raise FrameError(f"{_called(schema)}, {'; '.join(faults)}", _expected(kind), f"{kind.made_by} makes one")


def _expected(kind: Kind) -> str:
    return f"a polars frame of {kind.name} (schema {kind.defined_as})"


def _described(value: object) -> str:
    if value is None:
        return "None"
    if isinstance(value, str | Path):
        return f"the path {str(value)!r}"
    package = _package(value)
    return f"a {'' if package == 'builtins' else f'{package} '}{type(value).__qualname__}"


def _conversion(value: object, kind: str) -> str:
    """Return how to get a polars frame from a value, "" where that is not known."""
    if isinstance(value, pl.LazyFrame):
        return "its collect() makes one"
    if isinstance(getattr(value, kind, None), pl.DataFrame):  # logs have events, analyses have intervals too
        return f"its .{kind} is one"
    return _CONVERSIONS.get(_package(value), "")


def _package(value: object) -> str:
    return type(value).__module__.partition(".")[0]


def _called(schema: pl.Schema) -> str:
    """Return what a polars frame is called: the kind of which it has all columns, or just a frame."""
    names = [name for name, known in _KNOWN.items() if known.keys() <= schema.keys()]
    return f"a frame of {names[0]}" if names else "a polars frame"


def _missing(schema: pl.Schema, expected: pl.Schema) -> list[str]:
    names = [name for name in expected if name not in schema]
    return [f"without the columns {', '.join(names)}"] if names else []


def _wrong_types(schema: pl.Schema, expected: pl.Schema) -> list[str]:
    wrong = [
        f"{name} ({schema[name]}, not {kind})"
        for name, kind in expected.items()
        if name in schema and schema[name] != kind
    ]
    return [f"with columns of a wrong type: {', '.join(wrong)}"] if wrong else []
