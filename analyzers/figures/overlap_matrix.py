"""How much the tasks of two agents overlapped: in seconds, and as a share of the task."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import polars as pl

from hrclog.analyzers.figures.heatmap import Heatmap, agent_pairs, axes, matrix, on_one_scale
from hrclog.analyzers.figures.synergy_heatmap import agent_names


def overlap_matrices(pair_overlaps: pl.DataFrame) -> list[tuple[Heatmap, Heatmap]]:
    """Return (seconds, mean ratio) per ordered pair of agents, each kind on one scale.

    Args:
        pair_overlaps: a frame of schema `PAIR_OVERLAPS`.
    """
    agent_labels = agent_names(pair_overlaps)
    pairs = [_pair_heatmaps(agents, cells, agent_labels) for agents, cells in agent_pairs(pair_overlaps)]
    seconds, ratios = (on_one_scale([pair[kind] for pair in pairs]) for kind in (0, 1))
    return list(zip(seconds, ratios, strict=True))


def _pair_heatmaps(
    agents: tuple[str, str], cells: pl.DataFrame, agent_labels: Mapping[str, str]
) -> tuple[Heatmap, Heatmap]:
    agent, other = (agent_labels[name] for name in agents)
    drawn = axes(cells, "overlap_s", agents)
    empty = Heatmap(
        agents=agents,
        title="",
        reading="",
        unit="",
        row_title=f"task of {agent}",
        column_title=f"while {other} does",
        rows=drawn.rows,
        columns=drawn.columns,
        values=np.empty((0, 0)),
        scale="sequential",
        counts=matrix(cells, "n", drawn),
        captions=drawn.captions,
    )
    seconds = replace(
        empty,
        title=f"Overlap: {agent} with {other}, total seconds",
        values=matrix(cells, "overlap_s", drawn),
        reading="Seconds in which both tasks ran at once, over all runs; n counts pairs of executions that overlapped, "
        "of all executions, failed ones too.",
        unit="seconds together",
        digits=1,
    )
    ratio = replace(
        empty,
        title=f"Overlap: {agent} with {other}, mean share of the row's task",
        values=matrix(cells, "mean_ratio", drawn),
        reading="How much of the row's task ran beside the column's: the mean over all its executions, zeros included.",
        unit="share of the row's task",
    )
    return seconds, ratio
