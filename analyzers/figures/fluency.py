"""How well the agents worked together: the metrics of all runs, a row each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import polars as pl

from hrclog.analyzers.figures.plot import Plot
from hrclog.analyzers.figures.rows import Row, rows_plot
from hrclog.analyzers.figures.text import shorten

_AGENT: Final = 18  # characters of a name


@dataclass(frozen=True, slots=True)
class _Group:
    """Metrics in one unit, in the order of their rows."""

    name: str
    title: str
    reading: str
    label: str
    unit: str
    metrics: Mapping[str, Callable[[str], str]]


def _of(words: str) -> Callable[[str], str]:
    """Return what names the row of an agent."""
    return lambda key: f"{words}: {shorten(key, _AGENT)}"


def _both(key: str) -> str:
    return f"concurrent: {', '.join(shorten(side, _AGENT) for side in key.split('|'))}"


def _after(key: str) -> str:
    first, _, second = key.rpartition(">")
    return f"delay: {shorten(second, _AGENT)} after {shorten(first, _AGENT)}"


_GROUPS: Final = (
    _Group(
        "share",
        "Working together (fluency)",
        "Idle: the share of the makespan in which an agent does nothing. Concurrent (activity): in which both work. "
        "(Functional) delay: what one waits from each end of the other until its own next start, summed; negative "
        "where it starts before that end.",
        "share of the makespan",
        "",
        {"idle": _of("idle"), "concurrent_activity": _both, "functional_delay": _after},
    ),
    _Group(
        "seconds",
        "Waiting, stops and lateness",
        "Seconds of a run. Safety stop: at work, but held at a tenth of its speed or less; lost time: what reduced "
        "speed cost in all; start lateness: how much later than planned tasks began (negative: earlier).",
        "seconds",
        "s",
        {
            "safety_stop_s": _of("in safety stops"),
            "safety_stop_longest_s": _of("longest safety stop"),
            "lost_time_s": _of("lost time"),
            "start_lateness_mean_s": _of("mean start lateness"),
            "start_lateness_max_s": _of("largest start lateness"),
        },
    ),
    _Group(
        "speed",
        "Speed under the safety system",
        "1 is full speed throughout the agent's tasks, 0 is standing still.",
        "share of full speed, mean over the run",
        "",
        {"mean_speed_scale": _of("mean speed scale")},
    ),
    _Group(
        "count",
        "Safety stops",
        "How often in a run an agent at work was held at a tenth of its speed or less.",
        "stops per run",
        "",
        {"safety_stop_count": _of("safety stops")},
    ),
    _Group(
        "distance",
        "Distance between human and robot",
        "How near they came in a run. Of the 5th percentile, they were nearer during a twentieth of the samples only.",
        "metres",
        "m",
        {
            "min_distance_m": lambda _: "smallest distance",
            "min_distance_p5_m": lambda _: "5th percentile of the distance",
        },
    ),
)


def fluency_plots(metrics: pl.DataFrame, names: Mapping[str, str] | None = None) -> list[Plot]:
    """Return the metrics of all runs: shares of the makespan, seconds, speeds, counts and metres, where there are any.

    The makespan has plots of its own; the critical path is left to the tables.

    Args:
        metrics: a frame of schema `METRICS`.
        names: of runs by their ids; an id stands for itself without one.
    """
    return [plot for group in _GROUPS for plot in _plots(group, metrics, names or {})]


def _plots(group: _Group, metrics: pl.DataFrame, names: Mapping[str, str]) -> Iterator[Plot]:
    rows = list(_rows(group, metrics, names))
    if rows:
        yield rows_plot(
            ("fluency", group.name), group.title, group.reading, rows, group.label, unit=group.unit, zero=True
        )


def _rows(group: _Group, metrics: pl.DataFrame, names: Mapping[str, str]) -> Iterator[Row]:
    known = metrics.filter(pl.col("value").is_finite())
    for metric, name in group.metrics.items():
        own = known.filter(pl.col("metric") == metric).sort("key", "run_id")
        for (key,), part in own.group_by("key", maintain_order=True):
            labels = tuple(names.get(run, run) for run in part["run_id"])
            yield Row(name(str(key)), tuple(part["value"].to_list()), labels)
