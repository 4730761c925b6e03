"""A sheet with shapes on it: text as pixels, data as shapes, so that a viewer can say what each of them is."""

from __future__ import annotations

from dataclasses import dataclass

from hrclog.analyzers.figures.arrays import Pixels
from hrclog.analyzers.figures.palette import Color

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Rect:
    """A framed rectangle from its upper left to its lower right corner, and what it means."""

    low: Point
    high: Point
    color: Color
    label: str = ""


@dataclass(frozen=True, slots=True)
class Stroke:
    """A line through points, and what it means."""

    points: tuple[Point, ...]
    color: Color
    width: float = 2.0
    label: str = ""


@dataclass(frozen=True, slots=True)
class Dot:
    """A filled circle, and what it means."""

    center: Point
    radius: float
    color: Color
    label: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Canvas:
    """Shapes over a backdrop, all in px from its upper left corner; later kinds lie on top."""

    name: str
    backdrop: Pixels
    rects: tuple[Rect, ...] = ()
    strokes: tuple[Stroke, ...] = ()
    dots: tuple[Dot, ...] = ()
