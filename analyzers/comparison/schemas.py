"""The columns of a comparison. What is not known is null.

`a` and `b` are the two sides; differences are B - A, ratios B / A, intervals 95 %.
"""

from __future__ import annotations

from typing import Final

import polars as pl

_MEANS: Final[dict[str, pl.DataType]] = {
    "mean_a": pl.Float64(),  # over everything of the side, not a mean of means per run
    "mean_b": pl.Float64(),
    "difference": pl.Float64(),  # mean_b - mean_a
    "ci_low": pl.Float64(),  # of the difference; null where fewer than two runs of a side have a value
    "ci_high": pl.Float64(),
    "relative": pl.Float64(),  # difference / mean_a; null unless both means are positive
    "differs": pl.Boolean(),  # the interval excludes 0
    "n_a": pl.Int64(),  # values that were averaged
    "n_b": pl.Int64(),
    "runs_a": pl.Int64(),  # runs that have such values
    "runs_b": pl.Int64(),
}


def _means(first: str, second: str) -> pl.Schema:
    keys: dict[str, pl.DataType] = {first: pl.String(), second: pl.String()}
    return pl.Schema(keys | _MEANS)


METRICS: Final = _means("metric", "key")
"""One row per metric and key of either side, of values per run; n is the number of runs."""

DURATIONS: Final = _means("agent", "task")
"""One row per (agent, task) of either side, of seconds per execution that succeeded; n counts executions."""

SUCCESS_RATES: Final = _means("agent", "task")
"""One row per (agent, task) of either side, of 1 for each success and 0 for each failure; n counts executions."""

PLAN: Final = _means("measure", "agent")
"""One row per measure and agent ("" of the whole run), where runs carry planned instants."""

SYNERGIES: Final = pl.Schema(
    {
        "agent": pl.String,
        "task": pl.String,
        "other_agent": pl.String,
        "other_task": pl.String,
        "synergy_a": pl.Float64,  # relative to the task's mean duration in A
        "synergy_b": pl.Float64,
        "ratio": pl.Float64,  # synergy_b / synergy_a; null unless both are known and positive
        "ci_low": pl.Float64,  # of the ratio; null where fewer than two runs of a side have the pair
        "ci_high": pl.Float64,
        "differs": pl.Boolean,  # the interval excludes 1
        "free_a": pl.Float64,  # the same of synergy_free: relative to undisturbed work
        "free_b": pl.Float64,
        "free_ratio": pl.Float64,
        "free_ci_low": pl.Float64,
        "free_ci_high": pl.Float64,
        "free_differs": pl.Boolean,
        "n_a": pl.Int64,  # pairs of executions that overlap
        "n_b": pl.Int64,
        "runs_a": pl.Int64,  # runs in which they do
        "runs_b": pl.Int64,
        "status_a": pl.String,  # as in the synergies; unobserved where the side has no such tasks
        "status_b": pl.String,
    }
)
"""One row per ordered pair of tasks of different agents of either side."""
