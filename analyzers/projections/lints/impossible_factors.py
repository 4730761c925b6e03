"""Factors that no duration can have."""

from __future__ import annotations

import polars as pl

from hrclog.diagnostic import Diagnostic


def impossible_factors(synergies: pl.DataFrame) -> list[Diagnostic]:
    """Find factors of 0 or less, which a linear fit can give and no duration can have.

    Args:
        synergies: a frame of schema `SYNERGIES`.
    """
    return [
        Diagnostic(
            "impossible_factor",
            f"{estimator} gives a factor of {factor:.2f} for {agent!r}, {task!r} while {other!r}, {other_task!r} runs",
        )
        for agent, task, other, other_task, factor, estimator in synergies.filter(pl.col("synergy") <= 0)
        .select("agent", "task", "other_agent", "other_task", "synergy", "estimator")
        .iter_rows()
    ]
