"""The options of verbs that simulate: which engine, what guards the human, how often signals are sampled."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import click

from hrclog.sim.cell.description import LOOKS_HZ
from hrclog.sim.cell.safety_settings import POLICIES
from hrclog.sim.engine import ENGINE_RECORDS, ENGINES

if TYPE_CHECKING:
    from hrclog.sim.scenario import Scenario

engine_option = click.option(
    "--engine",
    type=click.Choice(ENGINES),
    default=ENGINES[0],
    show_default=True,
    help="; ".join(f"{record.name}: {record.summary}" for record in ENGINE_RECORDS) + ".",
)

safety_option = click.option(
    "--safety",
    type=click.Choice(list(POLICIES)),
    metavar="POLICY",
    help=f"With --engine bullet, what guards the human: {', '.join(POLICIES)}.  [default: as the scenario says]",
)

signals_option = click.option(
    "--signals-hz",
    type=click.FloatRange(min=0.0, max=LOOKS_HZ),
    metavar="HZ",
    help=f"With --engine bullet, how often joints and distances are logged, 0 never.  [default: {LOOKS_HZ:g}]",
)


def chosen_scenario(name: str, engine: str, safety: str | None, signals_hz: float | None) -> Scenario:
    """Return a scenario with what the options say of its cell.

    Raises:
        click.UsageError: an option that only the other engine knows.
        ScenarioError: there is no such scenario, or it has no cell.
    """
    from hrclog.sim.scenario import load_scenario

    for option, value in (("--safety", safety), ("--signals-hz", signals_hz)):
        if value is not None and engine != "bullet":
            raise click.UsageError(f"{option} goes with --engine bullet; in the engine {engine!r} nobody moves")
    if signals_hz is not None and not math.isfinite(signals_hz):
        raise click.UsageError(f"--signals-hz: found {signals_hz}, expected a number from 0 to {LOOKS_HZ:g}")
    scenario = load_scenario(name)
    if safety is not None or signals_hz is not None:
        from hrclog.sim.bullet.engine import with_policy, with_signals

        scenario = scenario if safety is None else with_policy(scenario, safety)
        scenario = scenario if signals_hz is None else with_signals(scenario, signals_hz)
    return scenario
