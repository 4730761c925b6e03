"""How long other agents were busy while an execution went on, for all runs at once."""

from __future__ import annotations

from typing import Final

import polars as pl

from hrclog.analyzers.projections.intervals import top_level

ROW: Final = "row"
"""Column of the number of an execution."""

_LANE: Final = ("run_id", "agent")


def beside(executions: pl.DataFrame, intervals: pl.DataFrame, lanes: pl.DataFrame) -> pl.DataFrame:
    """Return for each execution and each other agent of its run how long that agent had an execution too.

    Executions of an agent that overlap each other count once.

    Args:
        executions: columns run_id, agent, start_ns and until_ns.
        intervals: all executions of these runs; steps of sequences are no executions of their own.
        lanes: run_id and agent, a row per agent of a run.

    Returns:
        `ROW` of the execution, the other agent as `agent`, and `beside_ns`.
    """
    rows = executions.select("run_id", "start_ns", "until_ns", own="agent").with_row_index(ROW)
    pairs = rows.join(lanes, on="run_id").filter(pl.col("agent") != pl.col("own")).with_row_index("pair")
    blocks = _blocks(intervals)
    lasting = _busy_until(pairs, blocks, "until_ns") - _busy_until(pairs, blocks, "start_ns")
    return pairs.select(ROW, "agent", lasting.alias("beside_ns"))


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


def _busy_until(pairs: pl.DataFrame, blocks: pl.DataFrame, instant: str) -> pl.Series:
    """Return how many ns of the other agent's blocks lie before an instant of each pair, in the order of the pairs."""
    met = pairs.select("pair", *_LANE, instant).sort(instant).join_asof(
        blocks, left_on=instant, right_on="open_ns", by=_LANE, strategy="backward", check_sortedness=False
    )  # fmt: skip
    inside = pl.min_horizontal(pl.col(instant) - pl.col("open_ns"), "length_ns")
    return met.sort("pair").select((pl.col("before_ns") + inside).fill_null(0)).to_series()
