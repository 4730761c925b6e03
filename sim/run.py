"""One simulated run: events and truth, a pure function of scenario, seed and number."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

from hrclog._version import __version__
from hrclog.events import Event, Outcome, RunEnded, RunStarted
from hrclog.ids import Uuid7Generator
from hrclog.plan import Plan, check_plan, with_planned_times
from hrclog.random_plans import random_plans
from hrclog.sim.discrete import DiscreteCell
from hrclog.sim.dispatch import SimulatedDispatcher
from hrclog.sim.event_queue import EventQueue
from hrclog.sim.scenario import Scenario
from hrclog.sim.stream import Stream
from hrclog.sim.truth import RunTruth

BASE_EPOCH_NS: Final = 1_735_689_600_000_000_000
"""When the first simulated run starts: 2025-01-01T00:00:00Z."""

_SLOT_NS: Final = 600_000_000_000
_SLACK: Final = 10


@dataclass(frozen=True, slots=True)
class Run:
    """A run as it would be in a log, and the truth about it."""

    events: tuple[Event, ...]
    truth: RunTruth


def simulate_run(scenario: Scenario, seed: int, index: int, plan: Plan | None = None) -> Run:
    """Return the events and the truth of one run.

    The same arguments give the same run, whatever else is simulated before or beside it.

    Args:
        scenario: the cell.
        seed: of the campaign.
        index: number of the run in the campaign, from 0.
        plan: what to carry out; None draws the plan of that number (see `PlanSequence`).

    Raises:
        ScenarioError: the plan does not fit, or the run comes to a standstill.
    """
    chosen = plan_of(scenario, seed, index) if plan is None else _checked(scenario, plan)
    queue = EventQueue(BASE_EPOCH_NS + index * _spacing_ns(scenario))
    events: list[Event] = []
    next_seq = itertools.count().__next__
    new_id = Uuid7Generator(lambda: queue.now_ns, _id_stream(scenario, seed, index, plan).bits)
    run_id, name = new_id(), run_name(scenario, index)
    streams = {agent: Stream(seed, index, "agent", agent) for agent in scenario.problem.agents}
    cell = DiscreteCell(scenario, queue, streams, next_seq)
    dispatcher = SimulatedDispatcher(scenario, chosen, cell, queue, run_id, new_id, next_seq, events.append)
    events.append(
        RunStarted(
            time_ns=queue.now_ns,
            run_id=run_id,
            seq=next_seq(),
            name=name,
            agents=scenario.problem.agents,
            plan=chosen.to_json(),
            task_properties=scenario.problem.to_json()["tasks"],
            dispatch_mode=scenario.dispatch_mode,
            software={"hrclog": __version__, "engine": "events"},
            seed=seed,
        )
    )
    cell.watch(run_id)
    dispatcher.run()
    outcome, reason = _verdict(dispatcher)
    events.append(RunEnded(time_ns=events[-1].time_ns, run_id=run_id, seq=next_seq(), outcome=outcome, reason=reason))
    return Run(tuple(events), RunTruth(run_id, name, tuple(cell.truth)))


def run_name(scenario: Scenario, index: int) -> str:
    """Return the name of a run, which is its file's name too."""
    return f"{scenario.name}_{index:04d}"


class PlanSequence:
    """The plans of a campaign: all different until chance finds no more, then the same ones in ever new orders.

    Args:
        scenario: its problem, and its mean times for the planned instants.
        seed: of the campaign.
    """

    def __init__(self, scenario: Scenario, seed: int) -> None:
        self._scenario = scenario
        self._seed = seed
        self._drawn: Iterator[Plan] = random_plans(scenario.problem, seed)
        self._plans: list[Plan] = []
        self._round: tuple[int, list[int]] = (0, [])

    def __getitem__(self, index: int) -> Plan:
        for plan in itertools.islice(self._drawn, max(index + 1 - len(self._plans), 0)):
            self._plans.append(_timed(self._scenario, plan))
        if index < len(self._plans):
            return self._plans[index]
        number, place = divmod(index, len(self._plans))
        if self._round[0] != number:
            source = Stream(self._seed, "round", number)
            chances = [source.uniform() for _ in self._plans]
            self._round = (number, sorted(range(len(chances)), key=chances.__getitem__))
        return self._plans[self._round[1][place]]


def plan_of(scenario: Scenario, seed: int, index: int) -> Plan:
    """Return the plan that a run of a campaign carries out."""
    return _plan_sequence(scenario, seed)[index]


@lru_cache(maxsize=4)
def _plan_sequence(scenario: Scenario, seed: int) -> PlanSequence:
    return PlanSequence(scenario, seed)


def _id_stream(scenario: Scenario, seed: int, index: int, plan: Plan | None) -> Stream:
    # runs of different scenarios and plans start at the same instants and may be analysed together
    given = () if plan is None else (json.dumps(plan.to_json(), sort_keys=True),)
    return Stream(seed, index, "ids", scenario.name, scenario.digest, *given)


def _checked(scenario: Scenario, plan: Plan) -> Plan:
    check_plan(scenario.problem, plan)
    return plan if all(item.planned_start_s is not None for item in plan.items) else _timed(scenario, plan)


def _timed(scenario: Scenario, plan: Plan) -> Plan:
    gaps_s = {agent: gap.mean_s for agent, gap in scenario.gap.items()}
    return with_planned_times(plan, scenario.durations_s, gaps_s)


def _spacing_ns(scenario: Scenario) -> int:
    """Return the time between the starts of two runs: generous, so that runs do not share an instant."""
    longest_s = max(scenario.durations_s.values()) + max((gap.mean_s for gap in scenario.gap.values()), default=0.0)
    total = sum(count.count for count in scenario.problem.counts)
    return _SLOT_NS * math.ceil(_SLACK * longest_s * total * 1e9 / _SLOT_NS)


def _verdict(dispatcher: SimulatedDispatcher) -> tuple[str, str]:
    if dispatcher.aborted:
        return Outcome.FAILED, dispatcher.aborted
    lost = [item_id for item_id, outcome in dispatcher.outcomes.items() if outcome != Outcome.SUCCEEDED]
    if lost:
        return Outcome.FAILED, f"{len(lost)} of {len(dispatcher.outcomes)} items did not succeed"
    return Outcome.SUCCEEDED, ""
