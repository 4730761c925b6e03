"""Coefficients as a plot: a row per pair of tasks, a line at 1, factors from left to right."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

from hrclog.analyzers.figures.coefficients import Coefficient, Coefficients
from hrclog.analyzers.figures.curves import log_ticks
from hrclog.analyzers.figures.palette import Color, Paint
from hrclog.analyzers.figures.plot import NAMELESS, NARROW, Axis, Dot, Key, Plot, Stroke, Text
from hrclog.wording import counted

_WIDEST: Final = 5.0
_WIDEST_LOG: Final = 100.0
_ROW: Final = 26
_LONGER: Final[Color] = (222, 111, 38)
_SHORTER: Final[Color] = (62, 139, 190)
_UNSURE: Final[Color] = (140, 147, 156)

_KEYS: Final = (
    Key("slower", _LONGER, "line"),
    Key("faster", _SHORTER, "line"),
    Key("interval holds 1", _UNSURE, "line"),
    Key("sparse or weakly identified", "card", "dot", rim=_UNSURE),
)


def coefficients_plot(plot: Coefficients, path: tuple[str, ...]) -> Plot:
    """Return a row per coefficient with its 95 % interval.

    The axis holds all estimates. It is linear if a factor is not above 0, else logarithmic. Intervals that reach beyond
    100 (beyond 5 on a linear axis) are clipped, and an arrow marks them.
    """
    log = all(row.value > 0 for row in plot.rows)
    low, high, clipped = _axis_ends(plot.rows, log=log)
    drawn = [(index + 0.5, row) for index, row in enumerate(plot.rows)]
    count = max(len(drawn), 1)
    names = tuple((y, f"{row.name} ({row.n})") for y, row in drawn)
    no_effect = [Stroke(((1.0, 0.0), (1.0, count)), "muted", 1.5, "1: no effect")] if drawn else []
    return Plot(
        path=path,
        title=plot.title,
        reading=plot.reading,
        x=_axis(low, high, log=log),
        y=Axis(count, 0, ticks=names or NAMELESS),
        area=(NARROW, count * _ROW),
        strokes=(*no_effect, *(stroke for y, row in drawn for stroke in _strokes(row, y, (low, high), log=log))),
        texts=tuple(arrow for y, row in drawn for arrow in _arrows(row, y, (low, high))),
        dots=tuple(_dot(row, y) for y, row in drawn),
        keys=_KEYS if drawn else (),
        notes=(*plot.captions, *_clipped_note(clipped)),
    )


def _axis_ends(rows: Sequence[Coefficient], *, log: bool) -> tuple[float, float, int]:
    """Return the ends of the axis, and how many intervals reach beyond it."""
    values = [row.value for row in rows]
    lows = [row.value if row.low is None else row.low for row in rows]
    highs = [row.value if row.high is None else row.high for row in rows]
    widest = _WIDEST_LOG if log else _WIDEST
    least = min([1 / widest, *(0.9 * value for value in values)])
    furthest = max([widest, *(1.1 * value for value in values)])
    low, high = max(min([0.8, *lows]), least), min(max([1.2, *highs]), furthest)
    return low, high, sum(first < low or last > high for first, last in zip(lows, highs, strict=True))


def _clipped_note(clipped: int) -> tuple[str, ...]:
    if not clipped:
        return ()
    which = counted(clipped, "interval reaches", "intervals reach")
    return (f"{which} beyond the axis; the table has the ends.",)


def _axis(low: float, high: float, *, log: bool) -> Axis:
    """Return the axis of factors. On a logarithmic axis, 2 and 0.5 are equally far from 1."""
    label = "factor on the duration"
    if log:
        return Axis(low / 1.02, high * 1.02, label, log_ticks(low, high), log=True, grid=True)
    margin = 0.02 * (high - low)
    return Axis(low - margin, high + margin, label, grid=True)


def _strokes(row: Coefficient, y: float, ends: tuple[float, float], *, log: bool) -> Iterator[Stroke]:
    """Yield a thin interval and a thick standard error, which on a logarithmic axis is that of the logarithm."""
    spans = []
    if row.low is not None and row.high is not None:
        spans.append((row.low, row.high, 1.5))
    if row.std_err is not None and log:
        ratio = math.exp(row.std_err / row.value)  # delta method
        spans.append((row.value / ratio, row.value * ratio, 4.5))
    elif row.std_err is not None:
        spans.append((row.value - row.std_err, row.value + row.std_err, 4.5))
    for low, high, width in spans:
        yield Stroke(((max(low, ends[0]), y), (min(high, ends[1]), y)), _paint(row), width, _label(row))


def _arrows(row: Coefficient, y: float, ends: tuple[float, float]) -> Iterator[Text]:
    """Yield an arrow head at each end of the axis that an interval reaches beyond."""
    if row.low is not None and row.low < ends[0]:
        yield Text((ends[0], y), "◂", _paint(row), 14)
    if row.high is not None and row.high > ends[1]:
        yield Text((ends[1], y), "▸", _paint(row), 14)


def _dot(row: Coefficient, y: float) -> Dot:
    paint = _paint(row)
    return Dot((row.value, y), 5.0, paint if row.status in ("", "ok") else "card", _label(row), rim=paint)


def _paint(row: Coefficient) -> Paint:
    certain = row.low is not None and row.high is not None and (row.low > 1 or row.high < 1)
    return (_LONGER if row.value > 1 else _SHORTER) if certain else _UNSURE


def _label(row: Coefficient) -> str:
    error = f" +- {row.std_err:.3f}" if row.std_err is not None else ""
    interval = f" (95 % {row.low:.3f} to {row.high:.3f})" if row.low is not None and row.high is not None else ""
    return f"{row.full}: {row.value:.3f}{error}{interval}, n = {row.n}, {row.status}"
