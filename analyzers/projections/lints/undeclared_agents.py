"""Agents that their run does not name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from typing import Final

import polars as pl

from hrclog.analyzers.projections.lints.record import Record
from hrclog.analyzers.projections.lints.similar_names import visible
from hrclog.analyzers.projections.lints.told import listed
from hrclog.diagnostic import Diagnostic
from hrclog.events import TASK_KINDS
from hrclog.wording import counted

_MOST_NAMED: Final = 8
_MOST_COMPARED: Final = 50  # comparing takes its time, and a cell has a few agents


def undeclared_agents(record: Record) -> Iterator[Diagnostic]:
    """Find agents with executions in a run whose start names agents, and not them."""
    declared = {run: start.agents for run, start in record.starts.items() if start.agents}
    facts = record.events.filter(pl.col("kind").is_in(TASK_KINDS) & (pl.col("agent") != ""))
    pairs = facts.select("run_id", "agent").unique()
    strange = [(run, agent) for run, agent in pairs.iter_rows() if agent not in declared.get(run, (agent,))]
    if not strange:
        return
    keys = pl.DataFrame(strange, schema=["run_id", "agent"], orient="row")
    of_strange = facts.join(keys, on=["run_id", "agent"]).sort("run_id", "agent", "time_ns", "seq")
    for rows in of_strange.partition_by("run_id", "agent", maintain_order=True):
        yield _diagnostic(record, rows, declared[rows["run_id"][0]])


def _diagnostic(record: Record, rows: pl.DataFrame, declared: Sequence[str]) -> Diagnostic:
    run, agent = rows["run_id"][0], rows["agent"][0]
    executions = rows.unique("execution_id", keep="first", maintain_order=True).select("task", "execution_id")
    named = [f"{task!r} (execution {execution})" for task, execution in executions.iter_rows()]
    close = "".join(f"; is it {visible(name)}?" for name in get_close_matches(agent, declared[:_MOST_COMPARED], 1))
    text = (
        f"agent {visible(agent)} has {counted(executions.height, 'execution')} in run {record.names[run]!r}, which "
        f"names {listed([*map(visible, declared)], _MOST_NAMED)} only: {listed(named)}{close}"
    )
    return Diagnostic("undeclared_agent", text, rows["path"][0], run, rows["seq"][0])
