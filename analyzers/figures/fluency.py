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
"""Labels of agents in rows, by agent."""


@dataclass(frozen=True, slots=True)
class _Metric:
    """How to name the row of a key, the agents that a key names, and how to read the metric."""

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


def _agent_metric(words: str, reading: str = "") -> _Metric:
    """Return a metric of an agent, or of the run if the key is empty."""
    return _Metric(
        lambda key, agent_labels: f"{words}: {agent_labels[key]}" if key else words, lambda key: [key], reading
    )


def _agent_pair(key: str) -> Sequence[str]:
    return key.split("|")


def _ordered_pair(key: str) -> Sequence[str]:
    return key.rpartition(">")[::2]


def _concurrent_name(key: str, agent_labels: Called) -> str:
    return f"concurrent: {', '.join(agent_labels[side] for side in _agent_pair(key))}"


def _delay_name(key: str, agent_labels: Called) -> str:
    first, second = _ordered_pair(key)
    return f"delay: {agent_labels[second]} after {agent_labels[first]}"


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
            "idle": _agent_metric("idle", "Idle: the share of the makespan in which an agent does nothing."),
            "concurrent_activity": _Metric(
                _concurrent_name, _agent_pair, "Concurrent (activity): the share in which both work."
            ),
            "functional_delay": _Metric(
                _delay_name,
                _ordered_pair,
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
            "safety_stop_s": _agent_metric("in safety stops", _STOP),
            "safety_stop_longest_s": _agent_metric("longest safety stop", _STOP),
            "lost_time_s": _agent_metric("lost time", "Lost time: what reduced speed cost in all."),
            "start_lateness_mean_s": _agent_metric("mean start lateness", _LATENESS),
            "start_lateness_max_s": _agent_metric("largest start lateness", _LATENESS),
        },
    ),
    _Group(
        "speed",
        "Speed under the safety system",
        "1 is full speed throughout the agent's tasks, 0 is standing still.",
        "share of full speed, mean over the run",
        "",
        {"mean_speed_scale": _agent_metric("mean speed scale")},
    ),
    _Group(
        "count",
        "Safety stops",
        "How often in a run an agent at work was held at a tenth of its speed or less.",
        "stops per run",
        "",
        {"safety_stop_count": _agent_metric("safety stops")},
    ),
    _Group(
        "distance",
        "Distance between human and robot",
        "How near they came in a run.",
        "metres",
        "m",
        {
            "min_distance_m": _agent_metric("smallest distance"),
            "min_distance_p5_m": _agent_metric(
                "5th percentile of the distance",
                "Of the 5th percentile, they were nearer during a twentieth of the samples only.",
            ),
        },
    ),
)


def fluency_plots(metrics: pl.DataFrame, names: Mapping[str, str] | None = None) -> list[Plot]:
    """Return plots of all metrics with values: shares of the makespan, seconds, speeds, counts and metres.

    The makespan has its own plots; only the tables have the critical path.

    Args:
        metrics: a frame of schema `METRICS`.
        names: of runs by their ids; a run without a name is labelled with its id.
    """
    finite_metrics = metrics.filter(pl.col("value").is_finite())
    agent_labels = shorten_apart(_agents(finite_metrics), _AGENT)
    return [plot for group in _GROUPS for plot in _plots(group, finite_metrics, agent_labels, names or {})]


def _agents(finite_metrics: pl.DataFrame) -> Iterator[str]:
    """Yield all agents that the metrics name, so that a label means the same agent in all plots."""
    for group in _GROUPS:
        for name, metric in group.metrics.items():
            for key in finite_metrics.filter(pl.col("metric") == name)["key"].unique():
                yield from metric.agents(key)


def _plots(
    group: _Group, finite_metrics: pl.DataFrame, agent_labels: Called, names: Mapping[str, str]
) -> Iterator[Plot]:
    rows = list(_rows(group, finite_metrics, agent_labels, names))
    if rows:
        drawn = set(finite_metrics["metric"].unique())
        metric_readings = [metric.reading for name, metric in group.metrics.items() if name in drawn]
        reading = " ".join(filter(None, dict.fromkeys([group.reading, *metric_readings])))
        yield rows_plot(("fluency", group.name), group.title, reading, rows, group.label, unit=group.unit, zero=True)


def _rows(group: _Group, finite_metrics: pl.DataFrame, agent_labels: Called, names: Mapping[str, str]) -> Iterator[Row]:
    for name, metric in group.metrics.items():
        metric_rows = finite_metrics.filter(pl.col("metric") == name).sort("key", "run_id")
        for (key,), key_rows in metric_rows.group_by("key", maintain_order=True):
            labels = tuple(names.get(run, run) for run in key_rows["run_id"])
            yield Row(metric.name(str(key), agent_labels), tuple(key_rows["value"].to_list()), labels)
