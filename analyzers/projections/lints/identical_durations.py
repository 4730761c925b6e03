"""Durations that no measurement gives."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import polars as pl

from hrclog.analyzers.projections.lints.record import Record
from hrclog.analyzers.projections.lints.told import length
from hrclog.diagnostic import Diagnostic

_ENOUGH: Final = 5
_MOST: Final = 0.9
_SAME_NS: Final = 2_000
"""Seconds since 1970 in 64-bit floats are up to 0.24 us off, and so are their differences."""


def identical_durations(record: Record) -> Iterator[Diagnostic]:
    """Find tasks whose ended executions nearly all last equally long."""
    key, duration = ("agent", "task"), pl.col("end_ns") - pl.col("start_ns")
    tasks = (
        record.intervals.filter(pl.col("end_ns") > pl.col("start_ns"))
        .select(*key, "run_id", duration.alias("duration"))
        .group_by(key)
        .agg(
            pl.len().alias("n"),
            pl.col("run_id").n_unique().alias("n_runs"),
            pl.col("run_id").first(),
            pl.col("duration").median().alias("median"),
            ((pl.col("duration") - pl.col("duration").median()).abs() <= _SAME_NS).sum().alias("same"),
        )
        .filter((pl.col("n") >= _ENOUGH) & (pl.col("same") >= _MOST * pl.col("n")))
        .sort(key)
    )
    for agent, task, n, n_runs, run, median, same in tasks.iter_rows():
        share = f"all {n:,}" if same == n else f"{same:,} of {n:,}"
        text = (
            f"{share} durations of {agent!r}, {task!r} are {length(median / 1e9)}: was a column filled in, or are they "
            "simulated?"
        )
        path, run_id = (record.paths[run], run) if n_runs == 1 else ("", "")
        yield Diagnostic("identical_durations", text, path, run_id)
