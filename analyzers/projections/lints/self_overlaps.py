"""Agents that do two things at a time."""

from __future__ import annotations

from collections.abc import Iterator

import polars as pl

from hrclog.analyzers.projections.lints.record import Record
from hrclog.diagnostic import Diagnostic


def self_overlaps(record: Record) -> Iterator[Diagnostic]:
    """Find agents that overlap themselves, by run."""
    rows = (
        record.overlaps.filter(pl.col("agent") == pl.col("other_agent"))
        .group_by("run_id", "agent")
        .agg((pl.col("overlap_ns").sum() / 2e9).alias("seconds"))
        .join(record.runs.select("run_id", "path"), on="run_id")
        .sort("path", "run_id", "agent")
    )
    for run, agent, seconds, path in rows.iter_rows():
        yield Diagnostic("self_overlap", f"{agent!r} overlaps itself for {seconds:.3f} s", path, run)
