"""A matrix of numbers per pair of tasks, with what is known about each number."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
import polars as pl

from hrclog.analyzers.figures.palette import Paint, diverging, sequential
from hrclog.arrays import BoolArray, FloatArray

MAX_SIDE: Final = 40
_WIDEST: Final = 4.0

Scale = Literal["diverging", "sequential"]


@dataclass(frozen=True, slots=True, eq=False)
class Heatmap:
    """Values of shape (rows, columns) under a title; NaN is unobserved and never drawn as a number.

    `reading` says how to read the heatmap, `unit` what its values are.

    `low` and `high` (the ends of an interval, NaN where unknown), `counts`, `doubtful` (cells to mark) and `reasons`
    (why there is no value, "" where there is one) have the same shape or are None. A diverging scale is logarithmic and
    centred on 1; a sequential scale begins at 0.
    """

    agents: tuple[str, str]
    title: str
    reading: str
    unit: str
    row_title: str
    column_title: str
    rows: tuple[str, ...]
    columns: tuple[str, ...]
    values: FloatArray
    scale: Scale
    low: FloatArray | None = None
    high: FloatArray | None = None
    counts: FloatArray | None = None
    doubtful: BoolArray | None = None
    reasons: tuple[tuple[str, ...], ...] | None = None
    digits: int = 2
    captions: tuple[str, ...] = ()
    common_limit: float | None = None

    @property
    def limit(self) -> float:
        """Return the end of the scale: the common limit, or the largest value (if diverging, from 1.25 to 4)."""
        if self.common_limit is not None:
            return self.common_limit
        positive = self.values[np.isfinite(self.values) & (self.values > 0)]
        if self.scale == "sequential":
            return float(positive.max(initial=0.0)) or 1.0
        return float(np.exp(min(np.abs(np.log(positive)).max(initial=np.log(1.25)), np.log(_WIDEST))))

    def paint(self, value: float) -> Paint:
        """Return the fill of a value; NaN is grey."""
        if not np.isfinite(value):
            return "unobserved"
        if self.scale == "sequential":
            return sequential(value / self.limit)
        return diverging(float(np.log(value) / np.log(self.limit)) if value > 0 else -1.0)


def on_one_scale(heatmaps: Sequence[Heatmap]) -> list[Heatmap]:
    """Return the heatmaps with one scale, so that a colour means the same in each of them."""
    limit = max((heatmap.limit for heatmap in heatmaps), default=None)
    return [replace(heatmap, common_limit=limit) for heatmap in heatmaps]


@dataclass(frozen=True, slots=True)
class Axes:
    """The tasks of a matrix that are drawn, and a caption for those that are not."""

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    captions: tuple[str, ...] = ()


def axes(cells: pl.DataFrame, weight: str, agents: tuple[str, str], max_side: int = MAX_SIDE) -> Axes:
    """Return the tasks to draw: all of them, or those with the largest sum of `weight`, in their order.

    Args:
        cells: columns task and other_task, one row per cell.
        weight: a column of numbers, null counts as 0.
        agents: of the rows and of the columns, for the caption.
        max_side: tasks drawn per side.
    """
    sides, captions = [], []
    for column, agent in zip(("task", "other_task"), agents, strict=True):
        names = cells[column].unique(maintain_order=True).to_list()
        if len(names) > max_side:
            totals = cells.group_by(column, maintain_order=True).agg(pl.col(weight).fill_null(0).sum())
            most = totals.sort(weight, descending=True, maintain_order=True)[column].head(max_side)
            captions.append(f"{max_side} of the {len(names)} tasks of {agent} are drawn, those that overlap most.")
            names = [name for name in names if name in set(most)]
        sides.append(tuple(names))
    return Axes(sides[0], sides[1], tuple(captions))


def matrix(cells: pl.DataFrame, value: str, drawn: Axes) -> FloatArray:
    """Return the values as float64, shape (rows, columns), NaN where there is no row or a null."""
    at_row = {name: index for index, name in enumerate(drawn.rows)}
    at_column = {name: index for index, name in enumerate(drawn.columns)}
    values = np.full((len(drawn.rows), len(drawn.columns)), np.nan)
    for task, other, number in cells.select("task", "other_task", value).iter_rows():
        if number is not None and task in at_row and other in at_column:
            values[at_row[task], at_column[other]] = number
    return values


def agent_pairs(frame: pl.DataFrame) -> Sequence[tuple[tuple[str, str], pl.DataFrame]]:
    """Return the rows of each ordered pair of agents, pairs sorted."""
    parts = frame.partition_by("agent", "other_agent", as_dict=True, maintain_order=True)
    return [((str(key[0]), str(key[1])), parts[key]) for key in sorted(parts)]
