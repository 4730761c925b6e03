"""Lints: what a careful reader of the data would want to know, though nothing was lost."""

from __future__ import annotations

from typing import Final

import polars as pl

from hrclog.analyzers.intervals import counted
from hrclog.diagnostic import Diagnostic
from hrclog.events import UNKNOWN_OUTCOME, Outcome

_ENOUGH_TO_EXPECT_A_FAILURE: Final = 100


def lint(events: pl.DataFrame, intervals: pl.DataFrame, overlaps: pl.DataFrame, runs: pl.DataFrame) -> list[Diagnostic]:
    """Return the lints of a set of runs, ordered by kind and run."""
    return [
        *_open_executions(intervals),
        *_zero_durations(intervals),
        *_self_overlaps(overlaps, runs),
        *_single_outcome(intervals),
        *_one_agent(runs),
        *_not_ended(events, runs),
    ]


def _open_executions(intervals: pl.DataFrame) -> list[Diagnostic]:
    rows = intervals.filter((pl.col("outcome") == UNKNOWN_OUTCOME) & pl.col("end_ns").is_null())
    return [
        Diagnostic(
            "open_execution", f"{agent!r}, {task!r} started at {start} ns and never ended; it is censored", path, run
        )
        for agent, task, start, path, run in rows.select("agent", "task", "start_ns", "path", "run_id").iter_rows()
    ]


def _zero_durations(intervals: pl.DataFrame) -> list[Diagnostic]:
    rows = (
        intervals.filter(pl.col("end_ns") == pl.col("start_ns"))
        .group_by("path", "run_id", "agent", "task")
        .len()
        .sort("path", "run_id", "agent", "task")
    )
    return [
        Diagnostic(
            "zero_duration", f"{count} executions of {agent!r}, {task!r} ended in the instant of their start", path, run
        )
        for path, run, agent, task, count in rows.iter_rows()
    ]


def _self_overlaps(overlaps: pl.DataFrame, runs: pl.DataFrame) -> list[Diagnostic]:
    rows = (
        overlaps.filter(pl.col("agent") == pl.col("other_agent"))
        .group_by("run_id", "agent")
        .agg((pl.col("overlap_ns").sum() / 2e9).alias("seconds"))
        .join(runs.select("run_id", "path"), on="run_id")
        .sort("path", "run_id", "agent")
    )
    return [
        Diagnostic("self_overlap", f"{agent!r} overlaps itself for {seconds:.3f} s", path, run)
        for run, agent, seconds, path in rows.iter_rows()
    ]


def _single_outcome(intervals: pl.DataFrame) -> list[Diagnostic]:
    rows = intervals.filter(counted())
    if rows.height < _ENOUGH_TO_EXPECT_A_FAILURE or (rows["outcome"] != Outcome.SUCCEEDED.value).any():
        return []
    text = f"all {rows.height} executions succeeded: failures may have been removed before we saw them"
    return [Diagnostic("single_outcome", text)]


def _one_agent(runs: pl.DataFrame) -> list[Diagnostic]:
    agents = runs["agents"].explode(empty_as_null=False).unique().sort().to_list()
    if len(agents) != 1:
        return []
    return [Diagnostic("one_agent", f"{agents[0]!r} is the only agent: there are no synergies to estimate")]


def _not_ended(events: pl.DataFrame, runs: pl.DataFrame) -> list[Diagnostic]:
    ended = events.filter(pl.col("kind") == "run_ended")["run_id"].unique()
    rows = runs.filter(~pl.col("run_id").is_in(ended.implode()))
    return [
        Diagnostic("run_not_ended", f"run {name!r} has no run_ended event", path, run)
        for name, path, run in rows.select("name", "path", "run_id").iter_rows()
    ]
