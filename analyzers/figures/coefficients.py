"""Estimated coefficients with their 95 % intervals, one row per pair of tasks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import polars as pl

from hrclog.analyzers.figures.heatmap import agent_pairs
from hrclog.analyzers.figures.text import printable, shorten

MAX_ROWS: Final = 40

HOW_TO_READ: Final = (
    "A task and what the other does meanwhile (pairs of executions that overlapped). Dot: the factor on the task's "
    "duration; thick: plus and minus its standard error; thin: its 95 % interval. Where that crosses 1, there may be "
    "no effect at all; hollow dots are sparse (n < 5) or weakly identified."
)


@dataclass(frozen=True, slots=True)
class Coefficient:
    """A factor, its standard error and interval (None where there is none), and how far it can be trusted."""

    name: str
    value: float
    std_err: float | None
    low: float | None
    high: float | None
    n: int
    status: str


@dataclass(frozen=True, slots=True)
class Coefficients:
    """The coefficients of an ordered pair of agents, largest first; 1 is no effect."""

    agents: tuple[str, str]
    title: str
    reading: str
    rows: tuple[Coefficient, ...]
    captions: tuple[str, ...] = ()


def synergy_coefficients(synergies: pl.DataFrame, max_rows: int = MAX_ROWS) -> list[Coefficients]:
    """Return the coefficients of each ordered pair of agents.

    Args:
        synergies: a frame of schema `SYNERGIES`.
        max_rows: coefficients drawn per pair of agents; beyond it those of the longest overlap.
    """
    return [_pair(agents, cells, max_rows) for agents, cells in agent_pairs(synergies)]


def _pair(agents: tuple[str, str], cells: pl.DataFrame, max_rows: int) -> Coefficients:
    agent, other = (shorten(name, 28) for name in agents)
    observed = cells.filter(pl.col("synergy").is_not_null())
    captions = []
    if observed.height < cells.height:
        captions.append(f"Unobserved pairs, without a coefficient: {cells.height - observed.height:,}.")
    if observed.height > max_rows:
        captions.append(f"{max_rows} of {observed.height} coefficients are drawn, those of the longest overlap.")
        observed = observed.sort("overlap_s", descending=True, nulls_last=True, maintain_order=True).head(max_rows)
    observed = observed.sort("synergy", descending=True, maintain_order=True)
    columns = ("task", "other_task", "synergy", "std_err", "ci_low", "ci_high", "n", "status")
    rows = [
        Coefficient(f"{printable(task)} | {printable(with_)}", value, error, low, high, n or 0, status)
        for task, with_, value, error, low, high, n, status in observed.select(columns).iter_rows()
    ]
    return Coefficients(agents, f"Synergy: {agent} | {other}", HOW_TO_READ, tuple(rows), tuple(captions))
