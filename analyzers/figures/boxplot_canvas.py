"""Where the shapes of a box plot lie on its sheet."""

from __future__ import annotations

from itertools import groupby
from typing import Final

from hrclog.analyzers.figures.axis import Axis
from hrclog.analyzers.figures.boxplot import Box, BoxPlot
from hrclog.analyzers.figures.canvas import Canvas, Dot, Rect, Stroke
from hrclog.analyzers.figures.palette import INK, REDUCED, TASKS, WHITE
from hrclog.analyzers.figures.plot_frame import NARROW, WIDE, Row, plot_frame
from hrclog.analyzers.figures.text import shorten

_BLUE: Final = TASKS[4]


def boxplot_canvas(plot: BoxPlot) -> Canvas:
    """Return a row per task, agents apart, seconds from left to right."""
    rows: list[tuple[Row, Box | None]] = []
    for agent, boxes in groupby(plot.boxes, key=lambda box: box.agent):
        rows += [] if plot.agent else [(Row(shorten(agent, 40), heading=True), None)]
        rows += [(Row(f"{shorten(box.task, 32)}  ({box.count:,})"), box) for box in boxes]
    longest = max((max(box.high, box.mean, *box.outliers) for box in plot.boxes), default=1.0)
    width = NARROW if plot.agent else WIDE
    frame = plot_frame(plot.title, "seconds", [row for row, _ in rows], (0.0, longest), plot.captions, width)
    rects, strokes, dots = [], [], []
    for index, (_, box) in enumerate(rows):
        if box is None:
            continue
        y, half, label, scale = frame.middle(index), frame.pitch * 0.3, _said(box), frame.scale
        rects.append(Rect((scale.at(box.q25), y - half), (scale.at(box.q75), y + half), _BLUE, label))
        strokes += _strokes(box, scale, y, half)
        dots += [Dot((scale.at(value), y), 2.5, REDUCED, f"{box.task}: {value:.3f} s") for value in box.outliers]
        dots.append(Dot((scale.at(box.mean), y), 4.5, WHITE, f"{box.task}: mean {box.mean:.3f} s"))
    return Canvas(plot.title, frame.sheet.pixels(), tuple(rects), tuple(strokes), tuple(dots))


def _strokes(box: Box, scale: Axis, y: float, half: float) -> list[Stroke]:
    label = _said(box)
    strokes = [Stroke(((scale.at(box.median), y - half), (scale.at(box.median), y + half)), INK, 2.5, label)]
    for foot, tip in ((box.q25, box.low), (box.q75, box.high)):
        strokes.append(Stroke(((scale.at(foot), y), (scale.at(tip), y)), _BLUE, 1.5, label))
        strokes.append(Stroke(((scale.at(tip), y - half / 2), (scale.at(tip), y + half / 2)), _BLUE, 1.5, label))
    return strokes


def _said(box: Box) -> str:
    return (
        f"{box.agent}, {box.task}: median {box.median:.3f} s, quartiles {box.q25:.3f} to {box.q75:.3f} s, "
        f"mean {box.mean:.3f} s, {box.count} executions"
    )
