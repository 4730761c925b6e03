"""Executions that took no time."""

from __future__ import annotations

from collections.abc import Iterator

import polars as pl

from hrclog.analyzers.projections.lints.record import Record
from hrclog.diagnostic import Diagnostic
from hrclog.wording import agree, counted


def zero_durations(record: Record) -> Iterator[Diagnostic]:
    """Find executions that ended in the instant of their start, by run, agent and task."""
    key = ("path", "run_id", "agent", "task")
    rows = record.intervals.filter(pl.col("end_ns") == pl.col("start_ns"))
    for path, run, agent, task, count in rows.group_by(key).len().sort(key).iter_rows():
        text = (
            f"{counted(count, 'execution')} of {agent!r}, {task!r} ended in the instant of "
            f"{agree(count, 'its', 'their')} start"
        )
        yield Diagnostic("zero_duration", text, path, run)
