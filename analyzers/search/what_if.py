"""Suppose that tasks affected each other otherwise than was learnt."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from hrclog.errors import ScenarioError
from hrclog.json_record import JsonRecord, read_json
from hrclog.knowledge.task_times import AgentTask, Factor, TaskTime, TaskTimes

Overrides = Mapping[tuple[AgentTask, AgentTask], float]
"""Factor on the duration of the first (agent, task), over undisturbed work, while the second runs."""

_PAIR: Final = ("agent", "task", "other_agent", "other_task")


def read_overrides(path: Path) -> dict[tuple[AgentTask, AgentTask], float]:
    """Return the factors of a JSON file: {"synergies": [{agent, task, other_agent, other_task, synergy}, ...]}.

    Raises:
        ScenarioError: the file cannot be read, or a field is missing or wrong.
    """
    record = JsonRecord(read_json(path, "synergies"), str(path), ("synergies",))
    overrides: dict[tuple[AgentTask, AgentTask], float] = {}
    for entry in record.records("synergies", (*_PAIR, "synergy")):
        key, other = _pair(entry)
        if (key, other) in overrides:
            raise ScenarioError(f"{entry.where}: {key[1]} by {key[0]} beside {other[1]} is given twice; remove one")
        overrides[key, other] = entry.positive("synergy")
    return overrides


def read_pairs(path: Path) -> tuple[tuple[AgentTask, AgentTask], ...]:
    """Return the pairs of a JSON file: {"pairs": [{agent, task, other_agent, other_task}, ...]}.

    Raises:
        ScenarioError: the file cannot be read, or a field is missing or wrong.
    """
    record = JsonRecord(read_json(path, "pairs of tasks"), str(path), ("pairs",))
    return tuple(_pair(entry) for entry in record.records("pairs", _PAIR))


def _pair(entry: JsonRecord) -> tuple[AgentTask, AgentTask]:
    key, other = (entry.text("agent"), entry.text("task")), (entry.text("other_agent"), entry.text("other_task"))
    if key[0] == other[0]:
        raise ScenarioError(f"{entry.where}: {key[0]!r} does one task at a time; name two agents")
    return key, other


def with_overrides(times: TaskTimes, overrides: Overrides) -> TaskTimes:
    """Return times in which some factors are what somebody says they are, for certain.

    Raises:
        ScenarioError: nothing is known of an (agent, task).
    """
    changed = dict(times.times)
    for (key, other), factor in sorted(overrides.items()):
        for agent_task in (key, other):
            if agent_task not in changed:
                names = ", ".join(f"{task} by {agent}" for agent, task in sorted(changed))
                raise ScenarioError(
                    f"synergy of {agent_task[1]!r} by {agent_task[0]!r}: nothing is known of it; known are {names}"
                )
        changed[key] = _with_factor(changed[key], other, factor)
    return replace(times, times=changed)


def _with_factor(time: TaskTime, other: AgentTask, factor: float) -> TaskTime:
    names = [(existing.other_agent, existing.other_task) for existing in time.factors]
    if other not in names:
        wider = None if time.covariance is None else np.pad(time.covariance, (0, 1))
        return replace(time, factors=(*time.factors, Factor(*other, math.log(factor), 0)), covariance=wider)
    place = names.index(other)
    factors = list(time.factors)
    factors[place] = replace(factors[place], log_s=math.log(factor), n=0)
    covariance = time.covariance
    if covariance is not None:
        covariance = covariance.copy()
        covariance[2 + place] = covariance[:, 2 + place] = 0.0
    return replace(time, factors=tuple(factors), covariance=covariance)
