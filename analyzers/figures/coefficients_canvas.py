"""Where the shapes of a plot of coefficients lie on its sheet."""

from __future__ import annotations

from typing import Final

from hrclog.analyzers.figures.canvas import Canvas, Dot, Stroke
from hrclog.analyzers.figures.coefficients import Coefficient, Coefficients
from hrclog.analyzers.figures.palette import CARD, MUTED, Color, blend
from hrclog.analyzers.figures.plot_frame import NARROW, Row, plot_frame

_WIDEST: Final = 5.0
_LONGER: Final[Color] = (239, 138, 71)
_SHORTER: Final[Color] = (103, 169, 207)


def coefficients_canvas(plot: Coefficients) -> Canvas:
    """Return a row per coefficient, a line at 1, factors from left to right.

    Estimates are within the axis; intervals that reach beyond it, and beyond 5, are clipped, which is said.
    """
    lows = [row.value if row.low is None else row.low for row in plot.rows]
    highs = [row.value if row.high is None else row.high for row in plot.rows]
    furthest = max([_WIDEST, *(1.1 * row.value for row in plot.rows)])
    ends = max(min([0.8, *lows]), 0.0), min(max([1.2, *highs]), furthest)
    clipped = sum(low < ends[0] or high > ends[1] for low, high in zip(lows, highs, strict=True))
    beyond = [f"{clipped} intervals reach beyond the axis; the table has their ends."] if clipped else []
    rows = [Row(f"{row.name}  ({row.n})") for row in plot.rows]
    frame = plot_frame(plot.title, "factor on the duration", rows, ends, [*plot.captions, *beyond], NARROW)
    one = frame.scale.at(1.0)
    strokes = [Stroke(((one, frame.top), (one, frame.bottom)), MUTED, 1.5, "1: no effect")]
    dots = []
    for index, row in enumerate(plot.rows):
        y, color, label = frame.middle(index), _color(row), _said(row)
        if row.low is not None and row.high is not None:
            strokes.append(Stroke(((frame.scale.at(row.low), y), (frame.scale.at(row.high), y)), color, 2.5, label))
        dots.append(Dot((frame.scale.at(row.value), y), 5.5, color, label))
        if row.status not in ("", "ok"):
            dots.append(Dot((frame.scale.at(row.value), y), 3.0, CARD, label))
    return Canvas(plot.title, frame.sheet.pixels(), (), tuple(strokes), tuple(dots))


def _said(row: Coefficient) -> str:
    interval = f" (95 % {row.low:.3f} to {row.high:.3f})" if row.low is not None and row.high is not None else ""
    return f"{row.name}: {row.value:.3f}{interval}, n = {row.n}, {row.status}"


def _color(row: Coefficient) -> Color:
    certain = row.low is not None and row.high is not None and (row.low > 1 or row.high < 1)
    color = _LONGER if row.value > 1 else _SHORTER
    return color if certain else blend(color, MUTED, 0.6)
