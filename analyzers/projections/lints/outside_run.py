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

_EDGES: Final = (RunStarted.kind, RunEnded.kind)


def outside_run(record: Record) -> Iterator[Diagnostic]:
    """Find runs with events before their first `run_started`, or after a `run_ended` that nothing resumed."""
    time, kind = pl.col("time_ns"), pl.col("kind")
    spans = record.happened.group_by("run_id").agg(
        time.min().alias("first"),
        time.max().alias("last"),
        time.filter(kind == RunStarted.kind).min().alias("started"),
        time.filter(kind == RunStarted.kind).max().alias("resumed"),
        time.filter(kind == RunEnded.kind).max().alias("ended"),
    )
    early = spans.filter(pl.col("first") < pl.col("started") - _TOLERANCE_NS)
    is_over = pl.col("resumed").is_null() | (pl.col("resumed") <= pl.col("ended"))
    late = spans.filter(is_over & (pl.col("last") > pl.col("ended") + _TOLERANCE_NS))
    for run, started in early.sort("run_id").select("run_id", "started").iter_rows():
        yield _diagnostic(record, "before_run_start", run, (time < started) & ~kind.is_in(_EDGES), started)
    for run, ended in late.sort("run_id").select("run_id", "ended").iter_rows():
        yield _diagnostic(record, "after_run_end", run, (time > ended) & ~kind.is_in(_EDGES), ended)


def _diagnostic(record: Record, code: str, run: str, is_outside: pl.Expr, edge_ns: int) -> Diagnostic:
    rows = record.happened.filter((pl.col("run_id") == run) & is_outside).sort("time_ns", "seq")
    side, edge = ("before", RunStarted.kind) if code == "before_run_start" else ("after", RunEnded.kind)
    farthest = max(abs(time - edge_ns) for time in rows["time_ns"])
    executions = rows.filter(pl.col("execution_id") != "").unique("execution_id", keep="first", maintain_order=True)
    named = executions if executions.height else rows.head(1)
    texts = [_event(row, edge_ns, side) for row in named.iter_rows(named=True)]
    text = (
        f"{counted(rows.height, 'event')} of run {record.names[run]!r} {agree(rows.height, 'is', 'are')} {side} "
        f"its {edge}, by up to {length(farthest / 1e9)}: {listed(texts)}"
    )
    return Diagnostic(code, text, rows["path"][0], run, rows["seq"][0])


def _event(row: dict[str, Any], edge_ns: int, side: str) -> str:
    by = length(abs(row["time_ns"] - edge_ns) / 1e9)
    if row["execution_id"]:
        return f"{row['kind']} of {row['agent']!r}, {row['task']!r} (execution {row['execution_id']}) {by} {side}"
    return f"{row['kind']}{' of ' + repr(row['agent']) if row['agent'] else ''} {by} {side}"
