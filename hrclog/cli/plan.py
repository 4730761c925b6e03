"""`hrclog plan`: plans as files."""

from __future__ import annotations

from pathlib import Path

import click

from hrclog.cli.common import json_option, print_json


@click.command("plan", context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--scenario", default="paper", show_default=True, metavar="NAME|FILE", help="What is to be planned.")
@click.option(
    "--random", "count", type=click.IntRange(min=1), required=True, metavar="N", help="Draw N different plans."
)
@click.option("--seed", type=int, default=1, show_default=True, help="The same seed gives the same plans.")
@click.option(
    "-o",
    "--output",
    "out_dir",
    type=click.Path(file_okay=False, path_type=Path),
    required=True,
    help="Folder for the plans; nothing in it is overwritten.",
)
@json_option
def command(scenario: str, count: int, seed: int, out_dir: Path, as_json: bool) -> int:  # noqa: FBT001 - click passes flags by name
    """Draw random plans of a scenario and write one file each, plan-001.json and so on.

    \b
    Example:
      hrclog plan --scenario paper --random 10 --seed 1 -o plans
      hrclog run plans/plan-001.json -o first.mcap
    """  # noqa: D301 - click's \b keeps the line breaks
    from hrclog.errors import LogExistsError, OutputError
    from hrclog.plan import write_plan
    from hrclog.random_plans import distinct_plans
    from hrclog.sim.run import fitting_plan
    from hrclog.sim.scenario import load_scenario

    cell = load_scenario(scenario)
    plans = [fitting_plan(cell, plan) for plan in distinct_plans(cell.problem, count, seed)]
    paths = [out_dir / f"{plan.name}.json" for plan in plans]
    for path in paths:
        if path.exists():
            raise LogExistsError(path, "choose an empty folder with -o")
    try:
        out_dir.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(out_dir, f"cannot be made ({error.strerror})") from error
    for path, plan in zip(paths, plans, strict=True):
        write_plan(path, plan)
    if as_json:
        print_json({"scenario": cell.name, "seed": seed, "plans": [str(path) for path in paths]})
    else:
        click.echo(f"{len(paths)} plans of {cell.name}: {paths[0]} .. {paths[-1].name}")
    return 0
