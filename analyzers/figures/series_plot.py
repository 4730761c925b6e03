"""Numbers over the time of a run as plots: one per group of series, under the timeline's axis."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np

from hrclog.analyzers.figures.arrays import FloatArray
from hrclog.analyzers.figures.gantt_plot import LEFT
from hrclog.analyzers.figures.palette import TASKS
from hrclog.analyzers.figures.plot import WIDE, Axis, Key, Plot, Point, Stroke
from hrclog.analyzers.figures.series import DISTANCE_GROUP, OVERLAP_GROUP, SPEED_GROUP, Series
from hrclog.analyzers.figures.text import shorten

_HEIGHT: Final = 150
_BINS: Final = 1200
_READING: Final = {
    SPEED_GROUP: "The share of its full speed at which an agent was allowed to move; 0 is a stop.",
    DISTANCE_GROUP: "The smallest distance between a human and a robot; the lower, the more the robot has to give way.",
    OVERLAP_GROUP: "Seconds in which both agents have been busy at once; flat where one of them was idle.",
    "signals": "What was logged beside the events, over the same time.",
}


def series_plots(series: Iterable[Series], x: Axis, path: tuple[str, ...]) -> tuple[Plot, ...]:
    """Return a plot per group, in their order; joints are left to the three-dimensional view."""
    drawn = [one for one in series if not one.joint and len(one.times_ns)]
    groups = dict.fromkeys(one.group for one in drawn)
    return tuple(_plot(name, [one for one in drawn if one.group == name], x, (*path, name)) for name in groups)


def _plot(group: str, series: list[Series], x: Axis, path: tuple[str, ...]) -> Plot:
    finite = np.concatenate([one.values[np.isfinite(one.values)] for one in series])
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    low, high = (0.0, 1.0) if all(one.step for one in series) else (min(low, 0.0) if low < high / 2 else low, high)
    if low == high:
        low, high = min(low, 0.0), max(high, 0.0) or 1.0
    margin = (high - low) * 0.06
    colors = [TASKS[index % len(TASKS)] for index in range(len(series))]
    return Plot(
        path=path,
        title=shorten(group, 60).capitalize(),
        reading=_READING.get(group, _READING["signals"]),
        x=x,
        y=Axis(low - margin, high + margin, grid=True),
        area=(WIDE, _HEIGHT),
        left=LEFT,
        strokes=tuple(
            Stroke(points(one), color, 1.6, one.name, step=one.step) for one, color in zip(series, colors, strict=True)
        ),
        keys=tuple(Key(shorten(one.name, 60), color, "line") for one, color in zip(series, colors, strict=True)),
    )


def points(series: Series) -> tuple[Point, ...]:
    """Return a series' finite samples, s since the first event; of very many the lowest and highest per bin."""
    seconds, values = series.times_ns / 1e9, series.values
    known = np.isfinite(values)
    seconds, values = seconds[known], values[known]
    if len(values) > 2 * _BINS:
        kept = _extremes(values)
        seconds, values = seconds[kept], values[kept]
    return tuple(zip(seconds.tolist(), values.tolist(), strict=True))


def _extremes(values: FloatArray) -> list[int]:
    """Return the indices of the lowest and highest value of each of equal runs of samples, and both ends."""
    bounds = np.linspace(0, len(values), _BINS + 1).astype(int)
    found = {0, len(values) - 1}
    for start, end in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        found |= {start + int(values[start:end].argmin()), start + int(values[start:end].argmax())}
    return sorted(found)
