"""Durations in another unit than seconds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import log10
from typing import Final

import polars as pl

from hrclog.analyzers.projections.lints.record import Record
from hrclog.analyzers.projections.lints.told import length
from hrclog.diagnostic import Diagnostic
from hrclog.wording import counted

_ENOUGH: Final = 3
_SHORTEST_S: Final = 0.01
_LONGEST_S: Final = 6 * 3600
"""What people and robots do together takes between these, in the middle."""

_SCALES: Final = 300.0
"""Units are 1,000 times each other; nothing else makes the executions of an agent that much longer or shorter."""


@dataclass(frozen=True, slots=True)
class _Durations:
    """Of an agent in a run: how many, their median, and the medians of two ratios."""

    path: str
    run_id: str
    agent: str
    n: int
    median_s: float
    of_planned: float | None
    n_planned: int
    of_others: float | None


def wrong_units(record: Record) -> Iterator[Diagnostic]:
    """Find agents whose durations in a run are of another size than work, than planned, or than in other runs."""
    for durations in _durations(record.intervals):
        if doubt := _doubt(durations):
            agent, run = repr(durations.agent), repr(record.names[durations.run_id])
            count = counted(durations.n, "execution")
            text = f"the {count} of {agent} in run {run} {doubt}: are its times in another unit?"
            yield Diagnostic("wrong_unit", text, durations.path, durations.run_id)


def _durations(intervals: pl.DataFrame) -> Iterator[_Durations]:
    key = ("path", "run_id", "agent")
    seconds, planned = pl.col("seconds"), pl.col("planned_s")
    planned_s = pl.coalesce("planned_duration_s", (pl.col("planned_end_ns") - pl.col("planned_start_ns")) / 1e9)
    rows = intervals.filter(pl.col("end_ns") > pl.col("start_ns")).select(
        *key,
        "task",
        ((pl.col("end_ns") - pl.col("start_ns")) / 1e9).alias("seconds"),
        pl.when(planned_s > 0).then(planned_s).alias("planned_s"),
    )
    usual = seconds.median().over("agent", "task")
    groups = (
        rows.with_columns((seconds / usual).alias("of_others"))
        .group_by("run_id", "agent")
        .agg(
            pl.col("path").first(),
            pl.len().alias("n"),
            seconds.median().alias("median_s"),
            (seconds / planned).median().alias("of_planned"),
            planned.count().alias("n_planned"),
            pl.col("of_others").median(),
        )
        .filter(pl.col("n") >= _ENOUGH)
        .sort(key)
    )
    for row in groups.select(list(_Durations.__dataclass_fields__)).iter_rows():
        yield _Durations(*row)


def _doubt(durations: _Durations) -> str:
    median = length(durations.median_s)
    if not _SHORTEST_S <= durations.median_s <= _LONGEST_S:
        return f"take {median} (median)"
    if durations.of_planned and durations.n_planned >= _ENOUGH and _is_scaled(durations.of_planned):
        return f"take {median} (median), {_times(durations.of_planned)} what was planned"
    if durations.of_others and _is_scaled(durations.of_others):
        return f"take {median} (median), {_times(durations.of_others)} what the same tasks take in other runs"
    return ""


def _is_scaled(ratio: float) -> bool:
    return abs(log10(ratio)) >= log10(_SCALES)


def _times(ratio: float) -> str:
    return f"{ratio:,.3g} times" if ratio >= 1 else f"1/{1 / ratio:,.4g} of"
