"""Runs frames made by hand and from executions."""

from __future__ import annotations

from collections.abc import Sequence

import polars as pl

from hrclog.analyzers.projections.schemas import PLAN_LABELS, RUNS


def runs_of(intervals: pl.DataFrame) -> pl.DataFrame:
    """Return a runs frame of executions; every run has succeeded."""
    spans = intervals.group_by("run_id").agg(
        pl.col("agent").unique().sort().alias("agents"),
        pl.col("start_ns").min(),
        pl.col("until_ns").max().alias("end_ns"),
        pl.len().alias("n_executions"),
    )
    return spans.select(
        "run_id",
        pl.col("run_id").alias("name"),
        pl.lit("some.mcap").alias("path"),
        "agents",
        "start_ns",
        "end_ns",
        ((pl.col("end_ns") - pl.col("start_ns")) / 1e9).alias("makespan_s"),
        "n_executions",
        pl.lit(0).alias("n_failed"),
        pl.lit(0).alias("n_open"),
        pl.lit("succeeded").alias("outcome"),
    ).cast(dict(RUNS)).sort("start_ns", "run_id")  # fmt: skip


def runs_that_took(*makespans: float | None, outcome: str = "succeeded", n_open: int = 0) -> pl.DataFrame:
    """Return a runs frame of runs r000, r001, … one after the other; None never started."""
    rows = [
        {
            "run_id": f"r{number:03}",
            "name": f"run {number}",
            "path": "",
            "agents": ["H", "R"],
            "start_ns": None if took is None else number * 10**12,
            "end_ns": None if took is None else number * 10**12 + round(took * 1e9),
            "makespan_s": took,
            "n_executions": 0 if took is None else 1,
            "n_failed": 0,
            "n_open": n_open,
            "outcome": outcome,
        }
        for number, took in enumerate(makespans)
    ]
    return pl.DataFrame(rows, schema=RUNS)


def labels_of(runs: pl.DataFrame, plans: Sequence[str] = (), planners: Sequence[str] = ()) -> pl.DataFrame:
    """Return the labels of runs, in their order; "" where none is given."""
    columns = {
        "run_id": runs["run_id"].to_list(),
        "plan": list(plans) or [""] * runs.height,
        "planner": list(planners) or [""] * runs.height,
    }
    return pl.DataFrame(columns, schema=PLAN_LABELS)
