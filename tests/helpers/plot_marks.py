"""What a plot shows, for tests."""

from __future__ import annotations

from itertools import chain

from hrclog.analyzers.figures.plot import Plot


def names(plot: Plot) -> list[str]:
    """Return the names of the rows, from the top."""
    assert plot.y.low > plot.y.high, "the first row is on top"
    return [name for _, name in sorted(plot.y.ticks)]


def check(plot: Plot) -> None:
    """Fail unless all marks lie on the axes, whose ends are proper, and the plot says how to read it."""
    assert plot.reading
    assert plot.title
    marks = chain(
        (point for rect in plot.rects for point in (rect.low, rect.high)),
        ((x, y) for band in plot.bands for x, y in zip(band.x * 2, band.low + band.high, strict=True)),
        (point for stroke in plot.strokes for point in stroke.points),
        (dot.at for dot in plot.dots),
        (text.at for text in plot.texts),
    )
    for point in marks:
        for value, axis in zip(point, (plot.x, plot.y), strict=True):
            assert axis.low != axis.high
            low, high = sorted((axis.low, axis.high))
            assert low > 0 or not axis.log
            slack = 1e-9 * max(abs(low), abs(high))
            assert low - slack <= value <= high + slack, (point, axis)
