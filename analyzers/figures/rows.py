"""Rows of values: a dot per value, and above the dots their box, their mean and its interval."""

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
"""Dots of a row."""
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
class _Drawn:
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

    The axis holds all values; an interval that reaches far beyond them is clipped, which is said. The statistics are of
    all values, also where not every one is drawn, but for those of `BEYOND` or more: these stand for something else.

    Args:
        path: of the plot.
        title: of the plot.
        reading: of the plot.
        rows: at least one; beyond `MAX_ROWS` they are left out.
        label: of the axis of values.
        unit: after each number, "s" say.
        boxes: whether to draw quartiles and median.
        zero: whether the axis holds 0, marked by a line.
        notes: what else is not drawn.
    """
    known = [row for row in map(_known, rows) if row.values]
    drawn = [_placed(top, row) for top, row in enumerate(known[:MAX_ROWS])]
    axis = _span(drawn, zero=zero) if drawn else (0.0, 1.0)
    return Plot(
        path=path,
        title=title,
        reading=reading,
        x=Axis(*axis, label, grid=True),
        y=Axis(max(len(drawn), 1), 0, ticks=tuple((one.top + 0.5, _name(one)) for one in drawn) or NAMELESS),
        area=(WIDE, max(len(drawn), 1) * (_ROW if len(drawn) <= _MANY else _DENSE_ROW)),
        rects=tuple(_box(one, unit) for one in drawn if boxes and len(one.values) > 1),
        strokes=(*_line_at_zero(axis, len(drawn), zero=zero), *_all_strokes(drawn, axis, unit, boxes=boxes)),
        dots=tuple(dot for one in drawn for dot in _dots(one, unit)),
        keys=_keys(boxes=boxes),
        notes=(*notes, *(text for text in _not_drawn(rows, known, drawn, axis) if text)),
    )


def _line_at_zero(axis: tuple[float, float], rows: int, *, zero: bool) -> tuple[Stroke, ...]:
    return (Stroke(((0.0, 0.0), (0.0, rows)), "muted", 1.0, "0"),) if zero and axis[0] < 0 else ()


def _all_strokes(drawn: Sequence[_Drawn], axis: tuple[float, float], unit: str, *, boxes: bool) -> tuple[Stroke, ...]:
    return tuple(stroke for one in drawn for stroke in _strokes(one, axis, unit, boxes=boxes))


def _not_drawn(
    rows: Sequence[Row], known: Sequence[Row], drawn: Sequence[_Drawn], axis: tuple[float, float]
) -> Iterator[str]:
    """Yield what the plot leaves out, "" where it leaves out nothing of a kind."""
    left_out = sum(len(row.values) for row in rows) - sum(len(row.values) for row in known)
    ends = [(one.low, one.high) for one in drawn if one.low is not None and one.high is not None]
    beyond = sum(low < axis[0] or high > axis[1] for low, high in ends)
    thinned = any(len(one.values) > MAX_DOTS for one in drawn)
    further = len(known) - MAX_ROWS
    yield f"{counted(further, 'further row is', 'further rows are')} not drawn." if further > 0 else ""
    yield f"Of rows with more than {MAX_DOTS} runs as many are drawn; means are of all." if thinned else ""
    yield f"Intervals that reach beyond the axis: {beyond}." if beyond else ""
    yield f"Values beyond 1e12 that are left out, of the means too: {left_out}." if left_out else ""


def span(values: FloatArray, ends: Sequence[float]) -> tuple[float, float]:
    """Return an axis that holds all values, and ends of intervals unless they are far beyond them.

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
    """Return offsets from -1 to 1 by which dots of near values stand apart, shape (count,); always the same ones."""
    offsets: FloatArray = 2 * ((np.arange(count, dtype=np.float64) + 0.5) * _GOLDEN % 1.0) - 1
    return offsets


def evenly(count: int, most: int = MAX_DOTS) -> IntArray:
    """Return the indices of those to draw: all, or `most` spread evenly, the first and the last among them."""
    return np.arange(count) if count <= most else np.linspace(0, count - 1, most).round().astype(np.int64)


def _known(row: Row) -> Row:
    """Return a row without the values that stand for something else."""
    known = [index for index, value in enumerate(row.values) if abs(value) < BEYOND]
    if len(known) == len(row.values):
        return row
    return replace(
        row, values=tuple(row.values[index] for index in known), labels=tuple(row.labels[index] for index in known)
    )


def _placed(top: int, row: Row) -> _Drawn:
    order = sorted(range(len(row.values)), key=lambda index: (row.values[index], row.labels[index]))
    values = np.array([row.values[index] for index in order])
    return _Drawn(float(top), row, values, tuple(row.labels[index] for index in order), *mean_interval(values))


def _span(drawn: Sequence[_Drawn], *, zero: bool) -> tuple[float, float]:
    values = np.concatenate([[0.0] if zero else [], *(one.values for one in drawn)])
    low, high = span(values, [end for one in drawn for end in (one.low, one.high) if end is not None])
    # what is never negative has no axis below 0
    return (0.0 if zero and values.min() == 0 else low), high


def _name(one: _Drawn) -> str:
    return f"{shorten(one.row.name, LONGEST_NAME)} ({len(one.values):,})"


def _box(one: _Drawn, unit: str) -> Rect:
    low, high = np.quantile(one.values, (0.25, 0.75)).tolist()
    at = one.top + _MEAN_AT
    return Rect((low, at - _BOX_HALF), (high, at + _BOX_HALF), _BLUE, _said(one, unit))


def _strokes(one: _Drawn, axis: tuple[float, float], unit: str, *, boxes: bool) -> Iterator[Stroke]:
    at, said = one.top + _MEAN_AT, _said(one, unit)
    if boxes and len(one.values) > 1:
        median = float(np.median(one.values))
        yield Stroke(((median, at - _BOX_HALF), (median, at + _BOX_HALF)), "ink", 2.0, said)
    if one.low is not None and one.high is not None:
        yield Stroke(((max(one.low, axis[0]), at), (min(one.high, axis[1]), at)), "ink", 2.5, said)


def _dots(one: _Drawn, unit: str) -> Iterator[Dot]:
    shown = evenly(len(one.values))
    for index, off in zip(shown.tolist(), spread(len(shown)).tolist(), strict=True):
        value = float(one.values[index])
        at = (value, one.top + _DOTS_AT + off * _DOTS_HALF)
        yield Dot(at, 2.5, _BLUE, f"{one.labels[index]}: {_number(value, unit)}")
    yield Dot((one.mean, one.top + _MEAN_AT), 5.0, WHITE, _said(one, unit), rim=CARD)


def _said(one: _Drawn, unit: str) -> str:
    known = one.low is not None and one.high is not None
    interval = f" (95 % {one.low:,.3f} to {one.high:,.3f})" if known else ""
    return f"{one.row.name}: mean {_number(one.mean, unit)}{interval}, n = {len(one.values):,}"


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
