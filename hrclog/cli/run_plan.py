"""A plan made ready by the options of `hrclog run`, and executed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import click

from hrclog.cli.cell_options import chosen_scenario
from hrclog.cli.common import echo
from hrclog.cli.problem_file import scenario_of_plan
from hrclog.cli.replan_options import chosen_replan
from hrclog.cli.run_options import RunOptions
from hrclog.errors import DispatchError
from hrclog.events import Event, PlanChanged, RunEnded, TaskEnded, TaskStarted
from hrclog.log.writing.writer import write_log
from hrclog.planning.plan import Plan, plan_of_value, read_plan
from hrclog.planning.provenance import made_for
from hrclog.planning.run_state import Replan
from hrclog.recorders.clock import Clock
from hrclog.recorders.dispatch.live_run import run_live
from hrclog.recorders.dispatch.policy import DispatchPolicy
from hrclog.recorders.dispatch.real_time import RealTimeLoop
from hrclog.recorders.dispatch.run_setup import RunSetup
from hrclog.recorders.executors.protocol import Executor
from hrclog.recorders.executors.replay import ReplayExecutor, read_recorded
from hrclog.recorders.executors.scripted import ScriptedExecutor, read_script
from hrclog.sim.engine import make_engine
from hrclog.sim.run import carry_out, fitting_plan, policy_of
from hrclog.sim.scenario import Scenario

_SIMULATED: Final = "simulated"


@dataclass(frozen=True, slots=True)
class Prepared:
    """A plan that can be executed.

    Attributes:
        plan: with planned times.
        scenario: the cell.
        policy: how items are handed out.
        ways: how each agent that is not simulated acts (replay, scripted), and by which file.
        replan: what plans the rest of a run, if anything does.
    """

    plan: Plan
    scenario: Scenario
    policy: DispatchPolicy
    ways: Mapping[str, tuple[str, Path]]
    replan: Replan | None


@dataclass(frozen=True, slots=True)
class Done:
    """A plan that was executed.

    Attributes:
        path: of the log.
        plan: as it was given.
        followed: the one that was followed in the end.
        events: of the run.
        outcome: of the run.
        reason: why.
        mode: in which items were handed out.
    """

    path: Path
    plan: Plan
    followed: Plan
    events: Sequence[Event]
    outcome: str
    reason: str
    mode: str


def prepare(plan_path: Path, options: RunOptions) -> Prepared:
    """Read a plan and what it needs.

    Raises:
        ScenarioError: the plan cannot be read, its problem is gone or has changed, or it does not fit the scenario.
        HrclogError: an option does not fit.
    """
    plan = read_plan(plan_path)
    name = options.scenario or scenario_of_plan(plan, plan_path)
    scenario = chosen_scenario(name, options.engine, options.safety, options.signals_hz)
    if options.scenario:
        plan = replace(plan, problem=made_for(options.scenario, scenario.problem))
    fitting = fitting_plan(scenario, plan)
    default = policy_of(scenario)
    policy = replace(
        default,
        mode=options.mode or default.mode,
        max_attempts=options.max_attempts or default.max_attempts,
        on_failure=options.on_failure or default.on_failure,
        timeout_s=options.timeout_s,
        timeout_factor=None if options.no_timeout else default.timeout_factor,
        call_timeout_s=None if options.no_timeout else default.call_timeout_s,
        replan_on=options.replan_on,
        delay_s=options.delay_s or default.delay_s,
    )
    replan = chosen_replan(scenario.problem, options.kb, options.replan_on)
    return Prepared(fitting, scenario, policy, _executor_files(options.agents, scenario), replan)


def execute(prepared: Prepared, options: RunOptions, path: Path, number: int, *, series: bool = False) -> Done:
    """Execute a plan and write its log.

    Args:
        prepared: the plan and its cell.
        options: of the command.
        path: of the log.
        number: of the repetition, from 0; simulated agents act differently in each.
        series: whether it is one of several: then its ids depend on the log's name, so that equal plans do not share
            them.
    """
    if options.real_time:
        events, outcome, reason = _execute_live(prepared, options, path, number)
    else:
        events = _execute_simulated(prepared, options, path, number, (path.stem,) if series else ())
        last = events[-1]
        outcome, reason = (last.outcome, last.reason) if isinstance(last, RunEnded) else ("", "")
    followed = _final_plan(prepared.plan, events)
    return Done(path, prepared.plan, followed, events, outcome, reason, str(prepared.policy.mode))


def _execute_simulated(
    prepared: Prepared, options: RunOptions, path: Path, number: int, name: tuple[str, ...]
) -> Sequence[Event]:
    knowledge = (options.kb or "",) if options.replan_on else ()
    run = carry_out(
        prepared.scenario,
        prepared.plan,
        options.seed,
        number,
        prepared.policy,
        engine=options.engine,
        others=lambda clock: _executors(prepared.ways, clock),
        apart=(str(prepared.plan.work_json()), str(prepared.policy), *options.agents, *knowledge, *name),
        name=path.stem,
        replan=prepared.replan,
    )
    run = run.tagged(options.tags)
    write_log(path, run.events, run.signals)
    return run.events


def _execute_live(prepared: Prepared, options: RunOptions, path: Path, number: int) -> tuple[Sequence[Event], str, str]:
    loop = RealTimeLoop()
    cell = make_engine(options.engine, prepared.scenario, loop, options.seed, number)
    events: list[Event] = []

    def note(event: Event) -> None:
        events.append(event)
        _print_event(event)

    setup = RunSetup(
        plan=prepared.plan,
        problem=prepared.scenario.problem,
        policy=prepared.policy,
        seed=options.seed,
        software={"engine": cell.name},
        replan=prepared.replan,
        tags=options.tags,
    )
    nobody_simulated = set(prepared.ways) >= set(prepared.scenario.problem.agents)
    outcome, reason = run_live(
        path,
        setup,
        {**cell.executors, **_executors(prepared.ways, loop)},
        loop,
        on_event=note,
        on_start=(lambda: None) if nobody_simulated else cell.watch,
    )
    return events, outcome, reason


def _print_event(event: Event) -> None:
    if isinstance(event, TaskStarted):
        echo(f"{event.agent}: {event.task} ({event.item_id}) started", err=True)
    elif isinstance(event, TaskEnded):
        echo(f"{event.agent}: {event.task} ({event.item_id}) {event.outcome}", err=True)


def _executor_files(agents: Sequence[str], scenario: Scenario) -> dict[str, tuple[str, Path]]:
    """Return kind and file of the executor of each agent that is not simulated."""
    ways: dict[str, tuple[str, Path]] = {}
    for text in agents:
        agent, equals, way = text.partition("=")
        kind, colon, file = way.partition(":")
        if agent not in scenario.problem.agents:
            known = ", ".join(scenario.problem.agents)
            raise click.BadParameter(f"--agent {text}: agent {agent!r} is unknown; the agents are {known}")
        if not equals or (way != _SIMULATED and not (kind in ("replay", "scripted") and colon and file)):
            raise click.BadParameter(
                f"--agent {text}: expected AGENT=simulated, AGENT=replay:LOG or AGENT=scripted:FILE"
            )
        if way != _SIMULATED:
            ways[agent] = (kind, Path(file))
    return ways


def _executors(ways: Mapping[str, tuple[str, Path]], clock: Clock) -> dict[str, Executor]:
    """Return the executors that files describe; agents of one file share one."""
    executors: dict[str, Executor] = {}
    for kind, path in dict.fromkeys(ways.values()):
        agents = [agent for agent, way in ways.items() if way == (kind, path)]
        executor: Executor
        if kind == "replay":
            executor = ReplayExecutor(read_recorded(path), clock, agents)
        else:
            executor = ScriptedExecutor(read_script(path), clock)
        for agent in agents:
            if agent not in executor.agents:
                steps = f"found steps of {', '.join(executor.agents)}, none of {agent!r}"
                raise DispatchError(f"{path}: {steps}; add some")
            executors[agent] = executor
    return executors


def _final_plan(plan: Plan, events: Sequence[Event]) -> Plan:
    """Return the plan that was followed in the end."""
    for event in events:
        if isinstance(event, PlanChanged):
            plan = plan_of_value(event.plan, "plan_changed")
    return plan
