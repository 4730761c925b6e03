"""Executions that two runs claim."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

import polars as pl

from hrclog.analyzers.projections.lints.record import Record
from hrclog.analyzers.projections.lints.told import listed
from hrclog.diagnostic import Diagnostic
from hrclog.wording import agree, counted


def shared_ids(record: Record) -> Iterator[Diagnostic]:
    """Find execution ids that are in several runs, one diagnostic per set of runs that share some."""
    if record.intervals["execution_id"].n_unique() == record.intervals.height:
        return
    rows = (
        record.intervals.group_by("execution_id")
        .agg(
            pl.col("run_id").unique().sort(), pl.col("agent").first(), pl.col("task").first(), pl.col("start_ns").min()
        )
        .filter(pl.col("run_id").list.len() > 1)
        .sort("start_ns", "execution_id")
    )
    shared: dict[tuple[str, ...], list[str]] = defaultdict(list)
    for execution, runs, agent, task, _ in rows.iter_rows():
        shared[tuple(runs)].append(f"{execution} ({agent!r}, {task!r})")
    for runs, executions in shared.items():
        names = listed([f"{record.names[run]!r} ({record.paths[run]})" for run in runs])
        text = (
            f"{counted(len(executions), 'execution id')} {agree(len(executions), 'is', 'are')} in {len(runs):,} runs, "
            f"{names}: {listed(executions)}"
        )
        yield Diagnostic("shared_execution_id", text, record.paths[runs[0]], runs[0])
