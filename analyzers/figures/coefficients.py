"""Estimated coefficients with their 95 % intervals, one row per pair of tasks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import polars as pl

from hrclog.analyzers.figures.heatmap import agent_pairs
from hrclog.analyzers.figures.synergy_heatmap import agent_names, with_estimator
from hrclog.analyzers.figures.text import printable, shorten_apart
from hrclog.analyzers.synergy.untold import untold_text

MAX_ROWS: Final = 40

_PAIR: Final = 30  # characters of both names of a row

HOW_TO_READ: Final = (
    "A task and what the other does meanwhile (n: pairs of executions that overlapped and were used). Dot: the factor "
    "on the task's duration; thick: plus and minus its standard error; thin: its 95 % interval. Where that crosses 1, "
    "there may be no effect at all; hollow dots are sparse (fewer than 5 successes) or weakly identified."
)


@dataclass(frozen=True, slots=True)
class Coefficient:
    """A factor, its standard error and interval (None if there is none), and its status.

    `name` is short and differs from that of every other row; `full` has both tasks in full.
    """

    name: str
    value: float
    std_err: float | None
    low: float | None
    high: float | None
    n: int
    status: str
    full: str


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
    agent_labels = agent_names(synergies)
    return [
        _pair_coefficients(agents, cells, max_rows, " | ".join(agent_labels[name] for name in agents))
        for agents, cells in agent_pairs(synergies)
    ]


def _pair_coefficients(agents: tuple[str, str], cells: pl.DataFrame, max_rows: int, pair_label: str) -> Coefficients:
    observed = cells.filter(pl.col("synergy").is_not_null())
    captions = []
    if why := untold_text(cells):
        captions.append(f"Pairs without a coefficient: {why}.")
    if observed.height > max_rows:
        captions.append(f"{max_rows} of {observed.height} coefficients are drawn, those of the longest overlap.")
        observed = observed.sort("overlap_s", descending=True, nulls_last=True, maintain_order=True).head(max_rows)
    observed = observed.sort("synergy", descending=True, maintain_order=True)
    columns = ("task", "other_task", "synergy", "std_err", "ci_low", "ci_high", "n", "status")
    names = pair_names(cells.select("task", "other_task").rows(), _PAIR)
    rows = [
        Coefficient(
            *(names[task, other_task], value, error, low, high, n or 0, status),
            f"{printable(task)} | {printable(other_task)}",
        )
        for task, other_task, value, error, low, high, n, status in observed.select(columns).iter_rows()
    ]
    title = with_estimator(f"Synergy: {pair_label}", cells)
    return Coefficients(agents, title, HOW_TO_READ, tuple(rows), tuple(captions))


def pair_names(pairs: Sequence[tuple[str, str]], width: int) -> dict[tuple[str, str], str]:
    """Return a name "A | B" per pair, in which A and B differ from all other names on their side.

    Args:
        pairs: all pairs of tasks, drawn or not.
        width: characters of A and B together. Each may have half of them, or more if all names on the other side leave
            room. Pairs that fit are not shortened.
    """
    firsts, seconds = ([printable(pair[side]) for pair in pairs] for side in (0, 1))
    first, second = _shorten_side(firsts, seconds, width), _shorten_side(seconds, firsts, width)
    return {
        pair: f"{task} | {other_task}"
        if len(task) + len(other_task) <= width
        else f"{first[task]} | {second[other_task]}"
        for pair, task, other_task in zip(pairs, firsts, seconds, strict=True)
    }


def _shorten_side(names: Sequence[str], others: Sequence[str], width: int) -> Mapping[str, str]:
    return shorten_apart(names, max(width // 2, width - max(map(len, others), default=0)))
