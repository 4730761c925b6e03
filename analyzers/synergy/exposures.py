"""One task's executions as matrices: seconds in each joint state of the other agents."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl

from hrclog.analyzers.projections.joint_states import AgentTask
from hrclog.analyzers.synergy.observations import Observations
from hrclog.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Exposure:
    """K executions of one (agent, task), in S joint states of P other tasks.

    Attributes:
        key: the (agent, task).
        others: the other agents' tasks it met, sorted.
        seconds: in each state, sparse, shape (K, S).
        members: how often each other task is in each state, shape (S, P).
        last: number of the state just before the end, shape (K,).
        finished: whether the execution succeeded; the others are censored, shape (K,).
    """

    key: AgentTask
    others: tuple[AgentTask, ...]
    seconds: Any  # scipy.sparse.csr_array: scipy has no types
    members: FloatArray
    last: IntArray
    finished: BoolArray

    def work(self, log_factors: FloatArray) -> FloatArray:
        """Return W = sum over states of seconds / product of the factors in it, shape (K,).

        Args:
            log_factors: log s of `others`, shape (P,).
        """
        work: FloatArray = self.seconds @ np.exp(-(self.members @ log_factors))
        return work

    def log_factors(self, factors: Mapping[AgentTask, float]) -> FloatArray:
        """Return log factors in the order of `others`, 0 where none is known."""
        return np.array([factors.get(other, 0.0) for other in self.others], np.float64)

    def rows(self, kept: BoolArray) -> Exposure:
        """Return some of the executions.

        Args:
            kept: which, shape (K,).
        """
        return replace(self, seconds=self.seconds[kept], last=self.last[kept], finished=self.finished[kept])

    def idle_share(self, agent: str) -> float:
        """Return the share of the time, over all executions, in which another agent idles."""
        of_agent = np.array([other[0] == agent for other in self.others], np.bool_)
        busy = self.members[:, of_agent].any(axis=1)
        state_seconds = np.asarray(self.seconds.sum(axis=0)).ravel()
        return float(state_seconds[~busy].sum() / state_seconds.sum())


def exposures(observations: Observations) -> Iterator[Exposure]:
    """Yield the matrices of each (agent, task), sorted; executions of no length are left out."""
    rows = observations.executions.filter(pl.col("duration_s") > 0)
    for (agent, task), part in rows.sort("agent", "task", maintain_order=True).group_by(
        "agent", "task", maintain_order=True
    ):
        yield _exposure((str(agent), str(task)), part, observations)


def _exposure(key: AgentTask, part: pl.DataFrame, observations: Observations) -> Exposure:
    from scipy.sparse import csr_array

    flat = part["state"].explode().to_numpy()
    present, column = np.unique(flat, return_inverse=True)
    starts = np.concatenate([[0], np.cumsum(part["state"].list.len().to_numpy().astype(np.int64))])
    shape = (part.height, len(present))
    seconds = csr_array((part["seconds"].explode().to_numpy(), column, starts), shape=shape)
    states = [observations.states[state] for state in present]
    others = tuple(sorted({other for state in states for other in state}))
    members = np.array([[state.count(other) for other in others] for state in states], np.float64)
    last = np.searchsorted(present, part["last_state"].to_numpy())
    return Exposure(key, others, seconds, members.reshape(len(states), len(others)), last, part["finished"].to_numpy())
