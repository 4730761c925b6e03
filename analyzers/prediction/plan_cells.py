"""The place of an execution in its plan: the same plan, run again, repeats itself closely."""

from __future__ import annotations

from typing import Final

import polars as pl

from hrclog.analyzers.projections.intervals import is_counted

_ITEM: Final = ("run_id", "agent", "item")


def plan_cells(intervals: pl.DataFrame) -> pl.DataFrame:
    """Return the plan cell of each execution that counts.

    A plan is the order of each agent's tasks; it is taken as known before a run. Attempts at one item are one.

    Args:
        intervals: a frame of schema `INTERVALS`.

    Returns:
        Columns run_id, execution_id, position of its item among the agent's, and cell: a text that is equal for
        executions at the same place of the same plan.
    """
    item = pl.when(pl.col("item_id") != "").then(pl.concat_str(pl.lit("i"), "item_id"))
    rows = (
        intervals.filter(is_counted())
        .sort("run_id", "agent", "start_ns", "until_ns", "task", "execution_id")
        .with_columns(item.otherwise(pl.concat_str(pl.lit("x"), "execution_id")).alias("item"))
    )
    items = (
        rows.group_by(_ITEM, maintain_order=True)
        .agg(pl.col("task").first())
        .with_columns(pl.int_range(pl.len()).over("run_id", "agent").alias("position"))
    )
    # lengths keep "ab" + "c" and "a" + "bc" apart
    agent, task = (pl.concat_str(pl.col(name).str.len_bytes(), pl.lit(":"), name) for name in ("agent", "task"))
    plans = items.group_by("run_id", maintain_order=True).agg(pl.concat_str(agent, task).str.join("|").alias("plan"))
    cell = pl.concat_str("position", agent, "plan", separator="|")
    return (
        rows.select(*_ITEM, "execution_id")
        .join(items, on=_ITEM, maintain_order="left")
        .join(plans, on="run_id", maintain_order="left")
        .select("run_id", "execution_id", "position", cell.alias("cell"))
    )
