"""`hrclog sim`: simulate runs of a cell and write their logs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from hrclog.cli.cell_options import chosen_scenario, engine_option, safety_option, signals_option
from hrclog.cli.common import Progress, echo, json_option, print_json
from hrclog.cli.on_run_end import Following, on_run_end_option
from hrclog.cli.tag_option import tag_option
from hrclog.sim.scenario import scenario_names
from hrclog.wording import agree, counted, share


@click.command(
    "sim",
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog=f"\b\nScenarios: {', '.join(scenario_names())}",  # \b: names are not broken at their hyphens
)
@click.option(
    "--scenario",
    default="paper",
    show_default=True,
    metavar="NAME|FILE",
    help="One of those below, or a JSON file.",
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
@engine_option
@safety_option
@signals_option
@click.option("--workers", type=click.IntRange(min=1), default=1, show_default=True, help="Processes to use.")
@tag_option
@on_run_end_option
@json_option
def command(
    scenario: str,
    runs: int,
    seed: int,
    out_dir: Path,
    engine: str,
    safety: str | None,
    signals_hz: float | None,
    workers: int,
    tags: dict[str, str],
    knowledge: str | None,
    as_json: bool,
) -> int:
    """Simulate runs of a cell and write one log each, with the truth beside them.

    Each run executes a different random plan of the scenario. The true synergies and the work of every execution go to
    truth.json, which no estimator reads. Run the same command again to continue a campaign that was killed, or with
    more --runs to extend a finished one.

    \b
    Example:
      hrclog sim --scenario paper --runs 50 --seed 1 -o simulated
      hrclog analyze simulated/*.mcap
    """
    from hrclog.sim.campaign import simulate_campaign
    from hrclog.sim.truth import TRUTH_FILE

    cell = chosen_scenario(scenario, engine, safety, signals_hz)
    simulating = Progress("simulating", runs)

    def resuming(count: int) -> None:
        echo(f"resuming: {share(count, runs, 'run')} {agree(count, 'is', 'are')} there", err=True)
        simulating.advance(count)

    with Following(knowledge) as following:
        try:
            paths = simulate_campaign(
                cell, runs, seed, out_dir, workers, simulating.advance, engine, resuming, following.take, tags=tags
            )
        finally:
            simulating.done()
            code = following.catch_up(str(out_dir))
    truth = out_dir / TRUTH_FILE
    moving = cell.cell if engine == "bullet" else None
    result: dict[str, Any] = {
        "scenario": cell.name,
        "engine": engine,
        "safety": moving.safety.policy if moving else None,
        "seed": seed,
        "logs": [str(path) for path in paths],
        "truth": str(truth),
        "failed_runs": _failed(truth),
        "contacts": _contacts(truth) if moving else None,
    }
    if as_json:
        print_json(result)
    else:
        for line in _lines(result, out_dir):
            echo(line)
    return code


def _lines(result: dict[str, Any], out_dir: Path) -> Iterator[str]:
    logs = result["logs"]
    runs = counted(len(logs), "run")
    names = logs[0] if len(logs) == 1 else f"{logs[0]} .. {Path(logs[-1]).name}"
    yield f"{runs} of {result['scenario']}: {names}, truth in {result['truth']}"
    if result["failed_runs"]:
        yield f"runs in which something did not succeed: {result['failed_runs']} of {len(logs)}"
    if result["contacts"] is not None:
        yield f"contacts while moving: {result['contacts']} in {runs}"
    yield f"Look at it: hrclog view {out_dir}"


def _failed(truth: Path) -> int:
    from hrclog.sim.truth import read_truth

    return sum(bool(run.outcome) for run in read_truth(truth).runs)


def _contacts(truth: Path) -> int:
    from hrclog.sim.truth import read_truth

    return sum(run.contacts or 0 for run in read_truth(truth).runs)
