"""Everything drawable of one run."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import polars as pl

from hrclog.analyzers.figures.cell import CellFigure, cell_figure
from hrclog.analyzers.figures.events import EventLines, event_lines, pauses, safety_lanes
from hrclog.analyzers.figures.gantt import Gantt, Lane, execution_lanes, legend, limited
from hrclog.analyzers.figures.series import Series, overlaps_so_far, signal_series, speed_scales, without_echoes
from hrclog.analyzers.figures.table import DataTable
from hrclog.analyzers.projections.tags import run_label, tags_text
from hrclog.arrays import IntArray
from hrclog.log.messages.recorded_scene import RunScene

_KINDS: Final = {"done": 0, "planned": 1, "safety": 2}


@dataclass(frozen=True, slots=True, eq=False)
class RunFigures:
    """The pictures of a run; all times are ns since its first event, which was at `origin_ns`."""

    run_id: str
    name: str
    label: str  # the name, and what else tells the run apart
    origin_ns: int
    facts: tuple[tuple[str, str | int | float], ...]
    gantt: Gantt
    series: tuple[Series, ...]
    events: EventLines
    tasks: DataTable
    captions: tuple[str, ...] = ()
    cell: CellFigure | None = None


def run_figures(
    run: Mapping[str, Any],
    intervals: pl.DataFrame,
    events: pl.DataFrame,
    signals: pl.DataFrame,
    scene: RunScene | None = None,
    tasks: Collection[str] = (),
) -> RunFigures:
    """Return the figures of a run.

    Args:
        run: a row of schema `RUNS`.
        intervals: its executions, schema `INTERVALS`.
        events: its flat events, columns of `hrclog.events.COLUMNS`.
        signals: its samples, schema `SIGNALS`.
        scene: what was recorded of its cell.
        tasks: also those of other runs, so that all runs have the same colours.
    """
    origin, end = _time_span(run, intervals, events, signals)
    lanes, captions = limited(_lanes(intervals, events, origin, end, tasks))
    signal_lines, left_out = signal_series(signals, origin, scene.descriptions if scene is not None else ())
    overlap_lines, pairs_left_out = overlaps_so_far(intervals, origin)
    lines = event_lines(events, origin)
    start_ns, end_ns, outside = _in_view(lanes, end - origin)
    gantt = Gantt(lanes, start_ns, end_ns, legend(intervals, tasks))
    cell = cell_figure(scene, events, signals, origin, gantt.start_ns) if scene is not None else None
    series = without_echoes([*speed_scales(events, origin, end), *signal_lines, *overlap_lines])
    captions += cell.captions if cell is not None else ()
    return RunFigures(
        run_id=run["run_id"],
        name=run["name"] or run["run_id"],
        label=run_label(run),
        origin_ns=origin,
        facts=_facts(run),
        gantt=gantt,
        series=tuple(sorted(series, key=lambda signal: signal.joint)),
        events=lines,
        tasks=_tasks(intervals, origin),
        captions=(*captions, *outside, *left_out, *pairs_left_out, *lines.captions),
        cell=cell,
    )


def _time_span(
    run: Mapping[str, Any], intervals: pl.DataFrame, events: pl.DataFrame, signals: pl.DataFrame
) -> tuple[int, int]:
    times = [run["start_ns"], run["end_ns"]]
    for frame, columns in ((intervals, ("start_ns", "until_ns")), (events, ("time_ns",)), (signals, ("time_ns",))):
        times += [value for column in columns for value in (frame[column].min(), frame[column].max())]
    known_times = [int(time) for time in times if time is not None]
    origin = events["time_ns"].min() if events.height else min(known_times, default=0)
    return int(origin), max(known_times, default=0)  # type: ignore[arg-type]  # int64 columns


def _in_view(lanes: Sequence[Lane], end_ns: int) -> tuple[int, int, tuple[str, ...]]:
    """Return the start and the end of the time in view, and a caption if something lies outside.

    An instant is not in view if it is farther from the executions than they last in total: it would leave no room for
    the rest.
    """
    done_bars = [bar for lane in lanes if lane.kind == "done" for bar in lane.bars] or [
        bar for lane in lanes for bar in lane.bars
    ]
    if not done_bars:
        return 0, max(end_ns, 0), ()
    first, last = min(bar.start_ns for bar in done_bars), max(bar.end_ns for bar in done_bars)
    reach = max(last - first, 1)
    instants = [0, end_ns, *(at for lane in lanes for bar in lane.bars for at in (bar.start_ns, bar.end_ns))]
    near_instants = [at for at in instants if first - reach <= at <= last + reach]
    outside = len(near_instants) < len(instants)
    note = "Something lies far before or after what was done, out of view: scroll, or see the events."
    return min(near_instants), max(near_instants), (note,) if outside else ()


def _lanes(
    intervals: pl.DataFrame, events: pl.DataFrame, origin_ns: int, end_ns: int, tasks: Collection[str]
) -> list[Lane]:
    lanes = execution_lanes(intervals, pauses(events, end_ns), origin_ns, tasks) + safety_lanes(
        events, origin_ns, end_ns
    )
    return sorted(lanes, key=lambda lane: (lane.agent, _KINDS[lane.kind], lane.number))


def _tasks(intervals: pl.DataFrame, origin_ns: int) -> DataTable:
    ordered = intervals.sort("start_ns", "agent", "task", "execution_id")
    frame = ordered.select(
        "agent",
        "task",
        "outcome",
        "attempt",
        _seconds(pl.col("start_ns") - origin_ns, "start_s"),
        _seconds(pl.col("end_ns") - pl.col("start_ns"), "duration_s"),
        _seconds(pl.col("paused_ns"), "paused_s"),
        _seconds(pl.col("planned_start_ns") - origin_ns, "planned_start_s"),
        "reason",
    )
    return DataTable(
        "tasks", "Executions", frame, times_ns=_separate_times((ordered["start_ns"] - origin_ns).to_numpy())
    )


def _separate_times(times_ns: IntArray) -> IntArray:
    """Return instants that rise by at least 1 ns, because a viewer shows one row per instant."""
    steps = np.arange(len(times_ns))
    separated: IntArray = np.maximum.accumulate(times_ns - steps) + steps
    return separated


def _seconds(ns: pl.Expr, name: str) -> pl.Expr:
    return (ns / 1e9).round(9).alias(name)  # no digits beyond a nanosecond


def _facts(run: Mapping[str, Any]) -> tuple[tuple[str, str | int | float], ...]:
    facts = {
        "run": run["name"],
        "run_id": run["run_id"],
        "tags": tags_text(run) or None,
        "outcome": run["outcome"] or "unknown",
        "makespan_s": run["makespan_s"],
        "agents": ", ".join(run["agents"] or ()),
        "executions": run["n_executions"],
        "failed": run["n_failed"],
        "open": run["n_open"],
        "log": run["path"],
    }
    return tuple((name, value) for name, value in facts.items() if value is not None)
