"""Makespans that plans really have in a simulated cell, kept in a file so that no run is simulated twice."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from hrclog.events import TaskEnded, TaskStarted
from hrclog.parallel import ordered_map
from hrclog.planning.plan import Orders, Plan, make_plan
from hrclog.sim.bullet.engine import with_policy, with_signals
from hrclog.sim.run import Run, simulate_run
from hrclog.sim.scenario import Scenario, load_scenario

Job = tuple[tuple[tuple[str, ...], ...], int]
"""The tasks of each agent, and the number of the run: runs of one number share what chance does."""

_BATCH = 4
_SEED = 40_000


@dataclass(frozen=True)
class CellName:
    """A scenario and the policy that guards its human."""

    scenario: str
    safety: str

    def __str__(self) -> str:
        return f"{self.scenario}-{self.safety}"

    def load(self) -> Scenario:
        """Return the cell, without signals: they take time and change nothing."""
        return with_signals(with_policy(load_scenario(self.scenario), self.safety), 0.0)


def job_of(cell: Scenario, orders: Orders, number: int) -> Job:
    """Return what has to be simulated."""
    return tuple(tuple(orders.get(agent, ())) for agent in cell.problem.agents), number


class Realised:
    """The makespans of a cell's plans.

    Args:
        name: the cell.
        folder: where its file is kept.
        workers: processes that simulate.
    """

    def __init__(self, name: CellName, folder: Path, workers: int) -> None:
        self.name = name
        self.cell = name.load()
        self._path = folder / f"{name}.jsonl"
        self._workers = workers
        self._known: dict[Job, float] = {}
        if self._path.exists():
            for line in self._path.read_text().splitlines():
                queues, number, makespan_s = json.loads(line)
                self._known[tuple(map(tuple, queues)), number] = makespan_s

    def makespans_s(self, plans: Sequence[Plan], numbers: Iterable[int]) -> list[list[float]]:
        """Return a row per plan, with the makespan in each numbered run."""
        jobs = [[job_of(self.cell, plan.orders(), number) for number in numbers] for plan in plans]
        self._simulate(list(dict.fromkeys(job for row in jobs for job in row if job not in self._known)))
        return [[self._known[job] for job in row] for row in jobs]

    def one_each_s(self, plans: Sequence[Plan], first: int) -> list[float]:
        """Return a makespan per plan, each in a run of its own number."""
        jobs = [job_of(self.cell, plan.orders(), first + index) for index, plan in enumerate(plans)]
        self._simulate(list(dict.fromkeys(job for job in jobs if job not in self._known)))
        return [self._known[job] for job in jobs]

    def _simulate(self, jobs: list[Job]) -> None:
        batches = [jobs[start : start + _BATCH] for start in range(0, len(jobs), _BATCH)]
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with self._path.open("a") as out:
            results = ordered_map(partial(_makespans_s, self.name), batches, self._workers)
            for batch, found in zip(batches, results, strict=True):
                for job, makespan_s in zip(batch, found, strict=True):
                    self._known[job] = makespan_s
                    out.write(json.dumps([*job, makespan_s]) + "\n")
                out.flush()


def _makespans_s(name: CellName, jobs: Sequence[Job]) -> list[float]:
    cell = name.load()
    found = []
    for queues, number in jobs:
        plan = make_plan(cell.problem, dict(zip(cell.problem.agents, queues, strict=True)))
        found.append(makespan_s(simulate_run(cell, _SEED, number, plan, engine="bullet")))
    return found


def makespan_s(run: Run) -> float:
    """Return the time from the first start to the last end."""
    starts = [event.time_ns for event in run.events if isinstance(event, TaskStarted)]
    ends = [event.time_ns for event in run.events if isinstance(event, TaskEnded)]
    return (max(ends) - min(starts)) / 1e9
