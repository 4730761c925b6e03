"""Marks of a plot as shapes in px, cut off at the edges of the area."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from hrclog.analyzers.drawing.fonts import one_line
from hrclog.analyzers.drawing.scale import Scale
from hrclog.analyzers.drawing.sheet import Bounds, Box, Circle, Label, Trace
from hrclog.analyzers.figures.palette import Paint
from hrclog.analyzers.figures.plot import Plot, Stroke, Text
from hrclog.arrays import BoolArray, FloatArray

EMPTY: Final = "nothing observed"

RIM: Final = 1.5
"""Width in px of the line around a circle."""

_THINNEST: Final = 1.0  # px of a rectangle, that a moment shows too
_SLACK: Final = 0.5  # px beyond the edge at which a point still counts as on it


@dataclass(frozen=True, slots=True)
class Frame:
    """A plot, and where its values lie on a picture."""

    plot: Plot
    x: Scale
    y: Scale

    @property
    def area(self) -> Bounds:
        """The px between the axes."""
        return self.x.start, self.y.end, self.x.end, self.y.start


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """A pale area with corners, shape (n, 2)."""

    corners: FloatArray
    paint: Paint


def boxes(frame: Frame) -> list[Box]:
    """Return the rectangles, cut at the edges of the area. The thinnest are widened so that they are visible."""
    rects = frame.plot.rects
    if not rects:
        return []
    corners = np.array([(*rect.low, *rect.high) for rect in rects], dtype=np.float64)
    left, top, right, bottom = frame.area
    xs = _side(frame.x.end_at(corners[:, 0::2]), left, right)
    ys = _side(frame.y.end_at(corners[:, 1::2]), top, bottom)
    visible = ~np.isnan(np.concatenate([xs, ys], axis=1)).any(axis=1)
    return [
        Box((x[0], y[0], x[1], y[1]), rect.paint, rect.label)
        for rect, x, y, is_visible in zip(rects, xs.tolist(), ys.tolist(), visible.tolist(), strict=True)
        if is_visible
    ]


def patches(frame: Frame) -> Iterator[Patch]:
    """Yield the bands, one patch for each stretch without a gap."""
    for band in frame.plot.bands:
        xs, lows, highs = (np.asarray(values, dtype=np.float64) for values in (band.x, band.low, band.high))
        columns = np.stack([frame.x.at(xs), frame.y.end_at(lows), frame.y.end_at(highs)], axis=1)
        for stretch in _stretches(columns):
            upper, lower = stretch[:, (0, 2)], stretch[::-1, (0, 1)]
            yield Patch(np.concatenate([upper, lower]), band.paint)


def traces(frame: Frame) -> list[Trace]:
    """Return the strokes."""
    return [
        Trace(_points(frame, stroke), stroke.paint, stroke.width, stroke.dashed, stroke.label)
        for stroke in frame.plot.strokes
        if stroke.points
    ]


def circles(frame: Frame) -> list[Circle]:
    """Return the dots whose middle is within the area."""
    dots = frame.plot.dots
    if not dots:
        return []
    spots = _px(frame, np.array([dot.at for dot in dots], dtype=np.float64))
    visible = _inside(frame, spots)
    return [
        Circle((x, y), dot.radius, dot.paint, dot.rim, dot.label)
        for dot, (x, y), is_visible in zip(dots, spots.tolist(), visible.tolist(), strict=True)
        if is_visible
    ]


def labels(frame: Frame) -> Iterator[Label]:
    """Yield the texts in the area that fit into their room, or a note if the plot is empty."""
    plot = frame.plot
    if not (plot.rects or plot.bands or plot.strokes or plot.dots or plot.texts):
        left, top, right, bottom = frame.area
        yield Label(((left + right) / 2, (top + bottom) / 2), EMPTY, 13, "muted")
    if not plot.texts:
        return
    spots = _px(frame, np.array([text.at for text in plot.texts], dtype=np.float64))
    visible = _inside(frame, spots)
    for text, (x, y), is_visible in zip(plot.texts, spots.tolist(), visible.tolist(), strict=True):
        if not (is_visible and text.text):
            continue
        label = Label((x, y), one_line(text.text), text.size, text.paint, text.anchor, text.bold)
        if text.room is None or label.width <= _room(frame, text, text.room):
            yield label


def outlines(frame: Frame) -> Iterator[Bounds]:
    """Yield the bounds of marks that may reach beyond the area."""
    yield from (label.bounds for label in labels(frame))
    for circle in circles(frame):
        (x, y), reach = circle.at, circle.radius + RIM
        yield x - reach, y - reach, x + reach, y + reach


def _points(frame: Frame, stroke: Stroke) -> FloatArray:
    points = _px(frame, np.array(stroke.points, dtype=np.float64))
    if not stroke.step or len(points) < 2:
        return points
    repeated = np.repeat(points, 2, axis=0)
    return np.stack([repeated[1:, 0], repeated[:-1, 1]], axis=1)


def _px(frame: Frame, points: FloatArray) -> FloatArray:
    return np.stack([frame.x.at(points[:, 0]), frame.y.at(points[:, 1])], axis=1)


def _inside(frame: Frame, spots: FloatArray) -> BoolArray:
    left, top, right, bottom = frame.area
    low, high = np.array((left, top)) - _SLACK, np.array((right, bottom)) + _SLACK
    return np.asarray(((spots >= low) & (spots <= high)).all(axis=1))


def _side(ends: FloatArray, low: float, high: float) -> FloatArray:
    """Return both ends of bars in order, cut to the area; nan for a bar outside it."""
    first, last = ends.min(axis=1), ends.max(axis=1)
    with np.errstate(invalid="ignore"):
        outside = (last < low) | (first > high)
    first, last = np.clip(first, low, high), np.clip(last, low, high)
    lacking = np.maximum(_THINNEST - (last - first), 0) / 2
    first = np.clip(first - lacking, low, high - _THINNEST)
    last = np.maximum(last + lacking, first + _THINNEST)
    sides = np.stack([first, np.minimum(last, high)], axis=1)
    sides[outside] = np.nan
    return sides


def _stretches(columns: FloatArray) -> list[FloatArray]:
    is_complete = ~np.isnan(columns).any(axis=1)
    cuts = np.flatnonzero(np.diff(is_complete)) + 1
    return [stretch for stretch in np.split(columns, cuts) if len(stretch) > 1 and not np.isnan(stretch).any()]


def _room(frame: Frame, text: Text, room: float) -> float:
    offset = {"left": 0.0, "center": 0.5, "right": 1.0}[text.anchor] * room
    ends = frame.x.end_at((text.at[0] - offset, text.at[0] - offset + room))
    return float(abs(ends[1] - ends[0]))
