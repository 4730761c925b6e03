"""Why pairs of tasks have no factor, in the words of tables, reports and pictures."""

from __future__ import annotations

from typing import Final

import polars as pl

from hrclog.analyzers.synergy.pairs import NO_SUCCESS, UNOBSERVED, WEAKLY_IDENTIFIED

REASONS: Final = {
    UNOBSERVED: "never overlapped",
    NO_SUCCESS: "overlapped without a success of the task",
    WEAKLY_IDENTIFIED: "not told by the data",
}
"""By status; of a table that holds some runs only, never means in those."""

BRIEFLY: Final = {
    UNOBSERVED: "no overlap",
    NO_SUCCESS: "no success",
    WEAKLY_IDENTIFIED: "not told",
}
"""The same where there is room for two words."""


def untold(synergies: pl.DataFrame) -> dict[str, int]:
    """Return how many pairs of tasks have no factor for each of `REASONS`, without zeros.

    Args:
        synergies: a frame of schema `SYNERGIES`.
    """
    statuses = synergies.filter(pl.col("synergy").is_null())["status"].to_list()
    counts = {status: statuses.count(status) for status in REASONS}
    return {status: count for status, count in counts.items() if count}


def untold_text(synergies: pl.DataFrame) -> str:
    """Return the reasons with their counts in one phrase, "" where every pair has a factor."""
    return ", ".join(f"{REASONS[status]} ({count:,})" for status, count in untold(synergies).items())
