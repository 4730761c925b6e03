"""`hrclog run`: carry a plan out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from hrclog.cli.cell_options import chosen_scenario, engine_option, safety_option, signals_option
from hrclog.cli.common import EXIT_DATA_LOST, EXIT_FINE, json_option, print_json, printable
from hrclog.cli.on_run_end import Following, on_run_end_option
from hrclog.cli.replan_options import chosen_replan, replan_options
from hrclog.sim.engine import ENGINES

if TYPE_CHECKING:
    from hrclog.events import Event, TaskEnded
    from hrclog.planning.plan import Plan
    from hrclog.planning.run_state import Replan
    from hrclog.recorders.clock import Clock
    from hrclog.recorders.dispatch.policy import DispatchPolicy
    from hrclog.recorders.executors.protocol import Executor
    from hrclog.sim.scenario import Scenario

EXIT_INTERRUPTED: Final = 130

_SIMULATED = "simulated"


@click.command("run", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("plan_path", metavar="PLAN", type=click.Path(path_type=Path))
@click.option(
    "--scenario",
    default="paper",
    show_default=True,
    metavar="NAME|FILE",
    help="The tasks that the plan is checked against, and the cell of simulated agents.",
)
@engine_option
@safety_option
@signals_option
@click.option(
    "--agent",
    "agents",
    multiple=True,
    metavar="AGENT=HOW",
    help="simulated, replay:LOG or scripted:FILE; may be given for each agent.  [default: simulated]",
)
@click.option(
    "--mode",
    type=click.Choice(["sequential", "timed", "synchronous", "asynchronous", "reactive"]),
    help="How items are handed out.  [default: the scenario's]",
)
@click.option("--seed", type=int, default=1, show_default=True, help="Of the simulated agents.")
@click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="S",
    help="Cancel an attempt that takes longer; an item's own timeout_s wins.  [default: never]",
)
@click.option(
    "--max-attempts",
    type=click.IntRange(min=1),
    metavar="N",
    help="Try an item up to N times.  [default: the scenario's]",
)
@click.option(
    "--on-failure",
    type=click.Choice(["skip", "abort"]),
    help="Go on without an item that failed for good, or end the run.  [default: the scenario's]",
)
@replan_options
@click.option("--real-time", is_flag=True, help="Go by the wall clock, and record each event as it happens.")
@click.option(
    "-o",
    "--output",
    "out",
    metavar="LOG",
    type=click.Path(dir_okay=False, path_type=Path),
    required=True,
    help="The log to be; it is not overwritten.",
)
@on_run_end_option
@json_option
def command(
    *,
    plan_path: Path,
    scenario: str,
    engine: str,
    safety: str | None,
    signals_hz: float | None,
    agents: tuple[str, ...],
    mode: str | None,
    seed: int,
    timeout_s: float | None,
    max_attempts: int | None,
    on_failure: str | None,
    kb: str | None,
    replan_on: tuple[str, ...],
    delay_s: float | None,
    real_time: bool,
    out: Path,
    knowledge: str | None,
    as_json: bool,
) -> int:
    """Carry a plan out with simulated, replayed or scripted agents, and write the log.

    Simulated time unless --real-time is given. Exits with 3 if the run came to its end but an item did not succeed.
    With --replan-on the plan may change on the way; the log says when and why.

    \b
    Example:
      hrclog plan paper --random 1 -o plans
      hrclog run plans/plan-001.json --mode synchronous -o run.mcap
    """
    from dataclasses import replace

    from hrclog.errors import LogExistsError
    from hrclog.log.writer import write_log
    from hrclog.planning.plan import read_plan
    from hrclog.recorders.recorder import log_path
    from hrclog.sim.run import carry_out, fitting_plan, policy_of

    if real_time and engine != ENGINES[0]:
        raise click.UsageError(f"--real-time goes with --engine {ENGINES[0]}, not with {engine}")
    cell = chosen_scenario(scenario, engine, safety, signals_hz)
    plan = fitting_plan(cell, read_plan(plan_path))
    usual = policy_of(cell)
    policy = replace(
        usual,
        mode=mode or usual.mode,
        max_attempts=max_attempts or usual.max_attempts,
        on_failure=on_failure or usual.on_failure,
        timeout_s=timeout_s,
        replan_on=replan_on,
        delay_s=delay_s or usual.delay_s,
    )
    replan = chosen_replan(cell.problem, kb, replan_on)
    how = _ways(agents, cell)
    path = log_path(out)
    if path.exists():
        raise LogExistsError(path, "choose another name with -o")
    if real_time:
        events, outcome, reason = _live(path, plan, cell, how, policy, seed, engine, replan)
    else:
        run = carry_out(
            cell,
            plan,
            seed,
            0,
            policy,
            engine=engine,
            others=lambda clock: _executors(how, clock),
            apart=(str(plan.to_json()), str(policy), *agents, *((kb or "",) if replan_on else ())),
            name=path.stem,
            replan=replan,
        )
        write_log(path, run.events, run.signals)
        events = run.events
        outcome, reason = _verdict(events[-1])
    code = _tell(path, _in_force(plan, events), _last_ends(events), outcome, reason, as_json=as_json)
    with Following(knowledge) as following:
        following.take([path])
        behind = following.catch_up(str(path))
    return code or behind


def _ways(agents: Sequence[str], cell: Scenario) -> dict[str, tuple[str, Path]]:
    """Return how each agent that is not simulated acts, and by which file."""
    found: dict[str, tuple[str, Path]] = {}
    for text in agents:
        agent, equals, way = text.partition("=")
        kind, colon, file = way.partition(":")
        if agent not in cell.problem.agents:
            known = ", ".join(cell.problem.agents)
            raise click.BadParameter(f"--agent {text}: agent {agent!r} is unknown; the agents are {known}")
        if not equals or (way != _SIMULATED and not (kind in ("replay", "scripted") and colon and file)):
            raise click.BadParameter(
                f"--agent {text}: expected AGENT=simulated, AGENT=replay:LOG or AGENT=scripted:FILE"
            )
        if way != _SIMULATED:
            found[agent] = (kind, Path(file))
    return found


def _executors(how: Mapping[str, tuple[str, Path]], clock: Clock) -> dict[str, Executor]:
    """Return the executors that files describe; agents of one file share one."""
    from hrclog.errors import DispatchError
    from hrclog.recorders.executors.replay import ReplayExecutor, read_recorded
    from hrclog.recorders.executors.scripted import ScriptedExecutor, read_script

    made: dict[str, Executor] = {}
    for kind, path in dict.fromkeys(how.values()):
        agents = [agent for agent, way in how.items() if way == (kind, path)]
        executor: Executor
        if kind == "replay":
            executor = ReplayExecutor(read_recorded(path), clock, agents)
        else:
            executor = ScriptedExecutor(read_script(path), clock)
        for agent in agents:
            if agent not in executor.agents:
                found = f"found steps of {', '.join(executor.agents)}, none of {agent!r}"
                raise DispatchError(f"{path}: {found}; add some")
            made[agent] = executor
    return made


def _live(
    path: Path,
    plan: Plan,
    cell: Scenario,
    how: Mapping[str, tuple[str, Path]],
    policy: DispatchPolicy,
    seed: int,
    engine: str,
    replan: Replan | None,
) -> tuple[Sequence[Event], str, str]:
    from hrclog.recorders.dispatch.live_run import run_live
    from hrclog.recorders.dispatch.real_time import RealTimeLoop
    from hrclog.sim.engine import make_engine

    loop = RealTimeLoop()
    simulated = make_engine(engine, cell, loop, seed, 0)
    executors = {**simulated.executors, **_executors(how, loop)}
    events: list[Event] = []

    def note(event: Event) -> None:
        events.append(event)
        _show(event)

    all_others = set(how) >= set(cell.problem.agents)
    outcome, reason = run_live(
        path,
        plan,
        cell.problem,
        executors,
        loop,
        policy,
        seed=seed,
        on_event=note,
        on_start=(lambda: None) if all_others else simulated.watch,
        replan=replan,
    )
    return events, outcome, reason


def _show(event: Event) -> None:
    from hrclog.events import TaskEnded, TaskStarted

    if isinstance(event, TaskStarted):
        click.echo(printable(f"{event.agent}: {event.task} ({event.item_id}) started"), err=True)
    elif isinstance(event, TaskEnded):
        click.echo(printable(f"{event.agent}: {event.task} ({event.item_id}) {event.outcome}"), err=True)


def _in_force(plan: Plan, events: Sequence[Event]) -> Plan:
    """Return the plan that was followed in the end."""
    from hrclog.events import PlanChanged
    from hrclog.planning.plan import plan_of_value

    for event in events:
        if isinstance(event, PlanChanged):
            plan = plan_of_value(event.plan, "plan_changed")
    return plan


def _last_ends(events: Sequence[Event]) -> dict[str, TaskEnded]:
    """Return how each item ended in its last attempt."""
    from hrclog.events import TaskEnded

    return {event.item_id: event for event in events if isinstance(event, TaskEnded)}


def _verdict(last: Event) -> tuple[str, str]:
    from hrclog.events import RunEnded

    return (last.outcome, last.reason) if isinstance(last, RunEnded) else ("", "")


def _tell(path: Path, plan: Plan, ends: Mapping[str, TaskEnded], outcome: str, reason: str, *, as_json: bool) -> int:
    """Say what became of the plan, and return the exit code."""
    outcomes = {item.item_id: ends[item.item_id].outcome if item.item_id in ends else "" for item in plan.items}
    n_done = sum(found == "succeeded" for found in outcomes.values())
    if as_json:
        items = {
            item.item_id: {
                "agent": item.agent,
                "task": item.task,
                "outcome": outcomes[item.item_id] or None,
                "reason": ends[item.item_id].reason if item.item_id in ends else "",
                "attempts": ends[item.item_id].attempt if item.item_id in ends else 0,
            }
            for item in plan.items
        }
        print_json({"path": str(path), "outcome": outcome, "reason": reason, "items": items})
    else:
        click.echo(f"{plan.name}: {n_done} of {len(plan.items)} items succeeded, log in {path}")
    for item in plan.items:
        if outcomes[item.item_id] != "succeeded":
            said = f": {ends[item.item_id].reason}" if item.item_id in ends and ends[item.item_id].reason else ""
            found = outcomes[item.item_id] or "not begun"
            click.echo(printable(f"{item.item_id} ({item.task}) {found}{said}"), err=True)
    if outcome == "succeeded":
        return EXIT_FINE
    click.echo(printable(f"the run {outcome}: {reason}"), err=True)
    return EXIT_INTERRUPTED if outcome == "canceled" else EXIT_DATA_LOST
