"""Events before the start of their run, or after its end."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import polars as pl

from hrclog.analyzers.projections.lints.record import Record
from hrclog.analyzers.projections.lints.told import length, listed
from hrclog.diagnostic import Diagnostic
from hrclog.events import RunEnded, RunStarted
from hrclog.wording import agree, counted

_TOLERANCE_NS: Final = 10**8
"""Clocks of agents differ by less from each other when they are well."""

_TIME: Final = pl.col("time_ns")


def outside_run(record: Record) -> Iterator[Diagnostic]:
    """Find runs with events before their first `run_started`, or after a `run_ended` that nothing resumed."""
    kind = pl.col("kind")
    spans = record.happened.group_by("run_id").agg(
        _TIME.min().alias("first"),
        _TIME.max().alias("last"),
        _TIME.filter(kind == RunStarted.kind).min().alias("started"),
        _TIME.filter(kind == RunStarted.kind).max().alias("resumed"),
        _TIME.filter(kind == RunEnded.kind).max().alias("ended"),
    )
    early = spans.filter(pl.col("first") < pl.col("started") - _TOLERANCE_NS)
    is_over = pl.col("resumed").is_null() | (pl.col("resumed") <= pl.col("ended"))
    late = spans.filter(is_over & (pl.col("last") > pl.col("ended") + _TOLERANCE_NS))
    yield from _diagnostics(record, "before_run_start", early, pl.col("started") > _TIME)
    yield from _diagnostics(record, "after_run_end", late, pl.col("ended") < _TIME)


def _diagnostics(record: Record, code: str, spans: pl.DataFrame, is_outside: pl.Expr) -> Iterator[Diagnostic]:
    if spans.is_empty():
        return
    side, edge = ("before", "started") if code == "before_run_start" else ("after", "ended")
    rows = record.happened.join(spans, on="run_id").filter(is_outside).sort("run_id", "time_ns", "seq")
    for part in rows.partition_by("run_id", maintain_order=True):
        by = (part["time_ns"] - part[edge]).abs()
        executions = part.filter(pl.col("execution_id") != "").unique("execution_id", keep="first", maintain_order=True)
        named = executions if executions.height else part.head(1)
        texts = [_event(row, abs(row["time_ns"] - row[edge]), side) for row in named.iter_rows(named=True)]
        run, n = part["run_id"][0], part.height
        text = (
            f"{counted(n, 'event')} of run {record.names[run]!r} {agree(n, 'is', 'are')} {side} its run_{edge}, by "
            f"up to {length(max(by) / 1e9)}: {listed(texts)}"
        )
        yield Diagnostic(code, text, part["path"][0], run, part["seq"][0])


def _event(row: dict[str, Any], by_ns: int, side: str) -> str:
    by = length(by_ns / 1e9)
    if row["execution_id"]:
        return f"{row['kind']} of {row['agent']!r}, {row['task']!r} (execution {row['execution_id']}) {by} {side}"
    return f"{row['kind']}{' of ' + repr(row['agent']) if row['agent'] else ''} {by} {side}"
