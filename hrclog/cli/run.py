"""`hrclog run`: execute plans."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hrclog.cli.cell_options import engine_option, safety_option, signals_option
from hrclog.cli.common import EXIT_DATA_LOST, EXIT_FAILED, echo, echo_lines, json_option, print_json
from hrclog.cli.on_run_end import Following, on_run_end_option
from hrclog.cli.replan_options import replan_options
from hrclog.cli.run_options import RunOptions
from hrclog.cli.tag_option import tag_option
from hrclog.planning.dispatch_mode import MODES
from hrclog.recorders.dispatch.policy import OnFailure
from hrclog.sim.engine import ENGINES

if TYPE_CHECKING:
    from hrclog.cli.run_plan import Done, Prepared


@click.command("run", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("plan_paths", metavar="PLAN...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--scenario",
    metavar="NAME|FILE",
    help="The tasks that plans are checked against, and the cell of simulated agents.  [default: the plan's own]",
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
    type=click.Choice(list(MODES)),
    help="How items are handed out.  [default: the scenario's]",
)
@click.option("--seed", type=int, default=1, show_default=True, help="Seed of the simulated agents.")
@click.option(
    "--repeat",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    metavar="N",
    help="Execute each plan N times; simulated agents act differently each time.",
)
@click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="S",
    help="Cancel an attempt that takes longer; an item's own timeout_s wins.  "
    "[default: with --real-time ten times what is expected]",
)
@click.option("--no-timeout", is_flag=True, help="No limit but those of the plan's items and of --timeout.")
@click.option(
    "--max-attempts",
    type=click.IntRange(min=1),
    metavar="N",
    help="Try an item up to N times.  [default: the scenario's]",
)
@click.option(
    "--on-failure",
    type=click.Choice([str(choice) for choice in OnFailure]),
    help="Go on without an item that failed for good, or end the run.  [default: the scenario's]",
)
@replan_options
@click.option("--real-time", is_flag=True, help="Run on the wall clock and record each event as it happens.")
@click.option(
    "-o",
    "--output",
    "out",
    metavar="LOG|DIR",
    type=click.Path(path_type=Path),
    required=True,
    help="The log to be, or with several plans or --repeat its folder; nothing is overwritten.",
)
@tag_option
@on_run_end_option
@json_option
def command(
    *, plan_paths: tuple[Path, ...], repeat: int, out: Path, knowledge: str | None, as_json: bool, **options: Any
) -> int:
    """Execute plans with simulated, replayed or scripted agents, and write their logs.

    A plan knows which scenario it was made for. Simulated time unless --real-time is given. Exits with 3 if a run came
    to its end but an item did not succeed. With --replan-on the plan may change on the way; the log says when and why.

    \b
    Example:
      hrclog plan paper --random 2 -o plans
      hrclog run plans/plan-001.json --mode synchronous -o run.mcap
      hrclog run plans/*.json --repeat 5 -o runs
    """
    settings = RunOptions(**options)
    if settings.real_time and settings.engine != ENGINES[0]:
        raise click.UsageError(f"--real-time goes with --engine {ENGINES[0]}, not with {settings.engine}")
    with Following(knowledge) as following:
        if len(plan_paths) == 1 and repeat == 1:
            code = _execute_one(plan_paths[0], out, settings, following, as_json=as_json)
        else:
            code = _execute_several(plan_paths, repeat, out, settings, following, as_json=as_json)
        knowledge_code = following.catch_up(str(out))
    return code or knowledge_code


def _execute_one(plan_path: Path, out: Path, settings: RunOptions, following: Following, *, as_json: bool) -> int:
    from hrclog.cli.run_plan import execute, prepare
    from hrclog.cli.run_text import exit_code, run_json, run_text, troubles
    from hrclog.recorders.recorder import log_path

    if out.is_dir():
        raise click.UsageError(
            f"-o: {out} is a folder; name the log of a single run, or give several plans or --repeat"
        )
    prepared, path = prepare(plan_path, settings), log_path(out)
    _check_new([path], "choose another name with -o")
    done = execute(prepared, settings, path, 0)
    following.take([path])
    if as_json:
        print_json(run_json(done))
    else:
        for line in run_text(done):
            echo(line)
    for line in troubles(done):
        echo(line, err=True)
    return exit_code(done)


def _execute_several(
    plan_paths: Sequence[Path], repeat: int, out: Path, settings: RunOptions, following: Following, *, as_json: bool
) -> int:
    """Execute several plans, or one plan several times; an error in one does not stop the others."""
    from hrclog.cli.run_plan import execute
    from hrclog.cli.run_text import INTERRUPTED, exit_code, plan_json, plan_text, troubles
    from hrclog.errors import HrclogError

    logs = _log_paths(plan_paths, repeat, out)
    prepared, code = _prepare_plans(plan_paths, settings)
    documents: list[dict[str, Any]] = []
    for plan_path, plan in prepared.items():
        runs: list[Done] = []
        for number, path in enumerate(logs[plan_path]):
            try:
                runs.append(execute(plan, settings, path, number, series=True))
            except HrclogError as error:
                echo_lines(f"hrclog: error: {path}: {error}", err=True)
                code = max(code, EXIT_DATA_LOST)
                break
            following.take([path])
            for line in troubles(runs[-1]):
                echo(f"{path}: {line}", err=True)
            code = max(code, exit_code(runs[-1]))
            if code == INTERRUPTED:
                break
        documents.append(plan_json(plan.plan, runs))
        if not as_json:
            echo(plan_text(plan.plan, runs))
        if code == INTERRUPTED:
            break
    if as_json:
        print_json({"plans": documents})
    elif prepared:
        echo(f"Look at them: hrclog view {out}")
    return code if prepared else EXIT_FAILED


def _prepare_plans(plan_paths: Sequence[Path], settings: RunOptions) -> tuple[dict[Path, Prepared], int]:
    """Return the plans that can be executed, and the exit code for the others."""
    from hrclog.cli.run_plan import prepare
    from hrclog.errors import HrclogError

    prepared: dict[Path, Prepared] = {}
    for plan_path in plan_paths:
        try:
            prepared[plan_path] = prepare(plan_path, settings)
        except HrclogError as error:
            echo_lines(f"hrclog: error: {error}", err=True)
    return prepared, EXIT_DATA_LOST if len(prepared) < len(plan_paths) else 0


def _log_paths(plan_paths: Sequence[Path], repeat: int, folder: Path) -> dict[Path, list[Path]]:
    """Return the logs of each plan, in a folder that is made here.

    Raises:
        click.UsageError: two plans would share their logs' names.
        LogExistsError: a log is there already.
        OutputError: the folder cannot be made.
    """
    from hrclog.errors import OutputError

    shared = [name for name, count in Counter(path.stem for path in plan_paths).items() if count > 1]
    if shared:
        raise click.UsageError(f"two plans are called {shared[0]!r}: logs are named after their plans; rename one")
    logs = {path: [folder / f"{path.stem}_{number:04d}.mcap" for number in range(repeat)] for path in plan_paths}
    _check_new([log for of_plan in logs.values() for log in of_plan], "choose another folder with -o")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(folder, f"cannot be made ({error.strerror})") from error
    return logs


def _check_new(paths: Sequence[Path], remedy: str) -> None:
    from hrclog.errors import LogExistsError

    for path in paths:
        if path.exists():
            raise LogExistsError(path, remedy)
