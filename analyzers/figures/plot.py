"""A plot as a value: marks in data coordinates and named axes. All back ends draw it alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from hrclog.analyzers.figures.palette import Paint

Point = tuple[float, float]
"""x and y in the units of the axes."""

Anchor = Literal["left", "center", "right"]

WIDE: Final = 900
"""Width in px of an area that has a page for itself."""
NARROW: Final = 460
"""Width in px of an area beside another."""

NAMELESS: Final = ((0.5, ""),)
"""Ticks of an axis of names without any name. An axis without ticks would get round numbers."""


@dataclass(frozen=True, slots=True)
class Axis:
    """Values from `low` (left or bottom) to `high` (right or top); with `low` above `high` the axis is reversed.

    `ticks` are named positions; without any, a back end marks round numbers. Both ends of a logarithmic axis are above
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
    """The area between two lines over the same x, shapes (n,) each. It is drawn pale, beneath the strokes."""

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
    """A circle of `radius` px around a point, with an optional rim, and what it means."""

    at: Point
    radius: float
    paint: Paint
    label: str = ""
    rim: Paint | None = None


@dataclass(frozen=True, slots=True)
class Text:
    """A line of text at the height of its middle, `size` px high.

    `room` is its largest width in units of the x axis. A wider text is left out.
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
    """A scale of colours: fills from left to right, ticks at shares of 0 to 1 of its length, and a label."""

    paints: tuple[Paint, ...]
    ticks: tuple[tuple[float, str], ...]
    label: str = ""


@dataclass(frozen=True, slots=True)
class Plot:
    """Marks over two axes. Later kinds lie on top: rects, bands, strokes, dots, texts.

    Attributes:
        path: identifies the plot in a set; its parts may hold any character.
        title: what the plot shows.
        reading: how to read it, a sentence or two.
        x: the horizontal axis.
        y: the vertical axis.
        area: width and height in px of the area between the axes; names and titles come on top of it.
        left: the least px for the names on the left, so that plots under one another share their x axis.
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
    """One plot after growing numbers of runs: one of `plots` for each of `numbers`, all with the same path.

    `title` is the common title of the plots.
    """

    title: str
    numbers: tuple[int, ...]
    plots: tuple[Plot, ...]


@dataclass(frozen=True, slots=True)
class Page:
    """Plots that are shown together, under one name."""

    name: str
    plots: tuple[Plot, ...] = ()
    steps: tuple[Steps, ...] = ()


def page_plots(page: Page) -> tuple[Plot, ...]:
    """Return the plots of a page, and the last plot of each of its steps."""
    return (*page.plots, *(steps.plots[-1] for steps in page.steps))
