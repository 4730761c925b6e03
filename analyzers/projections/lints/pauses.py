"""Pauses that nothing ended."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import polars as pl

from hrclog.analyzers.projections.lints.record import Record
from hrclog.analyzers.projections.lints.told import length, utc
from hrclog.diagnostic import Diagnostic
from hrclog.events import TaskEnded, TaskPaused, TaskResumed

_KEY: Final = ("run_id", "execution_id")
_KINDS: Final = (TaskPaused.kind, TaskResumed.kind)


def pauses_never_resumed(record: Record) -> Iterator[Diagnostic]:
    """Find executions whose last pause was not resumed before they ended, or their run did."""
    steps = record.events.filter(pl.col("kind").is_in(_KINDS))
    if steps.is_empty():
        return
    last = steps.sort("time_ns", "seq").unique(_KEY, keep="last", maintain_order=True)
    pauses = last.filter(pl.col("kind") == TaskPaused.kind).select(*_KEY, "seq", pl.col("time_ns").alias("since_ns"))
    paused = record.intervals.join(pauses, on=_KEY, maintain_order="right")
    until = dict(record.happened.group_by("run_id").agg(pl.col("time_ns").max()).iter_rows())
    for row in paused.iter_rows(named=True):
        if row["since_ns"] >= row["start_ns"] and (row["end_ns"] is None or row["end_ns"] >= row["since_ns"]):
            yield Diagnostic("never_resumed", _text(row, until[row["run_id"]]), row["path"], row["run_id"], row["seq"])


def _text(row: dict[str, Any], until_ns: int) -> str:
    paused = f"{row['agent']!r}, {row['task']!r} (execution {row['execution_id']}) paused at {utc(row['since_ns'])}"
    if row["end_ns"] is None:
        left = length((until_ns - row["since_ns"]) / 1e9)
        return f"{paused} and neither resumed nor ended in the {left} to the log's end"
    after = length((row["end_ns"] - row["since_ns"]) / 1e9)
    return f"{paused} and was never resumed; its {TaskEnded.kind} ({row['outcome']}) came {after} later"
