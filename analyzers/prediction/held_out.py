"""Runs that are to be predicted: what a forecast may know of them, and how it did."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

import polars as pl

from hrclog.analyzers.intervals import counted
from hrclog.analyzers.prediction.forecast import score_forecast
from hrclog.analyzers.prediction.makespan import Step, predicted_makespan_s
from hrclog.analyzers.prediction.plan_cells import plan_cells
from hrclog.analyzers.prediction.timelines import Timelines
from hrclog.analyzers.segments import AgentTask
from hrclog.analyzers.synergy.fit import TaskModel
from hrclog.analyzers.synergy.log_work import expected_work_s
from hrclog.analyzers.synergy.pairs import in_seconds, successful

FORECASTS: Final = pl.Schema(
    {
        "estimator": pl.String(),
        "run_id": pl.String(),
        "agent": pl.String(),
        "task": pl.String(),
        "execution_id": pl.String(),
        "observed_s": pl.Float64(),
        "mean_s": pl.Float64(),
        "median_s": pl.Float64(),
        "low_s": pl.Float64(),  # of the 90 % interval
        "high_s": pl.Float64(),
        "crps_s": pl.Float64(),
        "interval_score_s": pl.Float64(),
        "log_density": pl.Float64(),
    }
)
"""One row per estimator and successful execution that counts."""

MAKESPANS: Final = pl.Schema(
    {"estimator": pl.String(), "run_id": pl.String(), "observed_s": pl.Float64(), "predicted_s": pl.Float64()}
)
"""One row per estimator and run whose tasks all have a model."""

ModelOf = Callable[[AgentTask, str], TaskModel | None]
"""Gives the model of an (agent, task) at a place of a plan; None where it was never seen to succeed."""


class HeldOut:
    """Runs to predict.

    Args:
        intervals: a frame of schema `INTERVALS`.
        cells_of: gives each execution's cell, as `plan_cells` does.
    """

    def __init__(self, intervals: pl.DataFrame, cells_of: Callable[[pl.DataFrame], pl.DataFrame] = plan_cells) -> None:
        rows = successful(intervals).sort("run_id", "start_ns", "until_ns", "agent", "task", "execution_id")
        cells = cells_of(intervals)
        rows = rows.join(cells, on=["run_id", "execution_id"], how="left", maintain_order="left")
        seconds = in_seconds(pl.col("end_ns") - pl.col("start_ns")).alias("observed_s")
        names = ("run_id", "agent", "task", "execution_id", "cell")
        self.executions = rows.select(*names, seconds).with_row_index("row")
        """Columns row, run_id, agent, task, execution_id, cell, observed_s, in order of run and start."""
        self.timelines = Timelines(rows, intervals)
        starts = intervals.group_by("run_id").agg(pl.col("start_ns").min())
        self.runs: list[str] = starts.sort("start_ns", "run_id")["run_id"].to_list()
        """In time order."""
        self._of_run = {str(run): part for (run,), part in self.executions.group_by("run_id", maintain_order=True)}
        items = _items(intervals, cells)
        self._no_items = items.clear()
        self._plans = {str(run): part for (run,), part in items.group_by("run_id", maintain_order=True)}

    def of(self, run: str) -> pl.DataFrame:
        """Return the rows of `executions` of one run; none where nothing succeeded."""
        return self._of_run.get(run, self.executions.clear())

    def forecasts(self, estimator: str, run: str, model_of: ModelOf) -> Iterator[tuple[Any, ...]]:
        """Yield rows of `FORECASTS`; executions without a model have none."""
        for row, _, agent, task, execution, cell, observed in self.of(run).iter_rows():
            model = model_of((agent, task), cell)
            if model is not None:
                timeline = self.timelines.along(row, model.log_factors)
                found = score_forecast(timeline, model.log_work, observed)
                yield (
                    estimator,
                    run,
                    agent,
                    task,
                    execution,
                    observed,
                    found.mean_s,
                    found.median_s,
                    found.low_s,
                    found.high_s,
                    found.crps_s,
                    found.interval_score_s,
                    found.log_density,
                )

    def makespan(
        self, estimator: str, run: str, model_of: ModelOf, gaps_s: Mapping[str, float]
    ) -> Iterator[tuple[Any, ...]]:
        """Yield the row of `MAKESPANS` of a run, if every one of its tasks has a model.

        Args:
            estimator: its name.
            run: which.
            model_of: the models.
            gaps_s: between two tasks of an agent, mean of other runs.
        """
        sequences: dict[str, list[Step]] = {}
        models: dict[AgentTask, TaskModel] = {}
        items = self._plans.get(run, self._no_items)
        for agent, task, cell, planned_s in items.select("agent", "task", "cell", "planned_s").iter_rows():
            model = model_of((agent, task), cell)
            if model is None:
                return
            models[agent, task] = model
            step = Step(task, expected_work_s(model.log_work), -math.inf if planned_s is None else planned_s)
            sequences.setdefault(agent, []).append(step)
        if not sequences:
            return

        def factor(key: AgentTask, other: AgentTask) -> float:
            return models[key].log_factors.get(other, 0.0)

        starts_s = dict(items.group_by("agent").agg(pl.col("start_s").min()).iter_rows())
        gaps = {agent: gaps_s.get(agent, 0.0) for agent in sequences}
        observed_s = float(items["end_s"].to_numpy().max())
        yield estimator, run, observed_s, predicted_makespan_s(sequences, gaps, starts_s, factor)


def _items(intervals: pl.DataFrame, cells: pl.DataFrame) -> pl.DataFrame:
    """Return the plan of each run: one row per item, in the order of each agent's items; instants since its start."""
    rows = intervals.filter(counted()).join(cells, on=["run_id", "execution_id"])
    first = pl.col("start_ns").min().over("run_id")
    return (
        rows.with_columns(
            in_seconds(pl.col("start_ns") - first).alias("start_s"),
            in_seconds(pl.col("until_ns") - first).alias("end_s"),
            in_seconds(pl.col("planned_start_ns") - first).fill_nan(None).alias("planned_s"),
        )
        .sort("run_id", "agent", "position", "start_s", "execution_id")
        .group_by("run_id", "agent", "position", maintain_order=True)
        .agg(pl.col("task", "cell", "planned_s").first(), pl.col("start_s").min(), pl.col("end_s").max())
    )
