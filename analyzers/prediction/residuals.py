"""The distribution of log work in the current session, learnt from run to run.

A session differs from those before it: other people, other plans. So per (agent, task) log W has a normal distribution
of unknown mean and variance, with a normal-inverse-gamma belief that starts at the training runs, forgets, and learns
from every run that has ended. The same place of the same plan, run again, repeats itself more closely than the task as
a whole; from its second time on such a *cell* has a belief of its own, started from the task's. The forecast is
Student's t. Tails are what they are, so the width is scaled until nine in ten executions fall within the 90 % interval
(adaptive conformal inference: Gibbs and Candes 2021).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from hrclog.analyzers.prediction.scoring_rules import HIGH, LOW
from hrclog.analyzers.projections.joint_states import AgentTask
from hrclog.analyzers.synergy.log_work import LogWork, StudentLogWork

_TASK_WEIGHT, _TASK_FREEDOM = 2.0, 4.0  # what the training runs are worth, in executions
_CELL_WEIGHT, _CELL_FREEDOM = 0.1, 4.0  # what the task is worth to a cell
_LEAST_WEIGHT, _LEAST_CELL_WEIGHT, _LEAST_FREEDOM = 0.5, 0.2, 2.0
_NARROWEST: Final = 1e-6  # deviation; a cell may repeat to the nanosecond


@dataclass(frozen=True, slots=True)
class Learning:
    """How a session is learnt.

    Attributes:
        kept: of what is known, from run to run.
        cell_share: of a task's variance that is expected within a cell.
        width_step: how far an execution inside or outside its interval moves the log width.
    """

    kept: float = 0.95
    cell_share: float = 0.3
    width_step: float = 0.01


@dataclass(slots=True)
class _Belief:
    """Normal-inverse-gamma belief: mean and variance, and the weight of the evidence on each."""

    mean: float
    variance: float
    weight: float
    freedom: float

    def predict(self, width: float) -> StudentLogWork:
        scale = math.sqrt(self.variance * (1 + 1 / self.weight))
        return StudentLogWork(self.mean, max(width * scale, _NARROWEST), self.freedom)

    def forget(self, kept: float, least_weight: float) -> None:
        self.weight = max(kept * self.weight, least_weight)
        self.freedom = max(kept * self.freedom, _LEAST_FREEDOM)

    def learn(self, value: float) -> None:
        error = value - self.mean
        gain = 1 / (self.weight + 1)
        self.variance = (self.freedom * self.variance + self.weight * gain * error**2) / (self.freedom + 1)
        self.mean += gain * error
        self.weight += 1
        self.freedom += 1


@dataclass(frozen=True, slots=True)
class Observed:
    """The log work of one execution, at a place of a plan."""

    key: AgentTask
    cell: str
    log_work: float


class Session:
    """What is known of the session under way.

    Args:
        start: per (agent, task) how log work was distributed in the training runs.
        learning: how to learn.
    """

    def __init__(self, start: Mapping[AgentTask, LogWork], learning: Learning | None = None) -> None:
        self._learning = learning or Learning()
        self._tasks = {
            key: _Belief(work.center, work.deviation**2, _TASK_WEIGHT, _TASK_FREEDOM) for key, work in start.items()
        }
        self._cells: dict[tuple[AgentTask, str], _Belief] = {}
        self._log_width = {True: 0.0, False: 0.0}  # of cells, of tasks

    def predict(self, key: AgentTask, cell: str) -> StudentLogWork:
        """Return the distribution of the log work of an execution; its (agent, task) must be among those at the start.

        Args:
            key: its (agent, task).
            cell: its place in its plan.
        """
        belief = self._cells.get((key, cell))
        return (belief or self._tasks[key]).predict(math.exp(self._log_width[belief is not None]))

    def learn(self, run: Iterable[Observed]) -> None:
        """Learn from a run that has ended.

        Args:
            run: its executions, each predicted from what was known before the run.
        """
        executions = list(run)
        misses = [
            ((execution.key, execution.cell) in self._cells, self._is_outside(execution)) for execution in executions
        ]
        for has_cell, outside in misses:
            self._log_width[has_cell] += self._learning.width_step * (outside - (1 - (HIGH - LOW)))
        for belief in self._tasks.values():
            belief.forget(self._learning.kept, _LEAST_WEIGHT)
        for execution in executions:
            cell_key, task = (execution.key, execution.cell), self._tasks[execution.key]
            if cell_key not in self._cells:
                variance = self._learning.cell_share * task.variance
                self._cells[cell_key] = _Belief(task.mean, variance, _CELL_WEIGHT, _CELL_FREEDOM)
            self._cells[cell_key].forget(self._learning.kept, _LEAST_CELL_WEIGHT)
            self._cells[cell_key].learn(execution.log_work)
            task.learn(execution.log_work)

    def _is_outside(self, execution: Observed) -> bool:
        forecast = self.predict(execution.key, execution.cell)
        return abs(execution.log_work - forecast.center) > forecast.half_width(HIGH - LOW)
