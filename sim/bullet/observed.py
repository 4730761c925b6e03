"""The truth about a campaign whose couplings are not inputs but arise in the cell: summed over its runs."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Final

from hrclog.events import Outcome
from hrclog.sim.cell.description import Cell
from hrclog.sim.scenario import AgentTask, Scenario
from hrclog.sim.truth import PairTruth, RunTruth, SynergyTruth, TaskTruth, Truth

LEAST_PROGRESS_S: Final = 0.01
"""One tick of the stepped cell: a task that did less beside another has no factor that means anything."""


def observed_truth(scenario: Scenario, cell: Cell, seed: int, engine: str, runs: Iterable[RunTruth]) -> Truth:
    """Return the truth about a campaign, from what its runs counted; the order of the runs does not matter to it.

    Only time is scaled in the cell, so the integral of its speed scale over an overlap is the time that the same
    progress takes alone. Over all runs, per ordered pair of tasks of different agents:

        synergy  sum of overlaps / sum of progress made in them (as experienced)
        caused   sum of overlaps / sum of progress, had the speed followed without lag what the other asked for

    The log of a task's work has mean mu and standard deviation sigma over its executions that succeeded.

    Args:
        scenario: names the tasks.
        cell: says how often they fail.
        seed: of the campaign.
        engine: what simulated the runs.
        runs: the truth about each.
    """
    runs = tuple(runs)
    keys = scenario.problem.agent_tasks()
    logs: dict[AgentTask, list[float]] = defaultdict(list)
    for run in runs:
        for execution in run.executions:
            if execution.outcome == Outcome.SUCCEEDED and execution.work_s > 0.0:
                logs[execution.agent, execution.task].append(math.log(execution.work_s))
    pairs: dict[tuple[AgentTask, AgentTask], list[PairTruth]] = defaultdict(list)
    for run in runs:
        for pair in run.pairs:
            pairs[(pair.agent, pair.task), (pair.other_agent, pair.other_task)].append(pair)
    return Truth(
        scenario.name,
        seed,
        engine,
        tuple(TaskTruth(*key, *_mean_and_deviation(logs[key]), _failure_probability(cell, key)) for key in keys),
        tuple(_synergy(key, other, pairs[key, other]) for key in keys for other in keys if key[0] != other[0]),
        runs,
        cell.safety.policy,
    )


def _mean_and_deviation(values: Sequence[float]) -> tuple[float | None, float | None]:
    if not values:
        return None, None
    mean = math.fsum(values) / len(values)
    return mean, math.sqrt(math.fsum((value - mean) ** 2 for value in values) / len(values))


def _failure_probability(cell: Cell, key: AgentTask) -> float:
    fault = cell.fault.get(key)
    return fault.probability if fault else 0.0


def _synergy(key: AgentTask, other: AgentTask, pairs: Sequence[PairTruth]) -> SynergyTruth:
    overlap_s = math.fsum(pair.overlap_s for pair in pairs)
    progress_s = math.fsum(pair.progress_s for pair in pairs)
    caused_progress_s = math.fsum(pair.caused_progress_s for pair in pairs)
    return SynergyTruth(
        *key, *other, _factor(overlap_s, progress_s), _factor(overlap_s, caused_progress_s), round(overlap_s, 9)
    )


def _factor(overlap_s: float, progress_s: float) -> float | None:
    return overlap_s / progress_s if progress_s >= LEAST_PROGRESS_S else None
