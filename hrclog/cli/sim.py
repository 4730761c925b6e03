"""`hrclog sim`: simulate runs of a cell and write their logs."""

from __future__ import annotations

from pathlib import Path

import click

from hrclog.cli.common import Progress, json_option, print_json


@click.command("sim", context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--scenario",
    default="paper",
    show_default=True,
    metavar="NAME|FILE",
    help="paper, failures, three-agents, machine-tending, or a JSON file.",
)
@click.option("--runs", type=click.IntRange(min=1), default=50, show_default=True, help="How many runs.")
@click.option("--seed", type=int, default=1, show_default=True, help="The same seed gives the same bytes.")
@click.option(
    "-o",
    "--output",
    "out_dir",
    type=click.Path(file_okay=False, path_type=Path),
    required=True,
    help="Folder for the logs; nothing in it is overwritten.",
)
@click.option(
    "--engine",
    type=click.Choice(["events"]),
    default="events",
    show_default=True,
    help="events: discrete events with known true synergies.",
)
@click.option("--workers", type=click.IntRange(min=1), default=1, show_default=True, help="Processes to use.")
@json_option
def command(
    scenario: str,
    runs: int,
    seed: int,
    out_dir: Path,
    engine: str,
    workers: int,
    as_json: bool,  # noqa: FBT001 - click passes flags by name
) -> int:
    """Simulate runs of a cell and write one log each, with the truth beside them.

    Every run carries out another random plan of the scenario. The true rates and the work of every execution go to
    truth.json, which no estimator reads.

    \b
    Example:
      hrclog sim --scenario paper --runs 50 --seed 1 -o simulated
      hrclog analyze simulated/*.mcap
    """  # noqa: D301 - click's \b keeps the line breaks
    from hrclog.sim.campaign import simulate_campaign
    from hrclog.sim.scenario import load_scenario
    from hrclog.sim.truth import TRUTH_FILE

    cell = load_scenario(scenario)
    simulating = Progress("simulating", runs)
    paths = simulate_campaign(cell, runs, seed, out_dir, workers, simulating.advance)
    simulating.done()
    truth = out_dir / TRUTH_FILE
    if as_json:
        result = {
            "scenario": cell.name,
            "engine": engine,
            "seed": seed,
            "logs": [str(path) for path in paths],
            "truth": str(truth),
        }
        print_json(result)
    else:
        click.echo(f"{len(paths)} runs of {cell.name}: {paths[0]} .. {paths[-1].name}, truth in {truth}")
    return 0
