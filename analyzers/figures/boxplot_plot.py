"""A box plot as a plot: a row per task, agents apart, seconds from left to right."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from typing import Final

from hrclog.analyzers.figures.boxplot import Box, BoxPlot
from hrclog.analyzers.figures.palette import CARD, MARK, REDUCED, WHITE
from hrclog.analyzers.figures.plot import NAMELESS, NARROW, WIDE, Axis, Dot, Key, Plot, Rect, Stroke, Text
from hrclog.analyzers.figures.text import shorten

_BLUE: Final = MARK
_ROW: Final = 30
_DENSE_ROW: Final = 22
_MANY: Final = 24
_HALF: Final = 0.3

_KEYS: Final = (
    Key("quartiles", _BLUE, "box"),
    Key("median", "ink", "line"),
    Key("mean", WHITE, "dot", rim=CARD),
    Key("outlier", REDUCED, "dot"),
)


def boxplot_plot(plot: BoxPlot, path: tuple[str, ...]) -> Plot:
    """Return a row per task with its quartiles, median, whiskers, outliers and mean, and how many executions it has."""
    rows = list(_rows(plot))
    longest = max((max(box.high, box.mean, *box.outliers) for box in plot.boxes), default=1.0)
    ticks = [(row + 0.5, f"{shorten(box.task, 36)} ({box.count:,})") for row, box in rows if isinstance(box, Box)]
    drawn = [(row + 0.5, box) for row, box in rows if isinstance(box, Box)]
    headings = [Text((0.0, row + 0.5), f" {box}", "muted", anchor="left") for row, box in rows if isinstance(box, str)]
    height = max(len(rows), 1) * (_ROW if len(rows) <= _MANY else _DENSE_ROW)
    return Plot(
        path=path,
        title=plot.title,
        reading=plot.reading,
        x=Axis(0.0, longest * 1.03, "seconds", grid=True),
        y=Axis(max(len(rows), 1), 0, ticks=tuple(ticks) or NAMELESS),
        area=(NARROW if plot.agent else WIDE, height),
        rects=tuple(Rect((box.q25, y - _HALF), (box.q75, y + _HALF), _BLUE, _label(box)) for y, box in drawn),
        strokes=tuple(stroke for y, box in drawn for stroke in _strokes(box, y)),
        dots=tuple(dot for y, box in drawn for dot in _dots(box, y)),
        texts=tuple(headings),
        keys=_KEYS if drawn else (),
        notes=plot.captions,
    )


def _rows(plot: BoxPlot) -> Iterator[tuple[int, Box | str]]:
    """Yield the rows from the top: boxes, and above those of each agent its name if there are several agents."""
    row = 0
    for agent, boxes in groupby(plot.boxes, key=lambda box: box.agent):
        if not plot.agent:
            yield row, shorten(agent, 40)
            row += 1
        for box in boxes:
            yield row, box
            row += 1


def _strokes(box: Box, y: float) -> Iterator[Stroke]:
    label = _label(box)
    yield Stroke(((box.median, y - _HALF), (box.median, y + _HALF)), "ink", 2.5, label)
    for foot, tip in ((box.q25, box.low), (box.q75, box.high)):
        yield Stroke(((foot, y), (tip, y)), _BLUE, 1.5, label)
        yield Stroke(((tip, y - _HALF / 2), (tip, y + _HALF / 2)), _BLUE, 1.5, label)


def _dots(box: Box, y: float) -> Iterator[Dot]:
    for value in box.outliers:
        yield Dot((value, y), 2.5, REDUCED, f"{box.agent}, {box.task}: {value:.3f} s")
    yield Dot((box.mean, y), 5.0, WHITE, f"{box.agent}, {box.task}: mean {box.mean:.3f} s", rim=CARD)


def _label(box: Box) -> str:
    return (
        f"{box.agent}, {box.task}: median {box.median:.3f} s, quartiles {box.q25:.3f} to {box.q75:.3f} s, "
        f"mean {box.mean:.3f} s, n = {box.count:,}"
    )
