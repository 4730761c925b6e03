"""Estimated coefficients with their 95 % intervals, one row per pair of tasks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import polars as pl

from hrclog.analyzers.figures.heatmap import agent_pairs
from hrclog.analyzers.figures.synergy_heatmap import agent_names, with_estimator
from hrclog.analyzers.figures.text import printable, shorten_apart

MAX_ROWS: Final = 40

_PAIR: Final = 30  # characters of both names of a row

HOW_TO_READ: Final = (
    "A task and what the other does meanwhile (n: pairs of successful executions that overlapped). Dot: the factor on "
    "the task's duration; thick: plus and minus its standard error; thin: its 95 % interval. Where that crosses 1, "
    "there may be no effect at all; hollow dots are sparse (n < 5) or weakly identified."
)


@dataclass(frozen=True, slots=True)
class Coefficient:
    """A factor, its standard error and interval (None where there is none), and how far it can be trusted.

    `name` is short and unlike that of any other row; `full` says both tasks in full.
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
    called = agent_names(synergies)
    return [
        _pair(agents, cells, max_rows, " | ".join(called[name] for name in agents))
        for agents, cells in agent_pairs(synergies)
    ]


def _pair(agents: tuple[str, str], cells: pl.DataFrame, max_rows: int, called: str) -> Coefficients:
    observed = cells.filter(pl.col("synergy").is_not_null())
    captions = []
    if observed.height < cells.height:
        captions.append(f"Unobserved pairs, without a coefficient: {cells.height - observed.height:,}.")
    if observed.height > max_rows:
        captions.append(f"{max_rows} of {observed.height} coefficients are drawn, those of the longest overlap.")
        observed = observed.sort("overlap_s", descending=True, nulls_last=True, maintain_order=True).head(max_rows)
    observed = observed.sort("synergy", descending=True, maintain_order=True)
    columns = ("task", "other_task", "synergy", "std_err", "ci_low", "ci_high", "n", "status")
    names = pair_names(cells.select("task", "other_task").rows(), _PAIR)
    rows = [
        Coefficient(
            *(names[task, with_], value, error, low, high, n or 0, status), f"{printable(task)} | {printable(with_)}"
        )
        for task, with_, value, error, low, high, n, status in observed.select(columns).iter_rows()
    ]
    title = with_estimator(f"Synergy: {called}", cells)
    return Coefficients(agents, title, HOW_TO_READ, tuple(rows), tuple(captions))


def pair_names(pairs: Sequence[tuple[str, str]], width: int) -> dict[tuple[str, str], str]:
    """Return a name "A | B" per pair in which both can be told from the others of their side.

    Args:
        pairs: of tasks: all that there are, drawn or not.
        width: characters of A and B together. Either may have half of them, more where all others leave room; pairs
            that fit stay whole.
    """
    firsts, seconds = ([printable(pair[side]) for pair in pairs] for side in (0, 1))
    first, second = _shortened(firsts, seconds, width), _shortened(seconds, firsts, width)
    return {
        pair: f"{one} | {other}" if len(one) + len(other) <= width else f"{first[one]} | {second[other]}"
        for pair, one, other in zip(pairs, firsts, seconds, strict=True)
    }


def _shortened(names: Sequence[str], others: Sequence[str], width: int) -> Mapping[str, str]:
    return shorten_apart(names, max(width // 2, width - max(map(len, others), default=0)))
