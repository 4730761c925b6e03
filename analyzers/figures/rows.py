"""Rows of values: a dot per value, and above the dots a box, their mean and its interval."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from hrclog.analyzers.figures.palette import CARD, MARK, WHITE
from hrclog.analyzers.figures.plot import NAMELESS, WIDE, Axis, Dot, Key, Plot, Rect, Stroke
from hrclog.analyzers.figures.series import BEYOND
from hrclog.analyzers.figures.text import shorten
from hrclog.analyzers.projections.mean_interval import mean_interval
from hrclog.arrays import FloatArray, IntArray
from hrclog.wording import counted

MAX_DOTS: Final = 500
"""The most dots of a row."""
MAX_ROWS: Final = 40

LONGEST_NAME: Final = 64

_BLUE: Final = MARK
_ROW: Final = 44
_DENSE_ROW: Final = 32
_MANY: Final = 12
_PAD: Final = 0.03  # of the span of the values
_BEYOND: Final = 0.25  # of it, as far as an interval may widen the axis
_MEAN_AT, _BOX_HALF = 0.32, 0.17  # of a row, from its top
_DOTS_AT, _DOTS_HALF = 0.72, 0.17
_GOLDEN: Final = 0.6180339887498949


@dataclass(frozen=True, slots=True)
class Row:
    """Values of one kind: at least one, and what each belongs to."""

    name: str
    values: tuple[float, ...]
    labels: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _DrawnRow:
    """A row at its place, its values in order, and the mean with its interval."""

    top: float
    row: Row
    values: FloatArray
    labels: tuple[str, ...]
    mean: float
    low: float | None
    high: float | None


def rows_plot(
    path: tuple[str, ...],
    title: str,
    reading: str,
    rows: Sequence[Row],
    label: str,
    *,
    unit: str = "",
    boxes: bool = False,
    zero: bool = False,
    notes: tuple[str, ...] = (),
) -> Plot:
    """Return a plot of rows in their order, the first on top.

    The axis holds all values. An interval that reaches far beyond them is clipped, and a note says so. The statistics
    are of all values, even if not every one is drawn. Values of `BEYOND` or more are placeholders and do not count.

    Args:
        path: of the plot.
        title: of the plot.
        reading: of the plot.
        rows: at least one; rows beyond `MAX_ROWS` are left out.
        label: of the axis of values.
        unit: written after each number, such as "s".
        boxes: whether to draw quartiles and median.
        zero: whether the axis holds 0, marked by a line.
        notes: what else is not drawn.
    """
    usable = [row for row in map(_drop_placeholders, rows) if row.values]
    drawn = [_place_row(top, row) for top, row in enumerate(usable[:MAX_ROWS])]
    axis = _axis_span(drawn, zero=zero) if drawn else (0.0, 1.0)
    return Plot(
        path=path,
        title=title,
        reading=reading,
        x=Axis(*axis, label, grid=True),
        y=Axis(
            max(len(drawn), 1),
            0,
            ticks=tuple((drawn_row.top + 0.5, _name(drawn_row)) for drawn_row in drawn) or NAMELESS,
        ),
        area=(WIDE, max(len(drawn), 1) * (_ROW if len(drawn) <= _MANY else _DENSE_ROW)),
        rects=tuple(_box(drawn_row, unit) for drawn_row in drawn if boxes and len(drawn_row.values) > 1),
        strokes=(*_line_at_zero(axis, len(drawn), zero=zero), *_all_strokes(drawn, axis, unit, boxes=boxes)),
        dots=tuple(dot for drawn_row in drawn for dot in _dots(drawn_row, unit)),
        keys=_keys(boxes=boxes),
        notes=(*notes, *(text for text in _not_drawn(rows, usable, drawn, axis) if text)),
    )


def _line_at_zero(axis: tuple[float, float], rows: int, *, zero: bool) -> tuple[Stroke, ...]:
    return (Stroke(((0.0, 0.0), (0.0, rows)), "muted", 1.0, "0"),) if zero and axis[0] < 0 else ()


def _all_strokes(
    drawn: Sequence[_DrawnRow], axis: tuple[float, float], unit: str, *, boxes: bool
) -> tuple[Stroke, ...]:
    return tuple(stroke for drawn_row in drawn for stroke in _strokes(drawn_row, axis, unit, boxes=boxes))


def _not_drawn(
    rows: Sequence[Row], usable: Sequence[Row], drawn: Sequence[_DrawnRow], axis: tuple[float, float]
) -> Iterator[str]:
    """Yield one note per kind of omission, "" if nothing of that kind is left out."""
    left_out = sum(len(row.values) for row in rows) - sum(len(row.values) for row in usable)
    ends = [
        (drawn_row.low, drawn_row.high)
        for drawn_row in drawn
        if drawn_row.low is not None and drawn_row.high is not None
    ]
    beyond = sum(low < axis[0] or high > axis[1] for low, high in ends)
    thinned = any(len(drawn_row.values) > MAX_DOTS for drawn_row in drawn)
    further = len(usable) - MAX_ROWS
    yield f"{counted(further, 'further row is', 'further rows are')} not drawn." if further > 0 else ""
    yield f"Of rows with more than {MAX_DOTS} runs as many are drawn; means are of all." if thinned else ""
    yield f"Intervals that reach beyond the axis: {beyond}." if beyond else ""
    yield f"Values beyond 1e12 that are left out, of the means too: {left_out}." if left_out else ""


def span(values: FloatArray, ends: Sequence[float]) -> tuple[float, float]:
    """Return the ends of an axis that holds all values, and the ends of intervals that are not far beyond them.

    Args:
        values: at least one, shape (n,).
        ends: of intervals.
    """
    least, most = float(values.min()), float(values.max())
    width = (most - least) or abs(most) or 1.0
    low = max(min([least, *ends]), least - _BEYOND * width)
    high = min(max([most, *ends]), most + _BEYOND * width)
    pad = _PAD * width if low < high else width
    return max(low - pad, -sys.float_info.max), min(high + pad, sys.float_info.max)


def spread(count: int) -> FloatArray:
    """Return offsets from -1 to 1 that separate the dots of near values, shape (count,). They are deterministic."""
    offsets: FloatArray = 2 * ((np.arange(count, dtype=np.float64) + 0.5) * _GOLDEN % 1.0) - 1
    return offsets


def evenly(count: int, most: int = MAX_DOTS) -> IntArray:
    """Return the indices to draw: all, or `most` of them, evenly spread from the first to the last."""
    return np.arange(count) if count <= most else np.linspace(0, count - 1, most).round().astype(np.int64)


def _drop_placeholders(row: Row) -> Row:
    """Return a row without the values that are placeholders."""
    indices = [index for index, value in enumerate(row.values) if abs(value) < BEYOND]
    if len(indices) == len(row.values):
        return row
    return replace(
        row, values=tuple(row.values[index] for index in indices), labels=tuple(row.labels[index] for index in indices)
    )


def _place_row(top: int, row: Row) -> _DrawnRow:
    order = sorted(range(len(row.values)), key=lambda index: (row.values[index], row.labels[index]))
    values = np.array([row.values[index] for index in order])
    return _DrawnRow(float(top), row, values, tuple(row.labels[index] for index in order), *mean_interval(values))


def _axis_span(drawn: Sequence[_DrawnRow], *, zero: bool) -> tuple[float, float]:
    values = np.concatenate([[0.0] if zero else [], *(drawn_row.values for drawn_row in drawn)])
    low, high = span(values, [end for drawn_row in drawn for end in (drawn_row.low, drawn_row.high) if end is not None])
    # values that are never negative need no axis below 0
    return (0.0 if zero and values.min() == 0 else low), high


def _name(drawn_row: _DrawnRow) -> str:
    return f"{shorten(drawn_row.row.name, LONGEST_NAME)} ({len(drawn_row.values):,})"


def _box(drawn_row: _DrawnRow, unit: str) -> Rect:
    low, high = np.quantile(drawn_row.values, (0.25, 0.75)).tolist()
    at = drawn_row.top + _MEAN_AT
    return Rect((low, at - _BOX_HALF), (high, at + _BOX_HALF), _BLUE, _label(drawn_row, unit))


def _strokes(drawn_row: _DrawnRow, axis: tuple[float, float], unit: str, *, boxes: bool) -> Iterator[Stroke]:
    at, label = drawn_row.top + _MEAN_AT, _label(drawn_row, unit)
    if boxes and len(drawn_row.values) > 1:
        median = float(np.median(drawn_row.values))
        yield Stroke(((median, at - _BOX_HALF), (median, at + _BOX_HALF)), "ink", 2.0, label)
    if drawn_row.low is not None and drawn_row.high is not None:
        yield Stroke(((max(drawn_row.low, axis[0]), at), (min(drawn_row.high, axis[1]), at)), "ink", 2.5, label)


def _dots(drawn_row: _DrawnRow, unit: str) -> Iterator[Dot]:
    indices = evenly(len(drawn_row.values))
    for index, offset in zip(indices.tolist(), spread(len(indices)).tolist(), strict=True):
        value = float(drawn_row.values[index])
        at = (value, drawn_row.top + _DOTS_AT + offset * _DOTS_HALF)
        yield Dot(at, 2.5, _BLUE, f"{drawn_row.labels[index]}: {_number(value, unit)}")
    yield Dot((drawn_row.mean, drawn_row.top + _MEAN_AT), 5.0, WHITE, _label(drawn_row, unit), rim=CARD)


def _label(drawn_row: _DrawnRow, unit: str) -> str:
    has_interval = drawn_row.low is not None and drawn_row.high is not None
    interval = f" (95 % {drawn_row.low:,.3f} to {drawn_row.high:,.3f})" if has_interval else ""
    return f"{drawn_row.row.name}: mean {_number(drawn_row.mean, unit)}{interval}, n = {len(drawn_row.values):,}"


def _number(value: float, unit: str) -> str:
    return f"{value:,.3f} {unit}".rstrip()


def _keys(*, boxes: bool) -> tuple[Key, ...]:
    quartiles = (Key("quartiles and median", _BLUE, "box"),) if boxes else ()
    return (
        Key("a run", _BLUE, "dot"),
        *quartiles,
        Key("mean", WHITE, "dot", rim=CARD),
        Key("its 95 % interval", "ink", "line"),
    )
