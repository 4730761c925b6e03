"""The problem that a command is about: a scenario by name or file, or a problem's own file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
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
    from hrclog.planning.problem import PROBLEM_FIELDS, problem_from_json
    from hrclog.sim.scenario import load_scenario, scenario_names

    path = Path(name)
    if name not in scenario_names() and path.is_file():
        value = read_json(path, "a problem or a scenario")
        if not isinstance(value, Mapping) or "problem" not in value:
            return problem_from_json(JsonRecord(value, str(path), PROBLEM_FIELDS)), None
    scenario = load_scenario(name)
    return scenario.problem, scenario
