"""How long each task took: boxes, whiskers, outliers and means."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from hrclog.analyzers.figures.text import shorten
from hrclog.analyzers.projections.intervals import has_learnt_role, is_success
from hrclog.arrays import FloatArray
from hrclog.wording import counted

MAX_BOXES: Final = 40
_TOGETHER: Final = 24
_MAX_AGENTS: Final = 12  # with a plot each
MAX_OUTLIERS: Final = 40
_REACH: Final = 1.5

HOW_TO_READ: Final = (
    "Half of a task's executions lie in its box, the line is their median; whiskers reach to 1.5 times the box, dots "
    "are outliers. A mean (white circle) far from the median says that a few executions took very long. In brackets: "
    "how many executions."
)


@dataclass(frozen=True, slots=True)
class Box:
    """Seconds of one (agent, task): quartiles, whiskers, outliers, mean, and executions counted."""

    agent: str
    task: str
    count: int
    q25: float
    median: float
    q75: float
    low: float
    high: float
    mean: float
    outliers: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class BoxPlot:
    """A box per (agent, task), sorted by both; `agent` is "" if there are several."""

    agent: str
    title: str
    reading: str
    boxes: tuple[Box, ...]
    captions: tuple[str, ...] = ()


def duration_boxes(intervals: pl.DataFrame, max_boxes: int = MAX_BOXES) -> list[BoxPlot]:
    """Return box plots of the primary executions that ended and succeeded: one plot, or one per agent if it is long.

    Args:
        intervals: a frame of schema `INTERVALS`.
        max_boxes: tasks drawn per plot; beyond it those executed most often.
    """
    samples = (
        intervals.filter(is_success() & has_learnt_role())
        .select("agent", "task", ((pl.col("end_ns") - pl.col("start_ns")) / 1e9).alias("seconds"))
        .group_by("agent", "task")
        .agg(pl.col("seconds").sort(), pl.len().alias("n"))
        .sort("agent", "task")
    )
    if samples.height <= min(_TOGETHER, max_boxes):
        return [_plot("", samples, max_boxes)]
    n_agents = samples["agent"].n_unique()
    most = samples.group_by("agent").agg(pl.col("n").sum()).sort("n", "agent", descending=[True, False])
    drawn = samples.filter(pl.col("agent").is_in(most["agent"].head(_MAX_AGENTS).implode()))
    captions = [f"{_MAX_AGENTS} of {n_agents} agents are drawn, those with most executions."]
    return [
        _plot(str(agent), agent_samples, max_boxes, captions if n_agents > _MAX_AGENTS else ())
        for (agent,), agent_samples in drawn.group_by("agent", maintain_order=True)
    ]


def _plot(agent: str, samples: pl.DataFrame, max_boxes: int, captions: Sequence[str] = ()) -> BoxPlot:
    captions = list(captions)
    if samples.height > max_boxes:
        captions.append(f"{max_boxes} of {samples.height} tasks are drawn, those executed most often.")
        samples = samples.sort("n", descending=True, maintain_order=True).head(max_boxes).sort("agent", "task")
    boxes = [_box(who, task, np.asarray(seconds)) for who, task, seconds in samples.drop("n").iter_rows()]
    hidden = sum(left_out for _, left_out in boxes)
    if hidden:
        which = counted(hidden, "outlier is", "outliers are")
        captions.append(f"{which} not drawn: at most {MAX_OUTLIERS} per task, the extreme ones.")
    title = "Durations of tasks that succeeded" + (f": {shorten(agent, 40)}" if agent else "")
    return BoxPlot(agent, title, HOW_TO_READ, tuple(box for box, _ in boxes), tuple(captions))


def _box(agent: str, task: str, sample: FloatArray) -> tuple[Box, int]:
    """Return the box of a sorted sample, and how many outliers it leaves out. The whiskers follow Tukey."""
    q25, median, q75 = np.quantile(sample, (0.25, 0.5, 0.75))
    reach = _REACH * (q75 - q25)
    inliers = sample[(sample >= q25 - reach) & (sample <= q75 + reach)]
    outliers = sample[(sample < q25 - reach) | (sample > q75 + reach)]
    drawn_outliers = outliers[np.sort(np.argsort(-np.abs(outliers - median), kind="stable")[:MAX_OUTLIERS])]
    box = Box(
        agent,
        task,
        len(sample),
        float(q25),
        float(median),
        float(q75),
        float(inliers[0]),
        float(inliers[-1]),
        float(sample.mean()),
        tuple(drawn_outliers.tolist()),
    )
    return box, len(outliers) - len(drawn_outliers)
