"""Executions far beyond what their task takes."""

from __future__ import annotations

from collections.abc import Iterator
from math import log
from typing import Final

import polars as pl

from hrclog.analyzers.projections.intervals import is_success
from hrclog.analyzers.projections.lints.record import Record
from hrclog.analyzers.projections.lints.told import length
from hrclog.diagnostic import Diagnostic
from hrclog.events import Outcome

_ENOUGH: Final = 8
_FAR: Final = 8.0
"""Times the median; the authors' real runs hold executions of 6.4 times their task's, which a robot stood still in."""

_MOST_DEVIATIONS: Final = 5.0
_PER_DEVIATION: Final = 1.4826  # standard deviation over median absolute deviation of a normal distribution


def long_executions(record: Record) -> Iterator[Diagnostic]:
    """Find ended executions that are beyond their task's median by a factor, and by its spread on the log scale.

    The median and the spread are those of the task's successes; executions that were timed out or canceled are not
    questioned.
    """
    key, log_s = ("agent", "task"), pl.col("log_s")
    seconds = (pl.col("end_ns") - pl.col("start_ns")) / 1e9
    ended = record.intervals.filter(pl.col("end_ns") > pl.col("start_ns")).with_columns(seconds.alias("seconds"))
    ended = ended.with_columns(pl.col("seconds").log().alias("log_s"))
    usual = (
        ended.filter(is_success())
        .group_by(key)
        .agg(
            pl.len().alias("n"),
            log_s.median().alias("median"),
            (log_s - log_s.median()).abs().median().alias("deviation"),
        )
        .filter(pl.col("n") >= _ENOUGH)
    )
    beyond = pl.col("log_s") - pl.col("median")
    excused = (Outcome.TIMED_OUT.value, Outcome.CANCELED.value, Outcome.SKIPPED.value)
    far = (
        ended.filter(~pl.col("outcome").is_in(excused))
        .join(usual, on=key)
        .filter((beyond > log(_FAR)) & (beyond > _MOST_DEVIATIONS * _PER_DEVIATION * pl.col("deviation")))
        .sort("path", "run_id", "start_ns", "execution_id")
        .select(
            *key, "execution_id", "seconds", pl.col("median").exp(), beyond.exp().alias("times"), "n", "path", "run_id"
        )
    )
    for agent, task, execution, duration, median, times, n, path, run in far.iter_rows():
        text = (
            f"{agent!r}, {task!r} (execution {execution}) of run {record.names[run]!r} took {length(duration)}, "
            f"{times:,.3g} times the median of its {n} successes, {length(median)}"
        )
        yield Diagnostic("long_execution", text, path, run)
