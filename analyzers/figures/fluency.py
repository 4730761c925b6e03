"""How well the agents worked together: the metrics of all runs, a row each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import polars as pl

from hrclog.analyzers.figures.plot import Plot
from hrclog.analyzers.figures.rows import Row, rows_plot
from hrclog.analyzers.figures.text import shorten_apart

_AGENT: Final = 18  # characters of a name


Called = Mapping[str, str]
"""What rows call the agents."""


@dataclass(frozen=True, slots=True)
class _Metric:
    """The agents that a key of a metric names, what the row of a key is called, and what a reading says of it."""

    name: Callable[[str, Called], str]
    agents: Callable[[str], Sequence[str]]
    reading: str = ""


@dataclass(frozen=True, slots=True)
class _Group:
    """Metrics in one unit, in the order of their rows."""

    name: str
    title: str
    reading: str
    label: str
    unit: str
    metrics: Mapping[str, _Metric]


def _of(words: str, reading: str = "") -> _Metric:
    """Return a metric of an agent, or of the run where the key is empty."""
    return _Metric(lambda key, called: f"{words}: {called[key]}" if key else words, lambda key: [key], reading)


def _both(key: str) -> Sequence[str]:
    return key.split("|")


def _first_second(key: str) -> Sequence[str]:
    return key.rpartition(">")[::2]


def _concurrent(key: str, called: Called) -> str:
    return f"concurrent: {', '.join(called[side] for side in _both(key))}"


def _after(key: str, called: Called) -> str:
    first, second = _first_second(key)
    return f"delay: {called[second]} after {called[first]}"


_STOP: Final = "Safety stop: at work, but held at a tenth of its speed or less."
_LATENESS: Final = "Start lateness: how much later than planned tasks began (negative: earlier)."

_GROUPS: Final = (
    _Group(
        "share",
        "Working together (fluency)",
        "",
        "share of the makespan",
        "",
        {
            "idle": _of("idle", "Idle: the share of the makespan in which an agent does nothing."),
            "concurrent_activity": _Metric(_concurrent, _both, "Concurrent (activity): the share in which both work."),
            "functional_delay": _Metric(
                _after,
                _first_second,
                "(Functional) delay: what one waits from each end of the other until its own next start, summed; "
                "negative where it starts before that end.",
            ),
        },
    ),
    _Group(
        "seconds",
        "Waiting, stops and lateness",
        "Seconds of a run.",
        "seconds",
        "s",
        {
            "safety_stop_s": _of("in safety stops", _STOP),
            "safety_stop_longest_s": _of("longest safety stop", _STOP),
            "lost_time_s": _of("lost time", "Lost time: what reduced speed cost in all."),
            "start_lateness_mean_s": _of("mean start lateness", _LATENESS),
            "start_lateness_max_s": _of("largest start lateness", _LATENESS),
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
        "How near they came in a run.",
        "metres",
        "m",
        {
            "min_distance_m": _of("smallest distance"),
            "min_distance_p5_m": _of(
                "5th percentile of the distance",
                "Of the 5th percentile, they were nearer during a twentieth of the samples only.",
            ),
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
    known = metrics.filter(pl.col("value").is_finite())
    called = shorten_apart(_agents(known), _AGENT)
    return [plot for group in _GROUPS for plot in _plots(group, known, called, names or {})]


def _agents(known: pl.DataFrame) -> Iterator[str]:
    """Yield all agents that are named, so that a name means the same agent in all plots."""
    for group in _GROUPS:
        for name, metric in group.metrics.items():
            for key in known.filter(pl.col("metric") == name)["key"].unique():
                yield from metric.agents(key)


def _plots(group: _Group, known: pl.DataFrame, called: Called, names: Mapping[str, str]) -> Iterator[Plot]:
    rows = list(_rows(group, known, called, names))
    if rows:
        drawn = set(known["metric"].unique())
        explained = [metric.reading for name, metric in group.metrics.items() if name in drawn]
        reading = " ".join(filter(None, dict.fromkeys([group.reading, *explained])))
        yield rows_plot(("fluency", group.name), group.title, reading, rows, group.label, unit=group.unit, zero=True)


def _rows(group: _Group, known: pl.DataFrame, called: Called, names: Mapping[str, str]) -> Iterator[Row]:
    for name, metric in group.metrics.items():
        own = known.filter(pl.col("metric") == name).sort("key", "run_id")
        for (key,), part in own.group_by("key", maintain_order=True):
            labels = tuple(names.get(run, run) for run in part["run_id"])
            yield Row(metric.name(str(key), called), tuple(part["value"].to_list()), labels)
