"""Worlds in which plans are evaluated: how long each execution would take, drawn from the known task times."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hrclog.arrays import FloatArray
from hrclog.errors import ScenarioError
from hrclog.knowledge.task_times import AgentTask, Gap, TaskTime, TaskTimes

UNKNOWN_DEVIATION: Final = 0.5
"""Prior standard deviation of a log factor that was never observed: two in three factors within 0.6 and 1.65."""


@dataclass(frozen=True, slots=True)
class Worlds:
    """S worlds. The same execution of the same task has the same work in every plan, so plans differ by what they do.

    Attributes:
        work_s: of the j-th execution of each key, attempts that fail included, shape (S, K, J).
        rate: of the first key while the second runs, shape (S, K + 1, K + 1); the last stands for idle, with rate 1.
        gap_s: before the j-th item of each agent, shape (S, A, P).
    """

    work_s: FloatArray
    rate: FloatArray
    gap_s: FloatArray

    @property
    def count(self) -> int:
        """Return how many worlds there are."""
        return len(self.work_s)


def expected_world(
    times: TaskTimes, keys: Sequence[AgentTask], agents: Sequence[str], size: int, *, synergies: bool = True
) -> Worlds:
    """Return the one world in which everything is as expected.

    Args:
        times: what is known.
        keys: (agent, task) by number.
        agents: by number.
        size: the longest queue.
        synergies: whether agents hinder and help each other.

    Raises:
        ScenarioError: nothing is known of a key.
    """
    key_times = _times_of(times, keys)
    work = np.array([expected_work_s(time, times) for time in key_times])
    log_s = _log_factors(key_times, keys, [np.array([f.log_s for f in time.factors])[None] for time in key_times], 1)
    return Worlds(
        np.broadcast_to(work[None, :, None], (1, len(keys), size)),
        np.exp(-log_s if synergies else 0.0 * log_s),
        np.broadcast_to(np.array([_mean_gap(times, agent) for agent in agents])[None, :, None], (1, len(agents), size)),
    )


def drawn_worlds(
    times: TaskTimes, keys: Sequence[AgentTask], agents: Sequence[str], size: int, count: int, seed: int = 0
) -> Worlds:
    """Return worlds drawn from the posterior of what is known, and from how executions vary.

    Factors never observed are drawn from their prior. Normal numbers come in pairs of opposite sign, which halves what
    chance adds to a mean.

    Args:
        times: what is known.
        keys: (agent, task) by number.
        agents: by number.
        size: the longest queue.
        count: how many, even.
        seed: of the draws.

    Raises:
        ScenarioError: nothing is known of a key.
    """
    key_times = _times_of(times, keys)
    source = np.random.default_rng(seed % 2**64)
    work = np.empty((count, len(keys), size))
    factors = []
    for number, time in enumerate(key_times):
        drawn = _draw_parameters(time, _draw_normal(source, count, 2 + len(time.factors)))
        noise = _draw_normal(source, count, size)
        work[:, number] = np.exp(drawn[:, :1] + np.exp(drawn[:, 1:2]) * noise)
        if time.failure_rate:
            work[:, number] += _draw_failures(time, _draw_normal(source, count, size)) * _attempt_s(time, times)
        factors.append(drawn[:, 2:])
    unknown = UNKNOWN_DEVIATION * _draw_normal(source, count, (len(keys) + 1) ** 2)
    log_s = _log_factors(key_times, keys, factors, count, unknown.reshape(count, len(keys) + 1, -1))
    gap = np.stack([_draw_gaps(times.gaps.get(agent), _draw_normal(source, count, size)) for agent in agents], axis=1)
    return Worlds(work, np.exp(-log_s), gap)


def _times_of(times: TaskTimes, keys: Sequence[AgentTask]) -> list[TaskTime]:
    missing = [key for key in keys if key not in times.times]
    if missing:
        names = ", ".join(f"{task} by {agent}" for agent, task in missing[:4])
        more = f" and {len(missing) - 4} more" if len(missing) > 4 else ""
        raise ScenarioError(
            f"how long does it take: {names}{more}? No run shows it succeed, and no guess is declared; add"
            " expected_s to the task, or learn from runs with it: hrclog kb update"
        )
    return [times.times[key] for key in keys]


def expected_work_s(time: TaskTime, times: TaskTimes) -> float:
    """Return the expected work of an item, with the attempts that fail before one succeeds."""
    failures = time.failure_rate / (1.0 - time.failure_rate)
    return time.mean_s + failures * _attempt_s(time, times)


def _draw_failures(time: TaskTime, normal: FloatArray) -> FloatArray:
    """Return how many attempts fail before one succeeds, geometric, shape as `normal`."""
    from scipy.special import log_ndtr

    failures: FloatArray = np.floor(log_ndtr(normal) / math.log(time.failure_rate))
    return failures


def _attempt_s(time: TaskTime, times: TaskTimes) -> float:
    """Return what a failed attempt costs: itself, and the gap before the next."""
    return time.failed_s + _mean_gap(times, time.agent)


def _draw_normal(source: np.random.Generator, count: int, size: int) -> FloatArray:
    half = source.standard_normal(((count + 1) // 2, size))
    return np.concatenate([half, -half])[:count]


def _draw_parameters(time: TaskTime, normal: FloatArray) -> FloatArray:
    """Return draws of (mu, log sigma, log s ...), shape (S, 2 + P)."""
    center = np.array([time.mu, math.log(max(time.sigma, 1e-9)), *(factor.log_s for factor in time.factors)])
    if time.covariance is None:
        return np.broadcast_to(center, normal.shape).copy()
    values, vectors = np.linalg.eigh((time.covariance + time.covariance.T) / 2)
    root = vectors * np.sqrt(values.clip(0.0))
    draws: FloatArray = center + normal @ root.T
    return draws


def _log_factors(
    key_times: Sequence[TaskTime],
    keys: Sequence[AgentTask],
    drawn: Sequence[FloatArray],
    count: int,
    unknown: FloatArray | None = None,
) -> FloatArray:
    """Return log factors, shape (S, K + 1, K + 1): drawn where observed, `unknown` between other agents, else 0."""
    number = {key: index for index, key in enumerate(keys)}
    log_s = np.zeros((count, len(keys) + 1, len(keys) + 1))
    if unknown is not None:
        agents = np.array([agent for agent, _ in keys])
        others = np.zeros(log_s.shape[1:], np.bool_)
        others[:-1, :-1] = agents[:, None] != agents[None, :]
        log_s = np.where(others, unknown, 0.0)
    for row, (time, values) in enumerate(zip(key_times, drawn, strict=True)):
        for place, factor in enumerate(time.factors):
            column = number.get((factor.other_agent, factor.other_task))
            if column is not None:
                log_s[:, row, column] = values[:, place]
    return log_s


def _mean_gap(times: TaskTimes, agent: str) -> float:
    gap = times.gaps.get(agent)
    return gap.mean_s if gap else 0.0


def _draw_gaps(gap: Gap | None, normal: FloatArray) -> FloatArray:
    """Return lognormal draws with the gap's mean and deviation, shape as `normal`."""
    if gap is None or gap.mean_s <= 0.0:
        return np.zeros_like(normal)
    variance = math.log1p((gap.std_s / gap.mean_s) ** 2)
    gaps: FloatArray = np.exp(math.log(gap.mean_s) - variance / 2 + math.sqrt(variance) * normal)
    return gaps
