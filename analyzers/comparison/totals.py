"""Totals per run of what is compared: `total` is the sum of a run's values, `weight` how many they are."""

from __future__ import annotations

from typing import Final

import polars as pl

from hrclog.analyzers.projections.intervals import has_learnt_role, is_success, top_level
from hrclog.analyzers.synergy.pairs import in_seconds
from hrclog.events import Outcome

_FAILED: Final = (Outcome.FAILED.value, Outcome.TIMED_OUT.value)


def metric_totals(metrics: pl.DataFrame) -> pl.DataFrame:
    """Return the metrics of each run, a frame of schema `METRICS`, as totals of one value."""
    return metrics.select("metric", "key", "run_id", pl.col("value").alias("total"), pl.lit(1.0).alias("weight"))


def duration_totals(intervals: pl.DataFrame) -> pl.DataFrame:
    """Return per (agent, task) and run the seconds of the executions that succeeded.

    Args:
        intervals: a frame of schema `INTERVALS`.
    """
    length = pl.col("end_ns") - pl.col("start_ns")
    return _seconds(_primary_intervals(intervals).filter(is_success()), ["agent", "task"], length)


def success_totals(intervals: pl.DataFrame) -> pl.DataFrame:
    """Return per (agent, task) and run the executions that succeeded, of those that succeeded or failed.

    Args:
        intervals: a frame of schema `INTERVALS`.
    """
    has_succeeded = pl.col("outcome") == Outcome.SUCCEEDED.value
    judged = _primary_intervals(intervals).filter(has_succeeded | pl.col("outcome").is_in(_FAILED))
    return _totals(judged, ["agent", "task"], has_succeeded.cast(pl.Int64))


def plan_totals(intervals: pl.DataFrame) -> pl.DataFrame:
    """Return per measure, agent and run how reality was later or longer than the plan, in seconds.

    Ends and durations are of executions that succeeded, and a planned duration is planned end - planned start. Of a
    run ("" as agent), the planned makespan is last planned end - first planned start.

    Args:
        intervals: a frame of schema `INTERVALS`.
    """
    started = intervals.filter(top_level())
    ended = started.filter(is_success())
    planned = pl.col("planned_end_ns") - pl.col("planned_start_ns")
    actual = pl.col("end_ns") - pl.col("start_ns")
    measures = (
        (started, "start_lateness_s", pl.col("start_ns") - pl.col("planned_start_ns")),
        (ended, "end_lateness_s", pl.col("end_ns") - pl.col("planned_end_ns")),
        (ended, "planned_duration_s", planned),
        (ended, "duration_overrun_s", actual - planned),
    )
    per_agent = [
        _seconds(rows.with_columns(pl.lit(name).alias("measure")), ["measure", "agent"], value)
        for rows, name, value in measures
    ]
    return pl.concat([*per_agent, *_makespans(started)])


def _makespans(started: pl.DataFrame) -> list[pl.DataFrame]:
    spans = (
        started.group_by("run_id")
        .agg(
            (pl.col("planned_end_ns").max() - pl.col("planned_start_ns").min()).alias("planned"),
            (pl.col("until_ns").max() - pl.col("start_ns").min()).alias("actual"),
        )
        .with_columns(pl.lit("").alias("agent"))
    )
    measures = (
        ("planned_makespan_s", pl.col("planned")),
        ("makespan_overrun_s", pl.col("actual") - pl.col("planned")),
    )
    return [
        _seconds(spans.with_columns(pl.lit(name).alias("measure")), ["measure", "agent"], value)
        for name, value in measures
    ]


def _seconds(rows: pl.DataFrame, keys: list[str], nanoseconds: pl.Expr) -> pl.DataFrame:
    # whole nanoseconds are added up before the one division, so the sum does not depend on the order of the rows
    return _totals(rows, keys, nanoseconds).with_columns(in_seconds(pl.col("total")))


def _totals(rows: pl.DataFrame, keys: list[str], value: pl.Expr) -> pl.DataFrame:
    return (
        rows.with_columns(value.alias("value"))
        .filter(pl.col("value").is_not_null())
        .group_by(*keys, "run_id")
        .agg(pl.col("value").sum().cast(pl.Float64).alias("total"), pl.len().cast(pl.Float64).alias("weight"))
    )


def _primary_intervals(intervals: pl.DataFrame) -> pl.DataFrame:
    return intervals.filter(has_learnt_role())
