"""`hrclog sim`: simulate runs of a cell and write their logs."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import click


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
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of text.")
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
    with _late_bar(runs, "simulating") as update:
        paths = simulate_campaign(cell, runs, seed, out_dir, workers, update)
    truth = out_dir / TRUTH_FILE
    if as_json:
        result = {
            "scenario": cell.name,
            "engine": engine,
            "seed": seed,
            "logs": [str(path) for path in paths],
            "truth": str(truth),
        }
        click.echo(json.dumps(result, ensure_ascii=False))
    else:
        click.echo(f"{len(paths)} runs of {cell.name}: {paths[0]} .. {paths[-1].name}, truth in {truth}")
    return 0


@contextmanager
def _late_bar(total: int, label: str) -> Iterator[Callable[[int], None]]:
    """Give a function that moves a progress bar, which shows once it has taken a second."""
    started, done = time.monotonic(), 0
    update: Callable[[int], None] | None = None
    with ExitStack() as stack:

        def advance(count: int) -> None:
            nonlocal done, update
            done += count
            if update is not None:
                update(count)
            elif time.monotonic() - started > 1.0:
                update = stack.enter_context(click.progressbar(length=total, label=label, file=sys.stderr)).update
                update(done)

        yield advance
