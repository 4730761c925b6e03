"""A plot as a value: marks in data coordinates under named axes, which every back end draws alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from hrclog.analyzers.figures.palette import Paint

Point = tuple[float, float]
"""x and y in the units of the axes."""

Anchor = Literal["left", "center", "right"]

WIDE: Final = 900
"""Px of an area that has a page for itself."""
NARROW: Final = 460
"""Px of an area beside another."""

NAMELESS: Final = ((0.5, ""),)
"""Ticks of an axis of names when there are none; no ticks at all would be round numbers."""


@dataclass(frozen=True, slots=True)
class Axis:
    """Values from `low` (left or bottom) to `high` (right or top); `low` above `high` turns it round.

    `ticks` are named positions; without any, a back end marks round numbers. On a logarithmic axis both ends are above
    0. `grid` draws a line through the area at each tick.
    """

    low: float
    high: float
    label: str = ""
    ticks: tuple[tuple[float, str], ...] = ()
    log: bool = False
    grid: bool = False


@dataclass(frozen=True, slots=True)
class Rect:
    """A filled rectangle between two corners, and what it means."""

    low: Point
    high: Point
    paint: Paint
    label: str = ""


@dataclass(frozen=True, slots=True)
class Band:
    """What lies between two lines over the same x: shapes (n,) each. It is drawn pale, beneath the strokes."""

    x: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    paint: Paint


@dataclass(frozen=True, slots=True)
class Stroke:
    """A line through points, `width` px wide, and what it means; `step` holds each y until the next x."""

    points: tuple[Point, ...]
    paint: Paint
    width: float = 2.0
    label: str = ""
    step: bool = False
    dashed: bool = False


@dataclass(frozen=True, slots=True)
class Dot:
    """A circle of `radius` px around a point, with a rim where one is given, and what it means."""

    at: Point
    radius: float
    paint: Paint
    label: str = ""
    rim: Paint | None = None


@dataclass(frozen=True, slots=True)
class Text:
    """A line of text at the height of its middle, `size` px high.

    `room` is the width in units of the x axis that it must not exceed: where it would, it is left out.
    """

    at: Point
    text: str
    paint: Paint = "ink"
    size: float = 13
    anchor: Anchor = "center"
    bold: bool = False
    room: float | None = None


@dataclass(frozen=True, slots=True)
class Key:
    """An entry of a legend."""

    label: str
    paint: Paint
    shape: Literal["box", "line", "dot"] = "box"
    rim: Paint | None = None


@dataclass(frozen=True, slots=True)
class ColorBar:
    """What colours mean: fills from left to right, ticks at shares of 0 to 1 of its length, and a label."""

    paints: tuple[Paint, ...]
    ticks: tuple[tuple[float, str], ...]
    label: str = ""


@dataclass(frozen=True, slots=True)
class Plot:
    """Marks over two axes. Later kinds lie on top: rects, bands, strokes, dots, texts.

    Attributes:
        path: tells the plots of a set apart; its parts may hold any character.
        title: what is seen.
        reading: how to read it, a sentence or two.
        x: the horizontal axis.
        y: the vertical axis.
        area: width and height in px of the area between the axes; names and titles come on top of it.
        left: px that the names on the left get at least, so that plots under one another share their x axis.
        names_on_top: the ticks of x stand above the area instead of below.
        keys: the legend.
        notes: what is not drawn, or doubtful.
    """

    path: tuple[str, ...]
    title: str
    reading: str
    x: Axis
    y: Axis
    area: tuple[int, int] = (WIDE, 320)
    rects: tuple[Rect, ...] = ()
    bands: tuple[Band, ...] = ()
    strokes: tuple[Stroke, ...] = ()
    dots: tuple[Dot, ...] = ()
    texts: tuple[Text, ...] = ()
    keys: tuple[Key, ...] = ()
    color_bar: ColorBar | None = None
    left: int = 0
    names_on_top: bool = False
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Steps:
    """One plot as it was after so many runs: `numbers` rise, `plots` belong to them, all of one path.

    `title` is that of all of them together.
    """

    title: str
    numbers: tuple[int, ...]
    plots: tuple[Plot, ...]


@dataclass(frozen=True, slots=True)
class Page:
    """Plots that are looked at together, under one name."""

    name: str
    plots: tuple[Plot, ...] = ()
    steps: tuple[Steps, ...] = ()


def page_plots(page: Page) -> tuple[Plot, ...]:
    """Return the plots of a page, of steps the last."""
    return (*page.plots, *(steps.plots[-1] for steps in page.steps))
