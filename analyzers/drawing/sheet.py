"""Shapes around an area, in px that run right and down."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hrclog.analyzers.drawing.fonts import LINE, RISE, text_reach, text_width
from hrclog.analyzers.figures.palette import Paint
from hrclog.analyzers.figures.plot import Anchor
from hrclog.arrays import FloatArray

Bounds = tuple[float, float, float, float]
"""Left, top, right, bottom."""


@dataclass(frozen=True, slots=True)
class Label:
    """A line of text, turned counterclockwise by `angle` degrees about its anchor, at the middle of its height.

    `full` is the full text, if it had to be shortened.
    """

    at: tuple[float, float]
    text: str
    size: float
    paint: Paint = "ink"
    anchor: Anchor = "center"
    bold: bool = False
    angle: float = 0
    full: str = ""

    @property
    def baseline(self) -> tuple[float, float]:
        """The anchor on the line that letters stand on."""
        turn = math.radians(self.angle)
        x, y = self.at
        return x + RISE * self.size * math.sin(turn), y + RISE * self.size * math.cos(turn)

    @property
    def start(self) -> tuple[float, float]:
        """Where the baseline begins."""
        turn = math.radians(self.angle)
        x, y = self.baseline
        return x - self._anchor_offset * math.cos(turn), y + self._anchor_offset * math.sin(turn)

    @property
    def width(self) -> float:
        """The px along the line."""
        return text_width(self.text, self.size, bold=self.bold)

    @property
    def _anchor_offset(self) -> float:
        return {"left": 0.0, "center": 0.5, "right": 1.0}[self.anchor] * self.width

    @property
    def bounds(self) -> Bounds:
        """The bounds of the line in px, at most."""
        width, offset = self.width, self._anchor_offset
        above, below = text_reach(self.text, self.size, bold=self.bold)
        turn = math.radians(self.angle)
        corners = [(along, across) for along in (-offset, width - offset) for across in (-above, below)]
        xs = [self.at[0] + along * math.cos(turn) + across * math.sin(turn) for along, across in corners]
        ys = [self.at[1] - along * math.sin(turn) + across * math.cos(turn) for along, across in corners]
        return min(xs), min(ys), max(xs), max(ys)


@dataclass(frozen=True, slots=True)
class Box:
    """A filled rectangle, and what it means."""

    bounds: Bounds
    paint: Paint
    label: str = ""


@dataclass(frozen=True, slots=True)
class Circle:
    """A filled circle with an optional rim, and what it means."""

    at: tuple[float, float]
    radius: float
    paint: Paint
    rim: Paint | None = None
    label: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """A line through points, shape (n, 2), and what it means; nan is a gap."""

    points: FloatArray
    paint: Paint
    width: float = 1.0
    dashed: bool = False
    label: str = ""


@dataclass(slots=True)
class Sheet:
    """Shapes around an area whose upper left corner is 0, 0, and the bounds of all of them."""

    bounds: Bounds
    labels: list[Label] = field(default_factory=list)
    boxes: list[Box] = field(default_factory=list)
    grid: list[Trace] = field(default_factory=list)
    lines: list[Trace] = field(default_factory=list)
    circles: list[Circle] = field(default_factory=list)

    @property
    def left(self) -> float:
        """The leftmost px."""
        return self.bounds[0]

    @property
    def top(self) -> float:
        """The topmost px."""
        return self.bounds[1]

    @property
    def width(self) -> float:
        """The px from left to right."""
        return self.bounds[2] - self.bounds[0]

    @property
    def bottom(self) -> float:
        """The lowest px."""
        return self.bounds[3]

    def write(self, *labels: Label) -> None:
        """Add lines of text."""
        self.labels += labels
        self.take(*(label.bounds for label in labels))

    def paragraph(self, lines: Sequence[str], top: float, style: Label) -> None:
        """Add lines of text beneath each other, in the style and at the x of a label."""
        step = style.size * LINE
        for row, line in enumerate(lines):
            self.write(replace(style, at=(style.at[0], top + (row + 0.5) * step), text=line))

    def rule(self, start: tuple[float, float], end: tuple[float, float], paint: Paint, width: float = 1.0) -> None:
        """Add a straight line."""
        self.lines.append(Trace(np.array((start, end)), paint, width))

    def take(self, *bounds: Bounds) -> None:
        """Widen the bounds to hold others."""
        lefts, tops, rights, bottoms = zip(self.bounds, *bounds, strict=True)
        self.bounds = min(lefts), min(tops), max(rights), max(bottoms)

    def moved(self, right: float, down: float) -> Sheet:
        """Return the sheet with everything on it moved."""
        shift = np.array((right, down))
        return Sheet(
            _move_bounds(self.bounds, right, down),
            [replace(label, at=(label.at[0] + right, label.at[1] + down)) for label in self.labels],
            [replace(box, bounds=_move_bounds(box.bounds, right, down)) for box in self.boxes],
            [replace(line, points=line.points + shift) for line in self.grid],
            [replace(line, points=line.points + shift) for line in self.lines],
            [replace(circle, at=(circle.at[0] + right, circle.at[1] + down)) for circle in self.circles],
        )


def _move_bounds(bounds: Bounds, right: float, down: float) -> Bounds:
    return bounds[0] + right, bounds[1] + down, bounds[2] + right, bounds[3] + down
