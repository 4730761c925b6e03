"""Planned instants that cannot both be meant: an end before its start."""

from __future__ import annotations

from typing import Final

import polars as pl

from hrclog.analyzers.projections.lints.told import listed
from hrclog.diagnostic import Diagnostic
from hrclog.wording import counted

_PLANNED: Final = ("planned_start_ns", "planned_end_ns")


def without_turned_plans(executions: pl.DataFrame) -> tuple[pl.DataFrame, list[Diagnostic]]:
    """Unset planned instants of executions whose planned end is before their planned start.

    Args:
        executions: with the columns of `INTERVALS`.

    Returns:
        The executions, and a diagnostic per file and run.
    """
    is_turned = (executions["planned_end_ns"] < executions["planned_start_ns"]).fill_null(value=False)
    if not is_turned.any():
        return executions, []
    by_s = (pl.col("planned_start_ns") - pl.col("planned_end_ns")) / 1e9
    turned = executions.filter(is_turned).with_columns(by_s.alias("by_s")).sort("path", "run_id", "start_ns")
    unset = [pl.when(~is_turned).then(pl.col(name)).alias(name) for name in _PLANNED]
    groups = turned.group_by("path", "run_id", maintain_order=True)
    return executions.with_columns(unset), [
        Diagnostic("planned_backwards", _text(rows), str(path), str(run)) for (path, run), rows in groups
    ]


def _text(rows: pl.DataFrame) -> str:
    named = [
        f"{agent!r}, {task!r} (execution {execution}) by {by_s:.3f} s"
        for agent, task, execution, by_s in rows.select("agent", "task", "execution_id", "by_s").iter_rows()
    ]
    return (
        f"{counted(rows.height, 'execution is', 'executions are')} planned to end before the planned start, "
        f"{listed(named)}: planned start and end count as unset"
    )
