"""Instants in another unit than ns, or from a clock that was never set."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import polars as pl

from hrclog.analyzers.projections.lints.record import Record
from hrclog.analyzers.projections.lints.told import utc
from hrclog.diagnostic import Diagnostic

_YEAR_2000_NS: Final = 946_684_800 * 10**9
_WEEK_NS: Final = 7 * 24 * 3600 * 10**9


def implausible_times(record: Record) -> Iterator[Diagnostic]:
    """Find runs that begin before 2000 or last longer than a week."""
    spans = record.happened.group_by("run_id").agg(
        pl.col("path").sort().first(), pl.col("time_ns").min().alias("first"), pl.col("time_ns").max().alias("last")
    )
    strange = spans.filter((pl.col("first") < _YEAR_2000_NS) | (pl.col("last") - pl.col("first") > _WEEK_NS))
    for run, path, first, last in strange.sort("path", "run_id").iter_rows():
        text = f"the run lasts from {utc(first)} to {utc(last)}: are its instants nanoseconds since 1970?"
        yield Diagnostic("implausible_time", text, path, run)
