"""The plans of the runs to predict: each agent's items in order, and the expected makespan."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl

from hrclog.analyzers.projections.intervals import is_counted
from hrclog.analyzers.projections.joint_states import AgentTask
from hrclog.analyzers.search.encoded import Encoded, encode_queues
from hrclog.analyzers.search.evaluate import evaluate
from hrclog.analyzers.search.worlds import Worlds
from hrclog.analyzers.synergy.fit import TaskModel
from hrclog.analyzers.synergy.log_work import expected_work_s
from hrclog.analyzers.synergy.pairs import in_seconds
from hrclog.arrays import FloatArray

ModelOf = Callable[[AgentTask, str], TaskModel | None]
"""Gives the model of an (agent, task) at a place of a plan; None where it was never seen to succeed."""


@dataclass(frozen=True, slots=True)
class RunPlan:
    """What a run was to do.

    Attributes:
        items: each agent's in order; its first not before it started, the others not before their planned starts.
        cells: of each agent the place of each of its items in the plan.
        observed_s: the makespan that came of it.
    """

    items: Encoded
    cells: tuple[tuple[str, ...], ...]
    observed_s: float

    def predicted_s(self, model_of: ModelOf, gaps_s: Mapping[str, float]) -> float | None:
        """Return the expected makespan, None if an item has no model.

        Args:
            model_of: the models.
            gaps_s: from when an agent could start its next item until it does; 0 for agents not named.
        """
        models: list[TaskModel] = []
        for agent, place in self._places():
            model = model_of(self.items.keys[self.items.task[0, agent, place]], self.cells[agent][place])
            if model is None:
                return None
            models.append(model)
        return float(evaluate(self.items, self._world(models, gaps_s)).makespan_s[0, 0])

    def _places(self) -> Iterator[tuple[int, int]]:
        """Yield agent and place of each item."""
        for agent, cells in enumerate(self.cells):
            for place in range(len(cells)):
                yield agent, place

    def _world(self, models: Sequence[TaskModel], gaps_s: Mapping[str, float]) -> Worlds:
        """Return the world in which each item takes what its model expects; an agent's first item has no gap."""
        keys, width = self.items.keys, self.items.task.shape[-1]
        work = np.ones((1, len(keys), width))
        log_s = np.zeros((1, len(keys) + 1, len(keys) + 1))
        for (agent, place), model in zip(self._places(), models, strict=True):
            key = self.items.task[0, agent, place]
            work[0, key, self.items.repeat[0, agent, place]] = expected_work_s(model.log_work)
            log_s[0, key, :-1] = [model.log_factors.get(other, 0.0) for other in keys]
        gap = np.zeros((1, len(self.items.agents), width))
        gap[0, :, 1:] = np.array([gaps_s.get(agent, 0.0) for agent in self.items.agents])[:, None]
        return Worlds(work, np.exp(-log_s), gap)


def run_plans(intervals: pl.DataFrame, cells: pl.DataFrame) -> dict[str, RunPlan]:
    """Return what each run was to do, by its id; runs without executions that count have no entry.

    Attempts at one item are one piece of work.

    Args:
        intervals: a frame of schema `INTERVALS`.
        cells: each execution's cell, as `plan_cells` gives it.
    """
    items = _item_rows(intervals, cells)
    return {str(run): _run_plan(part) for (run,), part in items.group_by("run_id", maintain_order=True)}


def _item_rows(intervals: pl.DataFrame, cells: pl.DataFrame) -> pl.DataFrame:
    """Return one row per item, in the order of each agent's items; instants since its run's start."""
    rows = intervals.filter(is_counted()).join(cells, on=["run_id", "execution_id"])
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


def _run_plan(items: pl.DataFrame) -> RunPlan:
    parts = {str(agent): part for (agent,), part in items.group_by("agent", maintain_order=True)}
    queues = {agent: part["task"].to_list() for agent, part in parts.items()}
    keys = sorted({(agent, task) for agent, tasks in queues.items() for task in tasks})
    encoded = encode_queues(tuple(parts), keys, [queues])
    not_before = np.zeros(encoded.task.shape)
    for place, part in enumerate(parts.values()):
        not_before[0, place, : part.height] = _earliest_starts_s(part)
    cells = tuple(tuple(part["cell"].to_list()) for part in parts.values())
    return RunPlan(replace(encoded, not_before_s=not_before), cells, float(items["end_s"].to_numpy().max()))


def _earliest_starts_s(items: pl.DataFrame) -> FloatArray:
    """Return when each item of an agent may be begun."""
    instants = items["planned_s"].fill_null(0.0).to_numpy().copy()
    instants[0] = items["start_s"].to_numpy().min()
    return instants
