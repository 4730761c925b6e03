"""How estimates settle as runs accumulate: the matrix after 1, 2, 5, … runs, and curves over the number of runs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import polars as pl

from hrclog.analyzers.figures.coefficients import pair_names
from hrclog.analyzers.figures.curves import MAX_CURVES, Curve, Knot, curves_plot
from hrclog.analyzers.figures.heatmap import agent_pairs, axes
from hrclog.analyzers.figures.heatmap_plot import heatmap_plot
from hrclog.analyzers.figures.plot import Plot, Steps
from hrclog.analyzers.figures.synergy_heatmap import SPARSE_MARK, agent_names, synergy_heatmaps, with_estimator
from hrclog.analyzers.figures.text import shorten_apart
from hrclog.analyzers.projections.overlaps import PAIR
from hrclog.analyzers.synergy.pairs import OK
from hrclog.wording import counted

HOW_TO_READ_CURVES: Final = (
    "Each line is a factor on the duration of the first task while the other agent does the second, as the first runs "
    "alone tell it, in its 95 % interval. A line that still moves when the last runs come in has not settled; a flat "
    "one may still move if the work changes."
)
HOW_TO_READ_DURATIONS: Final = (
    "Each line is the mean duration of a task over the first runs alone, in its 95 % interval. A line that still "
    "moves when the last runs come in has not settled; a flat one may still move if the work changes."
)

_CAPTIONS: Final = (
    SPARSE_MARK,
    "Grey, n/a: no overlap so far, no success of the task beside the other so far, or not told by the data.",
    "The colours are those of all runs: a colour means the same number in every step.",
)
_SHARED: Final = (
    "Runs count in order of time, so a jump may mean that the work changed; a step holds the runs of those before it, "
    "so lines grow flatter for that reason too."
)
_INDEPENDENT: Final = (
    "The intervals of means take executions as independent, which those of one run or session need not be."
)
_NAME: Final = 34  # characters of the tasks at the end of a line


def settling_heatmaps(settling: pl.DataFrame, *, note: str = "") -> list[Steps]:
    """Return the matrix of each ordered pair of agents after growing numbers of runs. A single step gives no matrix.

    All steps have the rows, columns, colours and notes of the last step.

    Args:
        settling: a frame of schema `SETTLING`.
        note: a further note on each plot.
    """
    numbers = settling["runs"].unique().sort().to_list()
    if len(numbers) < 2:
        return []
    settling = settling.filter(pl.col("synergy").is_not_null().any().over("agent", "other_agent"))
    last = settling.filter(pl.col("runs") == numbers[-1]).sort(PAIR)
    # tasks of too large a matrix are chosen by their overlap in all runs
    overlap = last.select(*PAIR, "overlap_s")
    limits = {heatmap.agents: heatmap.limit for heatmap in synergy_heatmaps(last)}
    captions = {
        agents: (*_CAPTIONS, *axes(cells, "overlap_s", agents).captions, *filter(None, [note]))
        for agents, cells in agent_pairs(last)
    }
    titles = {heatmap.agents: f"{heatmap.title}, run by run" for heatmap in synergy_heatmaps(last)}
    plots: dict[tuple[str, str], list[Plot]] = {}
    for number in numbers:
        cells = settling.filter(pl.col("runs") == number).drop("overlap_s").join(overlap, on=PAIR).sort(PAIR)
        for heatmap in synergy_heatmaps(cells):
            title = f"{heatmap.title}, after {number:,} of {counted(numbers[-1], 'run')}"
            agents = heatmap.agents
            step = replace(heatmap, title=title, captions=captions[agents], common_limit=limits[agents])
            plots.setdefault(agents, []).append(heatmap_plot(step, ("settling", "synergy", *agents)))
    return [Steps(titles[agents], tuple(numbers), tuple(plots[agents])) for agents in plots]


def settling_curves(settling: pl.DataFrame, *, note: str = "") -> list[Plot]:
    """Return curves of the factors over the number of runs, per ordered pair of agents. A single step gives no curve.

    The plots show the pairs of tasks whose last factor differs from 1 most surely: those with the largest |log synergy|
    over its standard error (std_err / synergy). Factors without an error come last.

    Args:
        settling: a frame of schema `SETTLING`.
        note: a further note on each plot.
    """
    if settling["runs"].n_unique() < 2:
        return []
    agent_labels = agent_names(settling)
    plots = (_synergy_plot(agents, cells, agent_labels, note) for agents, cells in agent_pairs(settling))
    return [plot for plot in plots if plot]


def duration_curves(settling: pl.DataFrame) -> list[Plot]:
    """Return curves of the mean durations over the number of runs, per agent. A single step gives no curve.

    The plots show the tasks whose last mean is least certain: those with the widest interval relative to the mean.
    Means without an interval come last.

    Args:
        settling: a frame of schema `SETTLING_DURATIONS`.
    """
    if settling["runs"].n_unique() < 2:
        return []
    parts = settling.partition_by("agent", as_dict=True)
    agent_labels = shorten_apart(settling["agent"].unique(), 40)
    plots = (_duration_plot(str(agent), parts[agent,], agent_labels) for (agent,) in sorted(parts))
    return [plot for plot in plots if plot]


def _synergy_plot(
    agents: tuple[str, str], cells: pl.DataFrame, agent_labels: Mapping[str, str], note: str
) -> Plot | None:
    last = cells.filter(pl.col("runs") == cells["runs"].max())
    value, error = pl.col("synergy"), pl.col("std_err")
    certainty = (value.log().abs() * value / error).fill_nan(None)
    ranked = last.filter(value > 0).sort(certainty, *PAIR, descending=[True, *[False] * len(PAIR)], nulls_last=True)
    drawn = ranked.head(MAX_CURVES)
    if drawn.is_empty():
        return None
    names = pair_names(last.select("task", "other_task").rows(), _NAME)
    curves = [
        Curve(
            names[task, other] + ("" if status == OK else "*"),
            _knots(cells, {"task": task, "other_task": other}, _FACTOR),
        )
        for task, other, status in drawn.select("task", "other_task", "status").iter_rows()
    ]
    n_unknown = last.height - ranked.height
    notes = [_SHARED, *filter(None, [note])]
    if any(status != OK for status in drawn["status"]):
        notes.insert(0, SPARSE_MARK)
    if n_unknown:
        notes.insert(0, f"Pairs of tasks without a factor after all runs: {n_unknown:,}.")
    if ranked.height > drawn.height:
        sentence = f"{drawn.height} of {ranked.height:,} factors are drawn"
        notes.insert(
            0, f"{sentence}, those that are surest to differ from 1; {ranked.height - drawn.height:,} are not."
        )
    agent, other = (agent_labels[name] for name in agents)
    return curves_plot(
        ("settling", "curves", *agents),
        with_estimator(f"How synergies settle: {agent} while {other} works", last),
        HOW_TO_READ_CURVES,
        curves,
        cells["runs"].unique().sort().to_list(),
        "factor on the duration",
        level=1.0,
        notes=tuple(notes),
    )


def _duration_plot(agent: str, tasks: pl.DataFrame, agent_labels: Mapping[str, str]) -> Plot | None:
    last = tasks.filter(pl.col("runs") == tasks["runs"].max())
    width = (pl.col("mean_high_s") - pl.col("mean_low_s")) / pl.col("mean_s")
    ranked = last.filter(pl.col("mean_s") > 0).sort(width, "task", descending=[True, False], nulls_last=True)
    drawn = ranked["task"].head(MAX_CURVES).to_list()
    if not drawn:
        return None
    names = shorten_apart(last["task"], _NAME)
    curves = [Curve(names[task], _knots(tasks, {"task": task}, _SECONDS)) for task in drawn]
    n_unknown = last.height - ranked.height
    notes = [_SHARED, _INDEPENDENT]
    if n_unknown:
        notes.insert(0, f"Tasks that never succeeded: {n_unknown:,}.")
    if ranked.height > len(drawn):
        notes.insert(0, f"{len(drawn)} of {ranked.height:,} tasks are drawn, those whose mean is least sure.")
    return curves_plot(
        ("settling", "durations", agent),
        f"How mean durations settle: {agent_labels[agent]}",
        HOW_TO_READ_DURATIONS,
        curves,
        tasks["runs"].unique().sort().to_list(),
        "mean duration, seconds",
        notes=tuple(notes),
    )


_FACTOR: Final = ("synergy", "ci_low", "ci_high", "n", "")
_SECONDS: Final = ("mean_s", "mean_low_s", "mean_high_s", "count", " s")


def _knots(
    rows: pl.DataFrame, keys: dict[str, str], columns: tuple[str, str, str, str, str]
) -> tuple[Knot | None, ...]:
    """Return a knot per step from the rows of one curve."""
    *names, unit = columns
    curve_rows = rows.filter(**keys).sort("runs").select("runs", *names)
    name = " | ".join(keys.values())
    return tuple(_knot(name, unit, *row) for row in curve_rows.iter_rows())


def _knot(
    name: str, unit: str, runs: int, value: float | None, low: float | None, high: float | None, n: int
) -> Knot | None:
    # a regression may give a factor that has no logarithm
    if value is None or not (math.isfinite(value) and value > 0):
        return None
    interval = f" (95 % {low:,.3f} to {high:,.3f})" if low is not None and high is not None else ""
    label = f"{name}, after {counted(runs, 'run')}: {value:,.3f}{unit}{interval}, n = {n:,}"
    return Knot(runs, value, low, high, label)
