"""`hrclog plan`: find a plan by what was learnt, judge one, or draw random ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from hrclog.analyzers.search.methods import METHODS, OBJECTIVES
from hrclog.cli.clock_option import clock_option
from hrclog.cli.common import echo, echo_lines, json_option, print_json, tell
from hrclog.cli.known_times import kb_option, known_times
from hrclog.cli.plan_text import forecast_line, found_text, timeline_text
from hrclog.cli.problem_file import load_problem, problem_argument
from hrclog.wording import counted

if TYPE_CHECKING:
    from hrclog.analyzers.search.forecast import Forecast
    from hrclog.events import Event
    from hrclog.knowledge.task_times import TaskTimes
    from hrclog.planning.plan import Plan
    from hrclog.planning.problem import Problem
    from hrclog.sim.scenario import Scenario

_PLANS_SET: Final = "plans"


@click.command("plan", context_settings={"help_option_names": ["-h", "--help"]})
@problem_argument
@kb_option
@click.option(
    "--objective",
    type=click.Choice(list(OBJECTIVES)),
    default=next(iter(OBJECTIVES)),
    show_default=True,
    help=f"Of the makespan: {'; '.join(f'{each.name}, {each.summary}' for each in OBJECTIVES.values())}.",
)
@click.option(
    "--method",
    type=click.Choice(list(METHODS)),
    default=next(iter(METHODS)),
    show_default=True,
    metavar="METHOD",
    help=f"Search method: {', '.join(METHODS)}.",
)
@click.option("--seed", type=int, default=1, show_default=True, help="The same seed gives the same plan.")
@click.option(
    "--effort",
    type=click.IntRange(min=100),
    default=30_000,
    show_default=True,
    metavar="N",
    help="Plans that local search may judge.",
)
@click.option(
    "--seconds",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="S",
    help="Stop searching after S seconds; the plan then depends on the machine.  [default: no limit, 60 for cpsat]",
)
@click.option(
    "--synergy",
    "overrides",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Use these factors between tasks instead of the learned ones.",
)
@click.option(
    "--avoid",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Pairs of tasks that not-neighboring keeps apart.  [default: those learnt to hinder each other]",
)
@click.option("--explore", is_flag=True, help="Try pairs of which little is known, now and then (by --seed).")
@click.option(
    "--judge",
    "given",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="PLAN",
    help="Evaluate this plan instead of searching for one.",
)
@click.option(
    "--from",
    "run_log",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="LOG",
    help="Plan the rest of an unfinished run, from its log.",
)
@clock_option
@click.option("--show", is_flag=True, help="Draw the planned timelines.")
@click.option("--random", "count", type=click.IntRange(min=1), metavar="N", help="Draw N different plans into -o DIR.")
@click.option(
    "-o",
    "--output",
    "out",
    type=click.Path(path_type=Path),
    metavar="PLAN|DIR",
    help="The plan's file, or with --random the folder; nothing is overwritten.",
)
@json_option
def command(**options: Any) -> int:
    """Find the best plan for a problem from what was learned, and predict its makespan.

    PROBLEM is a scenario's name, or the file of a scenario or of a problem.

    \b
    Example:
      hrclog sim --scenario paper --runs 20 -o runs
      hrclog kb update runs --kb kb.sqlite
      hrclog plan paper --kb kb.sqlite --show -o plan.json
      hrclog plan paper --random 10 --seed 1 -o plans
    """
    _check_options(options)
    problem, scenario = load_problem(options["problem_name"])
    _check_output(options)
    if options["count"]:
        return _draw_plans(problem, scenario, options)
    times = known_times(problem, options["kb"], options["overrides"])
    if options["given"]:
        return _judge_plan(problem, times, options)
    if options["run_log"]:
        return _replan(problem, times, options)
    return _find_plan(problem, times, options)


def _check_options(options: dict[str, Any]) -> None:
    jobs = {"--random": options["count"], "--judge": options["given"], "--from": options["run_log"]}
    job_options = [name for name, value in jobs.items() if value]
    if len(job_options) > 1:
        raise click.UsageError(f"{' and '.join(job_options)} ask for different things: give one of them")
    if options["avoid"] and options["method"] != "not-neighboring":
        raise click.UsageError("--avoid FILE goes with --method not-neighboring")
    if options["clocks"] and not options["run_log"]:
        raise click.UsageError("--clock goes with --from LOG")


def _check_output(options: dict[str, Any]) -> None:
    from hrclog.errors import LogExistsError

    out: Path | None = options["out"]
    if options["count"] and out is None:
        raise click.UsageError("--random N writes N plans: give their folder with -o DIR")
    if out is not None and not options["count"] and out.exists():
        raise LogExistsError(out, "choose another name with -o")


def _find_plan(problem: Problem, times: TaskTimes, options: dict[str, Any]) -> int:
    from hrclog.analyzers.search.find import find_plan
    from hrclog.analyzers.search.judge import Objective
    from hrclog.analyzers.search.local_search import Effort
    from hrclog.analyzers.search.what_if import read_pairs
    from hrclog.analyzers.search.wish import Method, Wish

    out: Path | None = options["out"]
    wish = Wish(
        Objective(options["objective"]),
        Method(options["method"]),
        options["seed"],
        Effort(options["effort"], options["seconds"] or float("inf")),
        read_pairs(options["avoid"]) if options["avoid"] else None,
        options["explore"],
    )
    found = find_plan(problem, times, wish, out.stem if out else "plan")
    found = replace(found, plan=_with_provenance(found.plan, problem, options, found.forecast))
    _save_plan(out, found.plan)
    if options["as_json"]:
        print_json(found.to_json())
        return 0
    echo_lines(found_text(found))
    if options["show"]:
        echo()
        echo_lines(timeline_text(found.plan, _end_ranges(found.forecast)))
    return 0


def _judge_plan(problem: Problem, times: TaskTimes, options: dict[str, Any]) -> int:
    from hrclog.analyzers.search.forecast import forecast, with_expected_times
    from hrclog.planning.plan import check_plan, read_plan

    plan = read_plan(options["given"])
    check_plan(problem, plan)
    prediction = forecast(problem, plan, times, seed=options["seed"])
    timed = _with_provenance(with_expected_times(plan, prediction), problem, options, prediction)
    _save_plan(options["out"], timed)
    if options["as_json"]:
        print_json({"forecast": prediction.to_json(), "plan": timed.to_json()})
        return 0
    echo(f"{plan.name}: {forecast_line(prediction)}")
    if options["show"]:
        echo()
        echo_lines(timeline_text(timed, _end_ranges(prediction)))
    return 0


def _replan(problem: Problem, times: TaskTimes, options: dict[str, Any]) -> int:
    """Plan the rest of a run."""
    from hrclog.analyzers.search.judge import Objective
    from hrclog.analyzers.search.replan import plan_rest
    from hrclog.planning.run_state import run_state

    events, code = _read_run(options["run_log"], options["clocks"])
    state = run_state(events)
    _check_cell(problem, state.plan, options)
    result = plan_rest(problem, times, state, Objective(options["objective"]), options["seed"])
    n_over = sum(outcome == "succeeded" for outcome in state.outcomes.values())
    progress = f"{options['run_log']}: {n_over} items done, {len(state.running)} under way at {state.now_s:.1f} s"
    if result is None:
        if options["as_json"]:
            print_json({"now_s": state.now_s, "changed": False, "forecast": None, "plan": state.plan.to_json()})
        else:
            as_good = "the plan that is followed is as good as any that was found"
            echo(f"{progress}; {as_good if state.left() else 'nothing is left to plan'}")
            if options["show"]:
                echo()
                echo_lines(timeline_text(state.plan))
        _save_plan(options["out"], state.plan)
        return code
    plan, prediction = result
    plan = _with_provenance(plan, problem, options, prediction)
    _save_plan(options["out"], plan)
    if options["as_json"]:
        print_json({"now_s": state.now_s, "changed": True, "forecast": prediction.to_json(), "plan": plan.to_json()})
        return code
    echo(progress)
    echo(f"{plan.name}: its end after {forecast_line(prediction)}")
    if options["show"]:
        echo()
        echo_lines(timeline_text(plan, _end_ranges(prediction)))
    return code


def _check_cell(problem: Problem, plan: Plan, options: dict[str, Any]) -> None:
    """Raise if the plan of a run has a task that the problem does not have."""
    from hrclog.errors import ScenarioError

    known = set(problem.agent_tasks())
    for item in plan.items:
        if (item.agent, item.task) not in known:
            item_text = f"its plan has {item.task!r} by {item.agent!r}"
            raise ScenarioError(
                f"{options['run_log']}: {item_text}, which is not in {options['problem_name']}; name its cell"
            )


def _read_run(path: Path, clocks: dict[str, int]) -> tuple[list[Event], int]:
    """Return the events of a log that holds one run, and the exit code that its defects ask for.

    Raises:
        HrclogError: it cannot be read, or holds none or several.
    """
    from hrclog.errors import ScenarioError
    from hrclog.event_rows import from_row
    from hrclog.log.annotations.exclusions import exclusion_diagnostics, judged
    from hrclog.log.clocks.correction import on_one_clock
    from hrclog.log.never_set import with_numbers, without_unset
    from hrclog.log.one_log import read_annotated

    logs = read_annotated(path)
    events, unset = without_unset(logs.events)
    events, corrections = on_one_clock(with_numbers(events)[0], clocks)
    verdict = judged(events)
    events = verdict.events
    code = tell([*logs.diagnostics, *unset, *corrections, *exclusion_diagnostics(verdict.exclusions)])
    n_runs = events["run_id"].drop_nulls().n_unique()
    if n_runs != 1:
        raise ScenarioError(f"{path}: found {n_runs} runs, expected the log of one; hrclog info lists them")
    return [from_row(row) for row in events.sort("time_ns", "seq").iter_rows(named=True)], code


def _end_ranges(prediction: Forecast) -> dict[str, tuple[float, float]]:
    return {item_id: (low, high) for item_id, (_, _, low, high) in prediction.items.items()}


def _with_provenance(plan: Plan, problem: Problem, options: dict[str, Any], prediction: Forecast | None = None) -> Plan:
    """Return a plan with the name of its problem and its expected makespan."""
    from hrclog.planning.dispatch_mode import DispatchMode
    from hrclog.planning.provenance import Expected, made_for

    expected = plan.expected
    if prediction:
        numbers = (
            prediction.mean_s,
            prediction.mean_low_s,
            prediction.mean_high_s,
            prediction.run_low_s,
            prediction.run_high_s,
        )
        expected = Expected(*numbers, worlds=prediction.worlds, mode=DispatchMode.SEQUENTIAL.value)
    return replace(plan, problem=made_for(options["problem_name"], problem), expected=expected)


def _save_plan(out: Path | None, plan: Plan) -> None:
    from hrclog.planning.plan import write_plan

    if out is not None:
        write_plan(out, plan)


def _draw_plans(problem: Problem, scenario: Scenario | None, options: dict[str, Any]) -> int:
    """Write random plans, one file each."""
    from hrclog.errors import LogExistsError
    from hrclog.file_sets import replaced_set, unfinished_names
    from hrclog.planning.plan import write_plan
    from hrclog.planning.random_plans import distinct_plans
    from hrclog.sim.run import fitting_plan

    out: Path = options["out"]
    plans = distinct_plans(problem, options["count"], options["seed"])
    if scenario is not None:
        plans = [fitting_plan(scenario, plan) for plan in plans]
    plans = [_with_provenance(plan, problem, options) for plan in plans]
    paths = [out / f"{plan.name}.json" for plan in plans]
    broken_off = unfinished_names(out, _PLANS_SET)
    for path in paths:
        if path.exists() and path.name not in broken_off:
            raise LogExistsError(path, "choose an empty folder with -o")
    with replaced_set(out, _PLANS_SET, keeps=True) as new:
        for path, plan in zip(paths, plans, strict=True):
            write_plan(new / path.name, plan)
    if options["as_json"]:
        print_json({"problem": options["problem_name"], "seed": options["seed"], "plans": [str(p) for p in paths]})
    else:
        echo(f"{counted(len(paths), 'plan')} of {options['problem_name']}: {paths[0]} .. {paths[-1].name}")
    return 0
