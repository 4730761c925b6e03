"""Numbers over the time of a run as plots: one per group of series, under the timeline's axis."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np

from hrclog.analyzers.figures.gantt_plot import LEFT
from hrclog.analyzers.figures.palette import LINES
from hrclog.analyzers.figures.plot import WIDE, Axis, Key, Plot, Point, Stroke
from hrclog.analyzers.figures.series import (
    DISTANCE_GROUP,
    OVERLAP_GROUP,
    SPEED_GROUP,
    Series,
    limits,
    notes,
)
from hrclog.analyzers.figures.text import shorten
from hrclog.analyzers.figures.thinning import extremes

MAX_LINES: Final = 8
"""The most lines of a plot, so that each has a colour of its own."""

_HEIGHT: Final = 150
_MOST_POINTS: Final = 2401  # of a line
_READING: Final = {
    SPEED_GROUP: "The share of its full speed at which an agent was allowed to move; 0 is a stop.",
    DISTANCE_GROUP: "The smallest distance between a human and a robot; the lower, the more the robot has to give way.",
    OVERLAP_GROUP: "Seconds in which both agents have been busy at once; flat where one of them was idle.",
    "signals": "What was logged beside the events, over the same time.",
}


def series_plots(series: Iterable[Series], x: Axis, path: tuple[str, ...]) -> tuple[Plot, ...]:
    """Return a plot per group, in order; a large group has several. Joints are shown in the view of the cell only."""
    drawn = [signal for signal in series if not signal.joint and (len(signal.times_ns) or signal.notes)]
    groups = dict.fromkeys(signal.group for signal in drawn)
    return tuple(
        plot
        for name in groups
        for plot in _plots(name, [signal for signal in drawn if signal.group == name], x, (*path, name))
    )


def _plots(group: str, series: list[Series], x: Axis, path: tuple[str, ...]) -> Iterator[Plot]:
    parts = [series[first : first + MAX_LINES] for first in range(0, len(series), MAX_LINES)]
    title = shorten(group, 60).capitalize()
    reading = _READING.get(group, _READING["signals"])
    if len(parts) == 1:
        yield _plot(series, x, path, title, reading)
        return
    for number, part in enumerate(parts, 1):
        which = f"{number} of {len(parts)}"
        yield _plot(part, x, (*path, which), f"{title} ({which})", reading)


def _plot(series: list[Series], x: Axis, path: tuple[str, ...], title: str, reading: str) -> Plot:
    low, high = limits(series)
    margin = (high - low) * 0.06
    lines = [(signal, points(signal), color) for signal, color in zip(series, LINES, strict=False)]
    return Plot(
        path=path,
        title=title,
        reading=reading,
        x=x,
        y=Axis(low - margin, high + margin, grid=True),
        area=(WIDE, _HEIGHT),
        left=LEFT,
        strokes=tuple(Stroke(line, color, 1.6, signal.name, step=signal.step) for signal, line, color in lines if line),
        keys=tuple(Key(shorten(signal.name, 60), color, "line") for signal, _, color in lines),
        notes=notes(series),
    )


def points(series: Series) -> tuple[Point, ...]:
    """Return a series' finite samples, s since the first event. Very many are thinned to the line's extremes."""
    finite = np.isfinite(series.values)
    seconds, values = series.times_ns[finite] / 1e9, series.values[finite]
    indices = extremes(values, _MOST_POINTS)
    return tuple(zip(seconds[indices].tolist(), values[indices].tolist(), strict=True))
