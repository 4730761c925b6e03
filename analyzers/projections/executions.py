"""The long table for statistics: one row per execution, with what its run was and what went on beside it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import polars as pl

from hrclog.analyzers.projections.beside import ROW, beside
from hrclog.analyzers.projections.intervals import top_level
from hrclog.analyzers.projections.schemas import EXECUTIONS
from hrclog.analyzers.projections.tags import tag_columns

MOST_CELLS: Final = 20_000_000
"""Of seconds beside others: where there are more, as of thousands of agents, the table has none of them."""

_INSTANTS: Final = ("start", "until", "planned_start", "planned_end")
_RUN_COLUMNS: Final = ("run", "run_id")


def executions(intervals: pl.DataFrame, runs: pl.DataFrame, tags: Mapping[str, Mapping[str, str]]) -> pl.DataFrame:
    """Return one row per execution that is no step of another, in the order of the runs and of time.

    The columns are those of `EXECUTIONS`. Behind `run_id` stands a column per tag of the runs, at the end a column
    `beside_<agent>_s` per agent: how long that agent had an execution too. It is null for the agent's own executions,
    and in runs without that agent.

    Args:
        intervals: a frame of schema `INTERVALS`.
        runs: a frame of schema `RUNS`.
        tags: of runs by their ids.
    """
    run_facts = runs.select("run_id", run="name", run_agents="agents", run_start_ns="start_ns").with_row_index("order")
    rows = (
        intervals.filter(top_level())
        .join(run_facts, on="run_id")
        .sort("order", "start_ns", "until_ns", "agent", "task", "execution_id")
    )
    since_start = {name: rows[f"{name}_ns"] - rows["run_start_ns"] for name in _INSTANTS}
    lengths = {"duration": rows["end_ns"] - rows["start_ns"], "paused": rows["paused_ns"]}
    seconds = [_seconds(ns).rename(f"{name}_s") for name, ns in (since_start | lengths).items()]
    table = rows.with_columns(seconds).select(EXECUTIONS.names()).cast(EXECUTIONS)
    return _with_tags(table.with_columns(_beside_columns(rows, intervals, runs)), tags)


def _seconds(ns: pl.Series) -> pl.Series:
    # divided by numpy: polars multiplies by 1e-9, which shows as 4.550874000000001
    seconds = pl.Series(ns.fill_null(0).to_numpy() / 1e9)
    return pl.select(pl.when(ns.is_not_null()).then(seconds)).to_series()


def _beside_columns(rows: pl.DataFrame, intervals: pl.DataFrame, runs: pl.DataFrame) -> list[pl.Series]:
    lanes = runs.select("run_id", agent="agents").explode("agent").filter(pl.col("agent") != "").unique()
    agents = lanes["agent"].unique().sort().to_list()
    if rows.height * len(agents) > MOST_CELLS:
        return []
    pairs = beside(rows, intervals, lanes)
    seconds = pairs.select(ROW, "agent", _seconds(pairs["beside_ns"]).alias("seconds"))
    of_agent = seconds.partition_by("agent", as_dict=True, include_key=False)
    nothing = pl.Series([None], dtype=pl.Float64).new_from_index(0, rows.height)
    return [_placed(of_agent.get((agent,)), nothing).alias(f"beside_{agent}_s") for agent in agents]


def _placed(seconds: pl.DataFrame | None, nothing: pl.Series) -> pl.Series:
    """Return the seconds at the rows that have some."""
    return nothing if seconds is None else nothing.clone().scatter(seconds[ROW], seconds["seconds"])


def _with_tags(table: pl.DataFrame, tags: Mapping[str, Mapping[str, str]]) -> pl.DataFrame:
    """Return a table with a column per tag behind the columns of the run, "" where a run has none of that key."""
    of_table = {run_id: tags[run_id] for run_id in table["run_id"].unique(maintain_order=True) if run_id in tags}
    names = tag_columns(table, of_table)
    if not names:
        return table
    texts = {name: [of_run.get(key, "") for of_run in of_table.values()] for key, name in names.items()}
    columns = pl.DataFrame({"run_id": list(of_table), **texts}, dict.fromkeys(("run_id", *names.values()), pl.String))
    joined = table.join(columns, on="run_id", how="left", maintain_order="left")
    filled = joined.with_columns(pl.col(list(names.values())).fill_null(""))
    rest = [name for name in table.columns if name not in _RUN_COLUMNS]
    return filled.select(*_RUN_COLUMNS, *names.values(), *rest)
