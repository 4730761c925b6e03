"""Shapes as matplotlib's artists: few collections rather than one artist per mark."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import groupby
from typing import Final, Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.backend_bases import RendererBase
from matplotlib.collections import LineCollection, PathCollection, PolyCollection
from matplotlib.lines import Line2D
from matplotlib.path import Path
from matplotlib.text import Text
from matplotlib.transforms import Bbox, IdentityTransform, Transform, TransformedBbox

from hrclog.analyzers.drawing import shapes
from hrclog.analyzers.drawing.fonts import font, is_wide
from hrclog.analyzers.drawing.layout import Layout
from hrclog.analyzers.drawing.sheet import Box, Circle, Label, Trace
from hrclog.analyzers.figures.palette import Paint
from hrclog.arrays import FloatArray

Rgb = tuple[float, float, float]
Inks = Callable[[Paint], Rgb]
"""The colour of a paint, as shares from 0 to 1."""

BARS: Final = "bars"
"""The group of filled rectangles."""

_PALE: Final = 0.25
_LONG: Final = 64  # points of a line that matplotlib simplifies, as it does in no collection
_LONGEST: Final = 20_000  # points of a line that is drawn at once
_DASHES: Final = (4.0, 2.5)


class _Line(Text):
    """A label of known width, because matplotlib would spend half its time on measuring it again."""

    def __init__(self, label: Label, color: Rgb, points: float, transform: Transform) -> None:
        super().__init__(
            *label.baseline,
            label.text,
            color=color,
            horizontalalignment=label.anchor,
            verticalalignment="baseline",
            rotation=label.angle,
            rotation_mode="anchor",
            fontproperties=font(label.size * points, bold=label.bold, wide=is_wide(label.text)),
            transform=transform,
        )
        self._start = label.start

    def draw(self, renderer: RendererBase) -> None:
        """Draw the text as it is from the start of its baseline: a dollar does not begin a formula."""
        _, height = renderer.get_canvas_width_height()
        x, y = self.get_transform().transform(self._start)
        gc = renderer.new_gc()
        gc.set_foreground(self.get_color())
        font_properties = self.get_fontproperties()
        renderer.draw_text(
            gc,
            x,
            height - y if renderer.flipy() else y,
            self.get_text(),
            font_properties,
            self.get_rotation(),
            mtext=self,
        )
        gc.restore()
        self.stale = False


class Pen:
    """Makes artists of shapes.

    Args:
        inks: the colours of paints.
        transform: from px of a layout.
        points: typographic points per px.
    """

    def __init__(self, inks: Inks, transform: Transform, points: float) -> None:
        self._inks = inks
        self._transform = transform
        self._points = points

    def artists(self, layout: Layout) -> Iterator[Artist]:
        """Yield what is drawn, lowest first."""
        sheet, frame = layout.sheet, layout.frame
        left, top, right, bottom = frame.area
        edge = TransformedBbox(Bbox(((left, top), (right, bottom))), self._transform)
        marks = [*self._patches(shapes.patches(frame)), *self._traces(shapes.traces(frame))]
        for mark in marks:
            mark.set_clip_box(edge)
        yield from self._traces(sheet.grid)
        yield from self._boxes(shapes.boxes(frame))
        yield from marks
        yield from self._circles(shapes.circles(frame))
        yield from self._boxes(sheet.boxes)
        yield from self._traces(sheet.lines)
        yield from self._circles(sheet.circles)
        yield from map(self._label, (*shapes.labels(frame), *sheet.labels))

    def _boxes(self, boxes: Sequence[Box]) -> Iterator[Artist]:
        if not boxes:
            return
        corners = np.array([box.bounds for box in boxes])[:, (0, 1, 2, 1, 2, 3, 0, 3)].reshape(-1, 4, 2)
        yield PolyCollection(
            list(corners),
            facecolors=[self._inks(box.paint) for box in boxes],
            linewidths=0,
            transform=self._transform,
            snap=True,
            gid=BARS,
        )

    def _patches(self, patches: Iterable[shapes.Patch]) -> Iterator[Artist]:
        members = list(patches)
        if members:
            yield PolyCollection(
                [patch.corners for patch in members],
                facecolors=[(*self._inks(patch.paint), _PALE) for patch in members],
                linewidths=0,
                transform=self._transform,
            )

    def _traces(self, traces: Sequence[Trace]) -> Iterator[Artist]:
        for long, members in groupby(traces, key=lambda trace: len(trace.points) > _LONG):
            if long:
                yield from (self._line(trace, piece) for trace in members for piece in _pieces(trace.points))
            else:
                yield self._lines(list(members))

    def _line(self, trace: Trace, points: FloatArray) -> Artist:
        return Line2D(
            points[:, 0],
            points[:, 1],
            color=self._inks(trace.paint),
            linewidth=trace.width * self._points,
            linestyle=_dashes(trace),
            dash_capstyle="butt",
            solid_capstyle="butt",
            solid_joinstyle="round",
            transform=self._transform,
        )

    def _lines(self, traces: Sequence[Trace]) -> Artist:
        return LineCollection(
            [trace.points for trace in traces],
            colors=[self._inks(trace.paint) for trace in traces],
            linewidths=[trace.width * self._points for trace in traces],
            linestyles=[_dashes(trace) for trace in traces],
            capstyle="butt",
            joinstyle="round",
            transform=self._transform,
        )

    def _circles(self, circles: Sequence[Circle]) -> Iterator[Artist]:
        if not circles:
            return
        sizes = np.array([circle.radius * self._points for circle in circles]) ** 2
        rims = [circle.rim if circle.rim is not None else circle.paint for circle in circles]
        yield PathCollection(
            [Path.unit_circle()],
            sizes if np.ptp(sizes) else sizes[:1],
            transform=IdentityTransform(),
            offsets=np.array([circle.at for circle in circles]),
            offset_transform=self._transform,
            facecolors=[self._inks(circle.paint) for circle in circles],
            edgecolors=[self._inks(rim) for rim in rims],
            linewidths=[shapes.RIM * self._points if circle.rim is not None else 0.0 for circle in circles],
        )

    def _label(self, label: Label) -> Artist:
        return _Line(label, self._inks(label.paint), self._points, self._transform)


def _pieces(points: FloatArray) -> Iterator[FloatArray]:
    """Yield a line in pieces that a rasterizer can draw. Each begins where the last one ended."""
    for start in range(0, len(points) - 1, _LONGEST):
        yield points[start : start + _LONGEST + 1]


def _dashes(trace: Trace) -> tuple[float, tuple[float, float]] | Literal["-"]:
    return (0.0, _DASHES) if trace.dashed else "-"
