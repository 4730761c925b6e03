"""Agents that a safety function watches, and that do nothing."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import polars as pl

from hrclog.analyzers.projections.lints.record import Record
from hrclog.analyzers.projections.lints.run_start import RunStart
from hrclog.analyzers.projections.lints.similar_names import visible
from hrclog.analyzers.projections.lints.told import listed
from hrclog.diagnostic import Diagnostic
from hrclog.events import SafetyStateChanged
from hrclog.wording import counted

_KEY: Final = ("run_id", "agent")


def _has_nothing_to_do(start: RunStart, agent: str) -> bool:
    return bool(start.plan) and agent not in {item.agent for item in start.plan}


def idle_agents(record: Record) -> Iterator[Diagnostic]:
    """Find agents with safety events and no execution in a run, but for those that its plan gives nothing to do."""
    events = record.events.filter((pl.col("kind") == SafetyStateChanged.kind) & (pl.col("agent") != ""))
    if events.is_empty():
        return
    working = record.intervals.select(*_KEY).unique()
    rows = (
        events.group_by(_KEY)
        .agg(pl.len(), pl.col("path").first(), pl.col("seq").min())
        .join(working, on=_KEY, how="anti")
        .sort("path", *_KEY)
    )
    at_work = set(working["agent"])
    agents_of = dict(working.sort(_KEY).group_by("run_id").agg("agent").iter_rows()) if rows.height else {}
    for run, agent, count, path, seq in rows.iter_rows():
        start = record.starts.get(run)
        if start and _has_nothing_to_do(start, agent) and (agent in at_work or agent in start.agents):
            continue
        busy = agents_of.get(run, [])
        others = f" (those with executions: {listed([*map(visible, busy)])}); is it one of them?" if busy else ""
        text = (
            f"agent {visible(agent)} of run {record.names[run]!r} has {counted(count, 'safety event')} and no execution"
        )
        yield Diagnostic("idle_agent", text + others, path, run, seq)
