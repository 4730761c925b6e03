"""One simulated run: events and truth, a pure function of scenario, seed and number."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Final

from hrclog.errors import ScenarioError
from hrclog.events import Event, Outcome, RunEnded, RunStarted
from hrclog.ids import Uuid7Generator
from hrclog.planning.plan import Plan, PlanItem, check_plan, with_planned_times
from hrclog.planning.provenance import made_for
from hrclog.planning.random_plans import random_plans
from hrclog.planning.run_state import Replan
from hrclog.recorders.clock import Clock
from hrclog.recorders.dispatch.dispatcher import Dispatcher
from hrclog.recorders.dispatch.policy import DispatchPolicy
from hrclog.recorders.dispatch.run_setup import RunSetup
from hrclog.recorders.executors.protocol import Executor
from hrclog.sim.engine import ENGINES, Engine, make_engine
from hrclog.sim.event_queue import EventQueue
from hrclog.sim.scenario import Scenario
from hrclog.sim.stream import Stream
from hrclog.sim.truth import RunTruth

if TYPE_CHECKING:
    from hrclog.log.messages.encode import Signal

BASE_EPOCH_NS: Final = 1_735_689_600_000_000_000
"""When the first simulated run starts: 2025-01-01T00:00:00Z."""

_SLOT_NS: Final = 600_000_000_000
_SLACK: Final = 10


@dataclass(frozen=True, slots=True)
class Run:
    """A run as it would be in a log, and the truth about it.

    `stuck` lists the items that were left when the agents' executions could not go on, none in a sound run.
    """

    events: tuple[Event, ...]
    truth: RunTruth
    signals: tuple[Signal, ...] = ()
    stuck: tuple[PlanItem, ...] = ()

    def tagged(self, tags: Mapping[str, str]) -> Run:
        """Return the run with tags."""
        if not tags:
            return self
        events = (replace(event, tags=tags) if isinstance(event, RunStarted) else event for event in self.events)
        return replace(self, events=tuple(events))


def simulate_run(scenario: Scenario, seed: int, index: int, plan: Plan | None = None, engine: str = ENGINES[0]) -> Run:
    """Return the events and the truth of one run.

    The same arguments give the same run, whatever else is simulated before or beside it.

    Args:
        scenario: the cell.
        seed: of the campaign.
        index: number of the run in the campaign, from 0.
        plan: what to carry out; None draws the plan of that number (see `PlanSequence`).
        engine: one of `ENGINES`.

    Raises:
        ScenarioError: the plan does not fit, or the run comes to a standstill.
    """
    plan_key = () if plan is None else (json.dumps(plan.work_json(), sort_keys=True),)
    run_plan = plan_of(scenario, seed, index) if plan is None else fitting_plan(scenario, plan)
    run = carry_out(scenario, run_plan, seed, index, policy_of(scenario), engine=engine, apart=plan_key)
    if run.stuck:
        items = ", ".join(f"{item.item_id} ({item.task})" for item in run.stuck[:4])
        raise ScenarioError(f"{scenario.name}: standstill, agents stop or wait for each other at {items}")
    return run


def carry_out(
    scenario: Scenario,
    plan: Plan,
    seed: int,
    index: int,
    policy: DispatchPolicy,
    *,
    engine: str = ENGINES[0],
    others: Callable[[Clock], Mapping[str, Executor]] = lambda _: {},
    apart: tuple[str, ...] = (),
    name: str = "",
    replan: Replan | None = None,
) -> Run:
    """Return what comes of a plan in simulated time.

    Args:
        scenario: the cell.
        plan: fits the scenario, with planned times.
        seed: of the campaign.
        index: number of the run in the campaign, from 0.
        policy: how the plan is handed out.
        engine: one of `ENGINES`.
        others: makes executors that act for agents in place of the engine.
        apart: what sets the ids of this run apart from those of others with the same scenario, seed and number.
        name: of the run; default that of scenario and number.
        replan: asked for another plan when the policy says so; see `apart` for runs that differ in it.

    Raises:
        ScenarioError: the items wait for each other in a circle.
    """
    queue = EventQueue(BASE_EPOCH_NS + index * _spacing_ns(scenario))
    cell = make_engine(engine, scenario, queue, seed, index)
    executors = {**cell.executors, **others(queue)}
    new_id = _id_generator(scenario, seed, index, engine, apart, queue)
    setup = RunSetup(
        plan=plan,
        problem=scenario.problem,
        policy=policy,
        seed=seed,
        software={"engine": cell.name},
        replan=replan,
    )
    run_id, name = new_id(), name or run_name(scenario, index)
    events: list[Event] = []

    def write(event: Event) -> None:
        events.append(replace(event, run_id=run_id, seq=len(events)))

    dispatcher = Dispatcher(setup, executors, queue, run_id=run_id, emit=write, new_id=new_id, on_done=cell.stop)
    write(RunStarted(time_ns=queue.now_ns, name=name, **setup.facts()))
    if any(executors[agent] is cell_executor for agent, cell_executor in cell.executors.items()):
        cell.watch()
    dispatcher.run()
    outcome, reason = dispatcher.verdict()
    write(RunEnded(time_ns=events[-1].time_ns, outcome=outcome, reason=reason))
    signals = tuple(replace(signal, run_id=run_id) for signal in cell.signals)
    return Run(tuple(events), _truth(cell, run_id, name, outcome), signals, dispatcher.stuck)


def _id_generator(
    scenario: Scenario, seed: int, index: int, engine: str, apart: tuple[str, ...], queue: EventQueue
) -> Uuid7Generator:
    other_engine = () if engine == ENGINES[0] else (engine, scenario.cell_digest)
    # runs of different scenarios and plans start at the same instants and may be analysed together
    stream = Stream(seed, index, "ids", scenario.name, scenario.digest, *other_engine, *apart)
    return Uuid7Generator(lambda: queue.now_ns, stream.bits)


def _truth(cell: Engine, run_id: str, name: str, outcome: str) -> RunTruth:
    failed = "" if outcome == Outcome.SUCCEEDED else outcome
    return RunTruth(run_id, name, tuple(cell.truth), tuple(cell.pairs), cell.contacts, failed)


def policy_of(scenario: Scenario) -> DispatchPolicy:
    """Return how a scenario wants its plans handed out; facts come from the plan alone, so none is waited for."""
    failures = scenario.failures
    return DispatchPolicy(
        mode=scenario.dispatch_mode,
        max_attempts=failures.max_attempts,
        on_failure=failures.on_failure,
        max_wait_s=0.0,
    )


def run_id_of(scenario: Scenario, seed: int, index: int, engine: str = ENGINES[0]) -> str:
    """Return the id of a run of a campaign, which depends on all that the scenario says."""
    queue = EventQueue(BASE_EPOCH_NS + index * _spacing_ns(scenario))
    return _id_generator(scenario, seed, index, engine, (), queue)()


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
        self._random_plans: Iterator[Plan] = random_plans(scenario.problem, seed)
        self._plans: list[Plan] = []
        self._round: tuple[int, list[int]] = (0, [])

    def __getitem__(self, index: int) -> Plan:
        for plan in itertools.islice(self._random_plans, max(index + 1 - len(self._plans), 0)):
            self._plans.append(_with_problem(self._scenario, _with_times(self._scenario, plan)))
        if index < len(self._plans):
            return self._plans[index]
        number, place = divmod(index, len(self._plans))
        if self._round[0] != number:
            stream = Stream(self._seed, "round", number)
            chances = [stream.uniform() for _ in self._plans]
            self._round = (number, sorted(range(len(chances)), key=chances.__getitem__))
        return self._plans[self._round[1][place]]


def plan_of(scenario: Scenario, seed: int, index: int) -> Plan:
    """Return the plan that a run of a campaign carries out."""
    return _plan_sequence(scenario, seed)[index]


@lru_cache(maxsize=4)
def _plan_sequence(scenario: Scenario, seed: int) -> PlanSequence:
    return PlanSequence(scenario, seed)


def fitting_plan(scenario: Scenario, plan: Plan) -> Plan:
    """Return a plan with planned times.

    Raises:
        ScenarioError: the plan does not solve the scenario's problem.
    """
    check_plan(scenario.problem, plan)
    timed = plan if all(item.planned_start_s is not None for item in plan.items) else _with_times(scenario, plan)
    return _with_problem(scenario, timed)


def _with_times(scenario: Scenario, plan: Plan) -> Plan:
    gaps_s = {agent: gap.mean_s for agent, gap in scenario.gap.items()}
    return with_planned_times(plan, scenario.durations_s, gaps_s)


def _with_problem(scenario: Scenario, plan: Plan) -> Plan:
    """Return a plan that names its problem."""
    return plan if plan.problem else replace(plan, problem=made_for(scenario.name, scenario.problem))


def _spacing_ns(scenario: Scenario) -> int:
    """Return the time between the starts of two runs: generous, so that runs do not share an instant."""
    longest_s = max(scenario.durations_s.values()) + max((gap.mean_s for gap in scenario.gap.values()), default=0.0)
    total = sum(count.count for count in scenario.problem.counts)
    released_s = max(task.release_s for task in scenario.problem.tasks)
    return _SLOT_NS * math.ceil((_SLACK * longest_s * total + released_s) * 1e9 / _SLOT_NS)
