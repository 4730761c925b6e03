"""How much longer or shorter a task takes while another agent is at one of its own."""

from __future__ import annotations

from typing import Final

import numpy as np
import polars as pl

from hrclog.analyzers.figures.heatmap import Heatmap, agent_pairs, axes, matrix, on_one_scale
from hrclog.analyzers.figures.text import shorten

HOW_TO_READ: Final = (
    "Factor on the duration of the row's task while the column's task runs: above 1 (orange) it takes longer, below 1 "
    "(blue) less. Below it the 95 % interval; n counts pairs of executions that overlapped."
)


def synergy_heatmaps(synergies: pl.DataFrame) -> list[Heatmap]:
    """Return a heatmap per ordered pair of agents, all on one scale.

    Args:
        synergies: a frame of schema `SYNERGIES`.
    """
    return on_one_scale([_pair(agents, cells) for agents, cells in agent_pairs(synergies)])


def _pair(agents: tuple[str, str], cells: pl.DataFrame) -> Heatmap:
    agent, other = (shorten(name, 28) for name in agents)
    drawn = axes(cells, "overlap_s", agents)
    cells = cells.with_columns(
        pl.col("status").is_in(("sparse", "weakly_identified")).cast(pl.Float64).alias("doubtful"),
    )
    values = matrix(cells, "synergy", drawn)
    doubtful = np.nan_to_num(matrix(cells, "doubtful", drawn)) > 0
    estimator = ", ".join(sorted(set(cells["estimator"].to_list()) - {""}))
    marked = "* sparse (n < 5) or weakly identified." if doubtful.any() else ""
    unseen = int(np.isnan(values).sum())
    grey = f"Grey, n/a: never observed together, or not told by the data ({unseen:,})." if unseen else ""
    return Heatmap(
        agents=agents,
        title=f"Synergy: {agent} while {other} works" + (f" ({estimator})" if estimator else ""),
        reading=HOW_TO_READ,
        unit="factor on the duration",
        row_title=f"task of {agent}",
        column_title=f"while {other} does",
        rows=drawn.rows,
        columns=drawn.columns,
        values=values,
        scale="diverging",
        low=matrix(cells, "ci_low", drawn),
        high=matrix(cells, "ci_high", drawn),
        counts=matrix(cells, "n", drawn),
        doubtful=doubtful,
        captions=tuple(text for text in (marked, grey, *drawn.captions) if text),
    )
