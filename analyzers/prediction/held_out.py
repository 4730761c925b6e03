"""Runs that are to be predicted: what a forecast may know of them, and how it did."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

import polars as pl

from hrclog.analyzers.prediction.forecast import score_forecast
from hrclog.analyzers.prediction.plan_cells import plan_cells
from hrclog.analyzers.prediction.run_plans import ModelOf, run_plans
from hrclog.analyzers.prediction.timelines import Timelines
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
        self._plans = run_plans(intervals, cells)

    def of(self, run: str) -> pl.DataFrame:
        """Return the rows of `executions` of one run; none where nothing succeeded."""
        return self._of_run.get(run, self.executions.clear())

    def forecasts(self, estimator: str, run: str, model_of: ModelOf) -> Iterator[tuple[Any, ...]]:
        """Yield rows of `FORECASTS`; executions without a model have none."""
        for row, _, agent, task, execution, cell, observed in self.of(run).iter_rows():
            model = model_of((agent, task), cell)
            if model is not None:
                timeline = self.timelines.along(row, model.log_factors)
                scored = score_forecast(timeline, model.log_work, observed)
                yield (
                    estimator,
                    run,
                    agent,
                    task,
                    execution,
                    observed,
                    scored.mean_s,
                    scored.median_s,
                    scored.low_s,
                    scored.high_s,
                    scored.crps_s,
                    scored.interval_score_s,
                    scored.log_density,
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
        plan = self._plans.get(run)
        predicted_s = plan.predicted_s(model_of, gaps_s) if plan else None
        if plan and predicted_s is not None:
            yield estimator, run, plan.observed_s, predicted_s
