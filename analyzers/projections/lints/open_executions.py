"""Executions that never ended."""

from __future__ import annotations

from collections.abc import Iterator

import polars as pl

from hrclog.analyzers.projections.clock_step import turned_ends
from hrclog.analyzers.projections.lints.record import Record
from hrclog.analyzers.projections.lints.told import utc
from hrclog.diagnostic import Diagnostic
from hrclog.events import UNKNOWN_OUTCOME


def open_executions(record: Record) -> Iterator[Diagnostic]:
    """Find executions that were open when their log ended."""
    rows = record.intervals.filter((pl.col("outcome") == UNKNOWN_OUTCOME) & pl.col("end_ns").is_null())
    if rows.height:
        keys = turned_ends(record.events, rows)
        rows = rows.join(keys, on=("run_id", "execution_id"), how="anti", maintain_order="left")
    for agent, task, start, path, run in rows.select("agent", "task", "start_ns", "path", "run_id").iter_rows():
        text = f"{agent!r}, {task!r} started at {utc(start)} and never ended; it is censored"
        yield Diagnostic("open_execution", text, path, run)
