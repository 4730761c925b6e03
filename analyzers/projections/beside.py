"""How long other agents were busy while an execution went on, for all runs at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import polars as pl

from hrclog.analyzers.projections.intervals import top_level

_LANE: Final = ("run_id", "agent")
_ROW: Final = "row"


def beside(executions: pl.DataFrame, intervals: pl.DataFrame, agents: Sequence[str]) -> list[pl.Series]:
    """Return per agent the ns within each execution during which that agent had an execution too.

    Executions of an agent that overlap each other count once.

    Args:
        executions: columns run_id, start_ns and until_ns.
        intervals: all executions of these runs; steps of sequences are no executions of their own.
        agents: whose executions are looked at.
    """
    rows = executions.select("run_id", "start_ns", "until_ns").with_row_index(_ROW)
    blocks = _blocks(intervals).partition_by("agent", as_dict=True)
    return [
        _within(rows, blocks[agent,]) if (agent,) in blocks else pl.zeros(rows.height, pl.Int64, eager=True)
        for agent in agents
    ]


def _blocks(intervals: pl.DataFrame) -> pl.DataFrame:
    """Return when each agent was busy, as disjoint blocks in order of time, with the ns before each."""
    rows = intervals.filter(top_level(), pl.col("until_ns") > pl.col("start_ns")).sort(*_LANE, "start_ns", "until_ns")
    reach = pl.col("until_ns").cum_max().shift(1).over(_LANE)
    opens = reach.is_null() | (pl.col("start_ns") > reach)
    blocks = (
        rows.with_columns(opens.cum_sum().over(_LANE).alias("block"))
        .group_by(*_LANE, "block", maintain_order=True)
        .agg(pl.col("start_ns").min().alias("open_ns"), pl.col("until_ns").max().alias("close_ns"))
        .with_columns((pl.col("close_ns") - pl.col("open_ns")).alias("length_ns"))
    )
    before = pl.col("length_ns").cum_sum().over(_LANE) - pl.col("length_ns")
    return blocks.select(*_LANE, "open_ns", "length_ns", before.alias("before_ns")).sort("open_ns")


def _within(rows: pl.DataFrame, blocks: pl.DataFrame) -> pl.Series:
    lasting = _busy_until(rows, blocks, "until_ns") - _busy_until(rows, blocks, "start_ns")
    return lasting.rename("beside_ns")


def _busy_until(rows: pl.DataFrame, blocks: pl.DataFrame, instant: str) -> pl.Series:
    """Return how many ns of blocks lie before an instant of each row, in the order of the rows."""
    met = rows.select(_ROW, "run_id", instant).sort(instant).join_asof(
        blocks, left_on=instant, right_on="open_ns", by="run_id", strategy="backward", check_sortedness=False
    )  # fmt: skip
    inside = pl.min_horizontal(pl.col(instant) - pl.col("open_ns"), "length_ns")
    return met.sort(_ROW).select((pl.col("before_ns") + inside).fill_null(0)).to_series()
