"""The pictures of a run as plots under one time axis."""

from __future__ import annotations

from hrclog.analyzers.figures.gantt_plot import gantt_plot, seconds_axis
from hrclog.analyzers.figures.plot import Plot
from hrclog.analyzers.figures.run import RunFigures
from hrclog.analyzers.figures.series_plot import series_plots


def run_plots(figures: RunFigures) -> tuple[Plot, ...]:
    """Return the timeline, then the signals."""
    timeline = gantt_plot(figures.gantt, ("run", figures.name, "timeline"))
    return timeline, *series_plots(figures.series, seconds_axis(figures.gantt), ("run", figures.name))
