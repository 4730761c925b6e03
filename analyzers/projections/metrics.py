"""Fluency, time and safety metrics per run.

Idle time, concurrent activity and functional delay are those of Hoffman, Evaluating Fluency in Human-Robot
Collaboration (IEEE Trans. Human-Machine Systems, 2019), eq. 6-9. T runs from the first start to the last end of a run.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import combinations, permutations
from typing import Any, Final

import numpy as np
import polars as pl

from hrclog.analyzers.projections.busy import BusyTime, busy_times
from hrclog.analyzers.projections.critical_path import Precedence, critical_path, critical_path_lengths
from hrclog.analyzers.projections.crowded import MOST_AGENTS
from hrclog.analyzers.projections.frames import EVENTS_FRAME, INTERVALS_FRAME, SIGNALS_FRAME, check_frame
from hrclog.analyzers.projections.intervals import top_level
from hrclog.analyzers.projections.schemas import METRICS
from hrclog.analyzers.projections.speed import SpeedProfile, speed_profiles

MINIMUM_DISTANCE: Final = "min_distance"
"""Name of the signal of the smallest distance between a human and a robot, m; "R/min_distance" is that of agent R."""

Row = tuple[str, str, float]
"""(metric, key, value)."""


def metrics(
    intervals: pl.DataFrame,
    events: pl.DataFrame | None = None,
    signals: pl.DataFrame | None = None,
    precedences: Iterable[Precedence] = (),
) -> pl.DataFrame:
    """Compute the metrics that a log supports.

    Args:
        intervals: a frame of schema `INTERVALS`.
        events: adds the safety metrics where speed scales were logged.
        signals: adds the minimum distance where it was logged.
        precedences: plan items of which the first must end before the second starts; the critical path follows them
            and the order of each agent's executions.

    Returns:
        A frame of schema `METRICS`, without pairs of agents where a run has very many: fractions of T, but `*_s` in
        seconds, `*_m` in metres, `*_count` and `mean_speed_scale` plain.

    Raises:
        HrclogError: a frame is not of its schema.
    """
    check_frame(intervals, INTERVALS_FRAME)
    if events is not None:
        check_frame(events, EVENTS_FRAME)
    if signals is not None:
        check_frame(signals, SIGNALS_FRAME)
    busy = busy_times(intervals)
    speeds = speed_profiles(events) if events is not None else {}
    distances = _distances(signals)
    longest = critical_path_lengths(critical_path(intervals, precedences))
    rows: list[tuple[str, str, str, float]] = []
    top = intervals.filter(top_level())
    for (run,), part in top.sort("run_id", "start_ns", "until_ns", "execution_id").group_by(
        "run_id", maintain_order=True
    ):
        run_id = str(run)
        run_rows = [*_fluency(part, busy[run_id]), ("critical_path_s", "", longest[run_id] / 1e9)]
        run_rows += [*_lateness(part), *distances.get(run_id, [])]
        for agent, profile in sorted(speeds.get(run_id, {}).items()):
            run_rows += _safety(agent, part.filter(pl.col("agent") == agent), profile)
        rows += [(run_id, *row) for row in run_rows]
    return pl.DataFrame(rows, schema=METRICS, orient="row")


def nested(metrics: pl.DataFrame) -> dict[str, dict[str, Any]]:
    """Return run -> metric -> key -> value; a metric of the whole run maps to its value."""
    result: dict[str, dict[str, Any]] = {}
    for run, metric, key, value in metrics.iter_rows():
        of_run = result.setdefault(run, {})
        if key:
            of_run.setdefault(metric, {})[key] = value
        else:
            of_run[metric] = value
    return result


def _fluency(part: pl.DataFrame, busy: dict[str, BusyTime]) -> Iterator[Row]:
    first, last = int(part["start_ns"].min()), int(part["until_ns"].max())  # type: ignore[arg-type]  # int64 columns
    total = last - first
    yield "makespan_s", "", total / 1e9
    if not total:
        return
    agents = sorted(busy)
    for agent in agents:
        yield "idle", agent, 1 - busy[agent].total / total
    if len(agents) > MOST_AGENTS:
        return
    for agent, other in combinations(agents, 2):
        both = int(busy[other].within(busy[agent].start, busy[agent].end).sum())
        yield "concurrent_activity", f"{agent}|{other}", both / total
    actions = {str(agent): rows for (agent,), rows in part.group_by("agent")}
    for agent, other in permutations(agents, 2):
        yield "functional_delay", f"{agent}>{other}", _functional_delay(actions[agent], actions[other]) / total


def _functional_delay(actions: pl.DataFrame, others: pl.DataFrame) -> int:
    """Sum over one agent's actions of the wait, in ns, for the other's first start after this action's start."""
    starts = np.sort(others["start_ns"].to_numpy())
    following = np.searchsorted(starts, actions["start_ns"].to_numpy(), "right")
    has_next = following < len(starts)
    return int((starts[following[has_next]] - actions["until_ns"].to_numpy()[has_next]).sum())


def _lateness(part: pl.DataFrame) -> Iterator[Row]:
    planned = part.filter(pl.col("planned_start_ns").is_not_null())
    late = planned.with_columns(((pl.col("start_ns") - pl.col("planned_start_ns")) / 1e9).alias("late"))
    for agent, mean, highest in (
        late.group_by("agent")
        .agg(pl.col("late").sort().mean().alias("mean"), pl.col("late").max().alias("max"))
        .sort("agent")
    ).iter_rows():
        yield "start_lateness_mean_s", agent, mean
        yield "start_lateness_max_s", agent, highest


def _safety(agent: str, executions: pl.DataFrame, profile: SpeedProfile) -> Iterator[Row]:
    busy = BusyTime(executions["start_ns"].to_numpy(), executions["until_ns"].to_numpy())
    if not busy.total:
        return
    stops = profile.stops_within(busy.start, busy.end)
    lost_ns = profile.lost_ns(busy.start, busy.end)
    yield "safety_stop_s", agent, float(stops.sum()) / 1e9
    yield "safety_stop_count", agent, float(len(stops))
    yield "safety_stop_longest_s", agent, float(stops.max(initial=0)) / 1e9
    yield "mean_speed_scale", agent, 1 - lost_ns / busy.total
    yield "lost_time_s", agent, lost_ns / 1e9


def _distances(signals: pl.DataFrame | None) -> dict[str, list[Row]]:
    if signals is None:
        return {}
    is_whole_run = pl.col("name") == MINIMUM_DISTANCE
    per_run = (
        signals.filter(
            (is_whole_run | pl.col("name").str.ends_with(f"/{MINIMUM_DISTANCE}")) & pl.col("value").is_finite()
        )
        .group_by("run_id", "name")
        .agg(pl.col("value").min().alias("low"), pl.col("value").quantile(0.05, "linear").alias("p5"))
        .sort("run_id", "name")
    )
    rows_of_run: dict[str, list[Row]] = {}
    for run, name, low, p5 in per_run.iter_rows():
        agent = name.removesuffix(MINIMUM_DISTANCE).removesuffix("/")
        rows_of_run.setdefault(run, []).extend([("min_distance_m", agent, low), ("min_distance_p5_m", agent, p5)])
    return rows_of_run
