"""Lints: what a careful reader of the data would want to know, though nothing was lost."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Final

import polars as pl

from hrclog import wording
from hrclog.analyzers.projections.clock_step import turned_ends
from hrclog.analyzers.projections.crowded import crowded_runs
from hrclog.analyzers.projections.intervals import is_counted
from hrclog.analyzers.projections.overlaps import MOST_PAIRS, pair_count, task_counts
from hrclog.analyzers.projections.similar_names import similar_names
from hrclog.diagnostic import Diagnostic
from hrclog.events import UNKNOWN_OUTCOME, Outcome

_YEAR_2000_NS: Final = 946_684_800 * 10**9
_WEEK_NS: Final = 7 * 24 * 3600 * 10**9
_ENOUGH_TO_EXPECT_A_FAILURE: Final = 100


def lint(events: pl.DataFrame, intervals: pl.DataFrame, overlaps: pl.DataFrame, runs: pl.DataFrame) -> list[Diagnostic]:
    """Return the lints of a set of runs, ordered by kind and run."""
    return [
        *_open_executions(events, intervals),
        *_zero_durations(intervals),
        *_implausible_times(events),
        *_self_overlaps(overlaps, runs),
        *similar_names(intervals, _all_agents(events, runs)),
        *_single_outcome(intervals),
        *_one_agent(runs),
        *_unlisted_pairs(intervals),
        *_crowded(intervals, runs),
        *_not_ended(events, runs),
    ]


def _all_agents(events: pl.DataFrame, runs: pl.DataFrame) -> set[str]:
    """Return the agents of all events, and those that runs declare."""
    return {*events["agent"].unique(), *runs["agents"].explode().drop_nulls()} - {""}


def _open_executions(events: pl.DataFrame, intervals: pl.DataFrame) -> list[Diagnostic]:
    rows = intervals.filter((pl.col("outcome") == UNKNOWN_OUTCOME) & pl.col("end_ns").is_null())
    if rows.height:
        rows = rows.join(turned_ends(events, rows), on=("run_id", "execution_id"), how="anti", maintain_order="left")
    return [
        Diagnostic(
            "open_execution", f"{agent!r}, {task!r} started at {_utc(start)} and never ended; it is censored", path, run
        )
        for agent, task, start, path, run in rows.select("agent", "task", "start_ns", "path", "run_id").iter_rows()
    ]


def impossible_factors(synergies: pl.DataFrame) -> list[Diagnostic]:
    """Find factors of 0 or less, which a linear fit can give and no duration can have."""
    return [
        Diagnostic(
            "impossible_factor",
            f"{estimator} gives a factor of {factor:.2f} for {agent!r}, {task!r} while {other!r}, {other_task!r} runs",
        )
        for agent, task, other, other_task, factor, estimator in synergies.filter(pl.col("synergy") <= 0)
        .select("agent", "task", "other_agent", "other_task", "synergy", "estimator")
        .iter_rows()
    ]


def _implausible_times(events: pl.DataFrame) -> list[Diagnostic]:
    """Find instants in another unit than ns, or from a clock that was never set."""
    spans = events.group_by("run_id").agg(
        pl.col("path").sort().first(), pl.col("time_ns").min().alias("first"), pl.col("time_ns").max().alias("last")
    )
    strange = spans.filter((pl.col("first") < _YEAR_2000_NS) | (pl.col("last") - pl.col("first") > _WEEK_NS))
    return [
        Diagnostic(
            "implausible_time",
            f"the run lasts from {_utc(first)} to {_utc(last)}: are its instants nanoseconds since 1970?",
            path,
            run,
        )
        for run, path, first, last in strange.sort("path", "run_id").iter_rows()
    ]


def _utc(time_ns: int) -> str:
    try:
        return datetime.fromtimestamp(time_ns / 1e9, UTC).strftime("%Y-%m-%d %H:%M:%S")
    except (OverflowError, ValueError, OSError):
        return f"{time_ns} ns"


def _zero_durations(intervals: pl.DataFrame) -> list[Diagnostic]:
    rows = (
        intervals.filter(pl.col("end_ns") == pl.col("start_ns"))
        .group_by("path", "run_id", "agent", "task")
        .len()
        .sort("path", "run_id", "agent", "task")
    )
    return [
        Diagnostic(
            "zero_duration",
            f"{wording.counted(count, 'execution')} of {agent!r}, {task!r} ended in the instant of "
            f"{wording.agree(count, 'its', 'their')} start",
            path,
            run,
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
    rows = intervals.filter(is_counted())
    if rows.height < _ENOUGH_TO_EXPECT_A_FAILURE or (rows["outcome"] != Outcome.SUCCEEDED.value).any():
        return []
    text = f"all {rows.height} executions succeeded: failures may have been removed before we saw them"
    return [Diagnostic("single_outcome", text)]


def _one_agent(runs: pl.DataFrame) -> list[Diagnostic]:
    agents = runs["agents"].explode(empty_as_null=False).unique().sort().to_list()
    if len(agents) != 1:
        return []
    return [Diagnostic("one_agent", f"{agents[0]!r} is the only agent: there are no synergies to estimate")]


def _unlisted_pairs(intervals: pl.DataFrame) -> list[Diagnostic]:
    count = pair_count(task_counts(intervals))
    if count <= MOST_PAIRS:
        return []
    text = f"of {count} ordered pairs of tasks only those that overlapped are listed: are serial numbers in task names?"
    return [Diagnostic("unlisted_pairs", text)]


def _crowded(intervals: pl.DataFrame, runs: pl.DataFrame) -> list[Diagnostic]:
    crowded = crowded_runs(intervals)
    return [
        Diagnostic(
            "overlaps_left_out",
            f"{crowded[run]}: its overlaps were left out, and it is in no estimate; do executions lack their ends, or "
            "is it several runs?",
            path,
            run,
        )
        for path, run in runs.select("path", "run_id").iter_rows()
        if run in crowded
    ]


def _not_ended(events: pl.DataFrame, runs: pl.DataFrame) -> list[Diagnostic]:
    ended = events.filter(pl.col("kind") == "run_ended")["run_id"].unique()
    rows = runs.filter(~pl.col("run_id").is_in(ended.implode()))
    return [
        Diagnostic("run_not_ended", f"run {name!r} has no run_ended event", path, run)
        for name, path, run in rows.select("name", "path", "run_id").iter_rows()
    ]
