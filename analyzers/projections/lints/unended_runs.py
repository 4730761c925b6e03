"""Runs whose end nobody wrote."""

from __future__ import annotations

from collections.abc import Iterator

import polars as pl

from hrclog.analyzers.projections.lints.record import Record
from hrclog.diagnostic import Diagnostic


def unended_runs(record: Record) -> Iterator[Diagnostic]:
    """Find runs without a `run_ended`."""
    ended = record.events.filter(pl.col("kind") == "run_ended")["run_id"].unique()
    rows = record.runs.filter(~pl.col("run_id").is_in(ended.implode()))
    for name, path, run in rows.select("name", "path", "run_id").iter_rows():
        yield Diagnostic("run_not_ended", f"run {name!r} has no run_ended event", path, run)
