"""How much longer or shorter a task takes while another agent executes a task."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
import polars as pl

from hrclog.analyzers.figures.heatmap import MAX_SIDE, Axes, Heatmap, agent_pairs, axes, matrix, on_one_scale
from hrclog.analyzers.figures.text import shorten_apart
from hrclog.analyzers.synergy.pairs import UNOBSERVED
from hrclog.analyzers.synergy.untold import BRIEFLY, untold_text

HOW_TO_READ: Final = (
    "Factor on the duration of the row's task while the column's task runs (orange: longer, blue: shorter), relative "
    "to the task's mean over all its executions, good and bad company mixed: where others slow the task down, "
    "undisturbed pairs lie below 1. Under each factor stand its 95 % interval and n, which counts the pairs of "
    "executions that overlapped and were used, whatever came of the column's."
)

SPARSE_MARK: Final = "* sparse (fewer than 5 successes) or weakly identified."

AGENT: Final = 28
"""The most characters of an agent's name in titles."""


def synergy_heatmaps(synergies: pl.DataFrame, max_side: int = MAX_SIDE) -> list[Heatmap]:
    """Return a heatmap per ordered pair of agents, all on one scale.

    Args:
        synergies: a frame of schema `SYNERGIES`.
        max_side: tasks drawn per side.
    """
    agent_labels = agent_names(synergies)
    return on_one_scale(
        [_pair_heatmap(agents, cells, agent_labels, max_side) for agents, cells in agent_pairs(synergies)]
    )


def agent_names(pairs: pl.DataFrame) -> dict[str, str]:
    """Return a label per agent for titles. Labels differ across all pairs, because their pictures stand side by side.

    Args:
        pairs: columns agent and other_agent.
    """
    return shorten_apart((*pairs["agent"].unique(), *pairs["other_agent"].unique()), AGENT)


def with_estimator(title: str, cells: pl.DataFrame) -> str:
    """Return the title with the estimator of the cells in brackets."""
    estimators = ", ".join(sorted(set(cells["estimator"].to_list()) - {""}))
    return f"{title} ({estimators})" if estimators else title


def _pair_heatmap(
    agents: tuple[str, str], cells: pl.DataFrame, agent_labels: Mapping[str, str], max_side: int
) -> Heatmap:
    agent, other = (agent_labels[name] for name in agents)
    drawn = axes(cells, "overlap_s", agents, max_side)
    cells = cells.with_columns(
        pl.col("status").is_in(("sparse", "weakly_identified")).cast(pl.Float64).alias("doubtful"),
    )
    values = matrix(cells, "synergy", drawn)
    doubtful = np.nan_to_num(matrix(cells, "doubtful", drawn)) > 0
    marked = SPARSE_MARK if doubtful.any() else ""
    why = untold_text(cells.filter(pl.col("task").is_in(drawn.rows), pl.col("other_task").is_in(drawn.columns)))
    grey = f"Grey, n/a: {why}." if why else ""
    return Heatmap(
        agents=agents,
        title=with_estimator(f"Synergy: {agent} while {other} works", cells),
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
        reasons=_reasons(cells, drawn),
        captions=tuple(text for text in (marked, grey, *drawn.captions) if text),
    )


def _reasons(cells: pl.DataFrame, drawn: Axes) -> tuple[tuple[str, ...], ...]:
    """Return why cells have no factor, "" where they have one; what has no row did not overlap."""
    of_pair = {
        (task, other): "" if factor is not None else BRIEFLY.get(status, "")
        for task, other, factor, status in cells.select("task", "other_task", "synergy", "status").iter_rows()
    }
    return tuple(
        tuple(of_pair.get((row, column), BRIEFLY[UNOBSERVED]) for column in drawn.columns) for row in drawn.rows
    )
