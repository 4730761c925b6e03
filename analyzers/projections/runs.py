"""One row per run: its name, agents, span and what came of it."""

from __future__ import annotations

from typing import Final

import polars as pl

from hrclog.analyzers.projections.intervals import top_level
from hrclog.analyzers.projections.schemas import RUNS
from hrclog.analyzers.projections.tags import with_tags
from hrclog.events import UNKNOWN_OUTCOME, Outcome
from hrclog.log.runs.facts import run_facts
from hrclog.log.runs.tags import run_tags

_FAILED: Final = (Outcome.FAILED.value, Outcome.TIMED_OUT.value)


def runs(events: pl.DataFrame, intervals: pl.DataFrame) -> pl.DataFrame:
    """Return a frame of schema `RUNS`, one row per run that has events, ordered by (start_ns, run_id).

    A run without a name takes its file's. Tags of the runs are further columns.

    Args:
        events: an events frame.
        intervals: the executions in it.
    """
    spans = (
        intervals.filter(top_level())
        .group_by("run_id")
        .agg(
            pl.col("agent").unique().sort().alias("seen"),
            pl.col("start_ns").min(),
            pl.col("until_ns").max().alias("end_ns"),
            pl.len().alias("n_executions"),
            pl.col("outcome").is_in(_FAILED).sum().alias("n_failed"),
            ((pl.col("outcome") == UNKNOWN_OUTCOME) & pl.col("end_ns").is_null()).sum().alias("n_open"),
        )
    )
    files = events.sort("run_id", "seq").group_by("run_id").agg(pl.col("path").first())
    rows = (
        files.join(_facts(events), on="run_id", how="left")
        .join(_outcomes(events), on="run_id", how="left")
        .join(spans, on="run_id", how="left")
        .with_columns(
            pl.col("n_executions", "n_failed", "n_open").fill_null(0),
            pl.col("outcome").fill_null(""),
            ((pl.col("end_ns") - pl.col("start_ns")) / 1e9).alias("makespan_s"),
            pl.col("agents").list.set_union(pl.col("seen").fill_null([])).list.sort(),
        )
    )
    table = rows.select(RUNS.names()).cast(RUNS).sort("start_ns", "run_id", nulls_last=True)
    return with_tags(table, run_tags(events))


def _facts(events: pl.DataFrame) -> pl.DataFrame:
    rows = [(run, facts.name, list(facts.agents)) for run, facts in run_facts(events).items()]
    schema = {name: RUNS[name] for name in ("run_id", "name", "agents")}
    return pl.DataFrame(rows, schema=schema, orient="row")


def _outcomes(events: pl.DataFrame) -> pl.DataFrame:
    ended = events.filter(pl.col("kind") == "run_ended").sort("run_id", "seq").unique("run_id", keep="last")
    return ended.select("run_id", "outcome")
