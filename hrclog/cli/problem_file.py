"""The problem that a command is about: a scenario by name or file, or a problem's own file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from hrclog.planning.plan import Plan
    from hrclog.planning.problem import Problem
    from hrclog.sim.scenario import Scenario

problem_argument = click.argument("problem_name", metavar="PROBLEM")


def load_problem(name: str) -> tuple[Problem, Scenario | None]:
    """Return a problem, and the scenario that it is part of, if it is.

    Args:
        name: of a scenario, or the path of a JSON file: a scenario, or a problem by itself.

    Raises:
        ScenarioError: there is no such scenario or file, or it is neither.
    """
    from hrclog.json_record import JsonRecord, read_json
    from hrclog.planning.problem_json import PROBLEM_FIELDS, problem_from_json
    from hrclog.sim.scenario import load_scenario, scenario_names

    path = Path(name)
    if name not in scenario_names() and path.is_file():
        value = read_json(path, "a problem or a scenario")
        if not isinstance(value, Mapping) or "problem" not in value:
            return problem_from_json(JsonRecord(value, str(path), PROBLEM_FIELDS, problems=[])), None
    scenario = load_scenario(name)
    return scenario.problem, scenario


def scenario_of_plan(plan: Plan, plan_path: Path) -> str:
    """Return the name or the path of the scenario that a plan was made for.

    A path that the plan holds counts from the plan's folder, else from the working folder.

    Raises:
        ScenarioError: the plan names none, its problem is gone or has changed, or it is a problem without a scenario.
    """
    from hrclog.errors import ScenarioError
    from hrclog.planning.provenance import problem_digest
    from hrclog.sim.scenario import scenario_names

    remedy = "name the scenario to carry it out in with --scenario NAME|FILE"
    if plan.problem is None:
        raise ScenarioError(f"{plan_path}: the plan does not say which problem it was made for; {remedy}")
    name = plan.problem.name
    if name not in scenario_names():
        places = [path for path in (plan_path.parent / name, Path(name)) if _is_other_file(path, plan_path)]
        if not places:
            reason = f"the plan was made for {name!r}, which is no scenario, and no file beside the plan or here"
            raise ScenarioError(f"{plan_path}: {reason}; {remedy}")
        name = str(places[0])
    problem, scenario = load_problem(name)
    if scenario is None:
        reason = f"the plan was made for {name!r}, a problem that says nothing of how its agents act"
        raise ScenarioError(f"{plan_path}: {reason}; {remedy}")
    if plan.problem.digest and problem_digest(problem) != plan.problem.digest:
        reason = f"the problem of {name!r} has changed since the plan was made"
        raise ScenarioError(f"{plan_path}: {reason}; make the plan anew, or {remedy}")
    return name


def _is_other_file(path: Path, plan_path: Path) -> bool:
    """Return whether a path is that of a file, but not of the plan, which may be called like its problem."""
    try:
        return path.is_file() and not path.samefile(plan_path)
    except OSError:  # a name that no file can have
        return False
