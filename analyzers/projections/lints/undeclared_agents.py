"""Agents that their run does not name."""

from __future__ import annotations

from collections.abc import Iterator
from difflib import get_close_matches

import polars as pl

from hrclog.analyzers.projections.lints.record import Record
from hrclog.analyzers.projections.lints.similar_names import visible
from hrclog.analyzers.projections.lints.told import listed
from hrclog.diagnostic import Diagnostic
from hrclog.events import TASK_KINDS
from hrclog.wording import counted


def undeclared_agents(record: Record) -> Iterator[Diagnostic]:
    """Find agents with executions in a run whose start names agents, and not them."""
    declared = {run: start.agents for run, start in record.starts.items() if start.agents}
    facts = record.events.filter(pl.col("kind").is_in(TASK_KINDS) & (pl.col("agent") != ""))
    for run, agent in facts.select("run_id", "agent").unique().sort("run_id", "agent").iter_rows():
        if agent in declared.get(run, (agent,)):
            continue
        rows = facts.filter((pl.col("run_id") == run) & (pl.col("agent") == agent)).sort("time_ns", "seq")
        executions = rows.unique("execution_id", keep="first", maintain_order=True)
        named = [
            f"{task!r} (execution {execution})"
            for task, execution in executions.select("task", "execution_id").iter_rows()
        ]
        close = [f"; is it {visible(name)}?" for name in get_close_matches(agent, declared[run], 1)]
        text = (
            f"agent {visible(agent)} has {counted(executions.height, 'execution')} in run {record.names[run]!r}, which "
            f"names {', '.join(map(visible, declared[run]))} only: {listed(named)}{''.join(close)}"
        )
        yield Diagnostic("undeclared_agent", text, rows["path"][0], run, rows["seq"][0])
