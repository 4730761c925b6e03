"""All errors of a scenario file are reported at once: each once, and none that only follows from another."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest
from cells import cell_json
from click.testing import CliRunner

from hrclog.cli import plan
from hrclog.errors import ScenarioError
from hrclog.json_record import JsonRecord
from hrclog.planning.problem import Problem
from hrclog.planning.problem_json import PROBLEM_FIELDS, problem_from_json
from hrclog.sim.scenario import SCENARIO_FOLDER, load_scenario, scenario_from_json, scenario_names


def problem_of_file(value: object, where: str) -> Problem:
    return problem_from_json(JsonRecord(value, where, PROBLEM_FIELDS, problems=[]))


def scenario_json() -> dict[str, Any]:
    """Return a scenario of all three halves as JSON values, without an error."""
    cell = cell_json()
    keys = [(skill["agent"], skill["task"]) for skill in cell["skills"]]
    tasks = {task: [agent for agent, other in keys if other == task] for _, task in keys}
    pair = {"agent": "robot", "task": "put", "other_agent": "human", "other_task": "put"}
    return {
        "name": "mine",
        "problem": {
            "agents": ["robot", "human"],
            "tasks": [{"name": task, "agents": agents} for task, agents in tasks.items()],
            "counts": [{"task": "carry_red", "count": 2}, {"task": "carry_white", "count": 1}],
            "precedences": [{"before": "carry_red", "after": "carry_white", "kind": "all"}],
        },
        "work": [{"agent": agent, "task": task, "median_s": 4.0, "sigma": 0.1} for agent, task in keys],
        "synergies": [{**pair, "synergy": 2.0}],
        "gaps": [{"agent": "robot", "median_s": 0.5, "sigma": 0.2}],
        "failures": {"max_attempts": 2},
        "safety": {"agents": ["robot"]},
        "cell": cell,
    }


def put(value: Any, path: str, new: object) -> None:  # noqa: ANN401 - a JSON value
    """Set a part of JSON values, or with `...` take it away."""
    *way, last = path.split(".")
    for step in way:
        value = value[int(step)] if isinstance(value, list) else value[step]
    key: Any = int(last) if isinstance(value, list) else last
    if new is ...:
        del value[key]
    else:
        value[key] = new


def errors_of(changes: dict[str, object]) -> list[str]:
    """Return the errors that a scenario with some changes is refused with, without their file."""
    value = scenario_json()
    for path, new in changes.items():
        put(value, path, new)
    with pytest.raises(ScenarioError) as caught:
        scenario_from_json(value, "mine.json")
    return [e.removeprefix("mine.json: ") for e in caught.value.problems]


FIELDS = {
    "extra": (1, "unknown field 'extra'; the fields are "),
    "problem.tasks.0.colour": ("red", "problem: tasks[0]: unknown field 'colour'; "),
    "problem.tasks.1.release_s": ("soon", "problem: tasks[1]: release_s: found 'soon', expected a number from 0"),
    "work.0.sigma": (9, "work[0]: sigma: found '9', expected a number from 0 to 5"),
    "work.1.median_s": (..., "work[1]: 'median_s' is missing; add it"),
    "synergies.0.synergy": (-1, "synergies[0]: synergy: found '-1', expected a number above 0"),
    "gaps.0.median_s": (0, "gaps[0]: median_s: found '0', expected a number above 0"),
    "failures.max_attempts": (1.5, "failures: max_attempts: found '1.5', expected a whole number of at least 1"),
    "cell.robot.speed": (9, "cell: robot: speed: found '9', expected a share"),
    "cell.human.home": ([1], "cell: human: home: found '[1]', expected 3 numbers"),
    "cell.objects.1.color": ([300, 0, 0], "cell: objects[1]: color: found '[300, 0, 0]', expected 3 numbers from 0 to"),
    "cell.skills.3.skill": ("grab", "cell: skills[3]: skill: found 'grab', expected one of pick"),
}
CONTRADICTIONS = {
    "problem.tasks.3.agents": (["dog"], "problem: task 'carry_red': agent 'dog' is unknown; the agents are robot"),
    "problem.counts.1.task": ("fly", "problem: task 'fly': unknown; the tasks are pick_red"),
    "problem.precedences.0.before": ("carry_white", "problem: precedences: carry_white -> carry_white is a cycle"),
    "dispatch_mode": ("now", "dispatch_mode: found 'now', expected one of sequential, timed"),
    "synergies.0.other_task": ("dance", "synergies: 'dance' by 'human' is not in the problem"),
    "safety.agents": (["cat"], "gaps or safety: agent 'cat' is unknown; the agents are robot, human"),
    "cell.skills.0.objects": ("green", "cell: skill of 'pick_red' by 'robot': no object is in the group 'green'"),
}


def test_the_scenario_without_a_change_is_right() -> None:
    assert scenario_from_json(scenario_json(), "mine.json").name == "mine"


@pytest.mark.parametrize("path", [*FIELDS, *CONTRADICTIONS])
def test_an_error_by_itself_is_one_line(path: str) -> None:
    new, message = {**FIELDS, **CONTRADICTIONS}[path]
    first, *others = errors_of({path: new})
    assert first.startswith(message)
    # one wrong name can contradict several parts, a wrong field nothing but itself
    assert others == [] or path in CONTRADICTIONS


def all_told(changes: dict[str, tuple[object, str]]) -> None:
    errors = errors_of({path: new for path, (new, _) in changes.items()})
    for _, message in changes.values():
        assert any(error.startswith(message) for error in errors), message
    assert len(set(errors)) == len(errors)


def test_all_wrong_fields_are_told_at_once() -> None:
    all_told(FIELDS)


def test_contradictions_within_the_problem_and_within_the_cell_are_told_at_once() -> None:
    across = ("synergies.0.other_task", "safety.agents")  # told when each part can be read by itself
    all_told({path: change for path, change in CONTRADICTIONS.items() if path not in across})
    all_told({path: CONTRADICTIONS[path] for path in across})


@pytest.mark.parametrize(("field", "contradiction"), [("cell", "problem"), ("problem", "cell"), ("work", "cell")])
def test_a_wrong_field_hides_no_contradiction_of_another_part(field: str, contradiction: str) -> None:
    wrong = {path: change for path, change in FIELDS.items() if path.startswith(field)}
    all_told(wrong | {path: change for path, change in CONTRADICTIONS.items() if path.startswith(contradiction)})


@pytest.mark.parametrize(
    "path",
    [
        *("name", "problem", "problem.agents", "problem.tasks", "problem.counts", "problem.precedences"),
        *("problem.tasks.0", "problem.tasks.0.name", "problem.tasks.0.agents", "problem.counts.0.task"),
        *("problem.counts.0.count", "problem.precedences.0.after", "problem.precedences.0.kind"),
        *("work", "work.0", "work.0.agent", "work.0.task", "synergies", "synergies.0", "synergies.0.other_agent"),
        *("gaps", "gaps.0.agent", "failures", "safety", "safety.agents", "cell", "cell.robot", "cell.human"),
        *("cell.robot.agent", "cell.human.agent", "cell.robot.poses", "cell.robot.poses.home", "cell.robot.planning"),
        *("cell.objects", "cell.objects.0", "cell.objects.0.group", "cell.objects.0.positions", "cell.objects.0.size"),
        *("cell.slots", "cell.slots.0.group", "cell.slots.0.positions", "cell.stands", "cell.stands.0.group"),
        *("cell.skills", "cell.skills.0", "cell.skills.0.task", "cell.skills.0.agent", "cell.skills.0.objects"),
        *("cell.skills.2.slots", "cell.skills.6.steps", "cell.safety", "cell.safety.policy", "cell.safety.areas"),
        *("cell.fixtures", "cell.fixtures.0.name", "cell.faults", "cell.protective_stop", "cell.longest_s"),
    ],
)
def test_what_only_follows_from_a_field_that_cannot_be_read_is_not_told(path: str) -> None:
    (error,) = errors_of({path: 7.5 if path != "cell.longest_s" else "long"})
    place = path.replace(".", ": ")
    for number in range(10):
        place = place.replace(f": {number}", f"[{number}]")
    assert error.startswith(f"{place}: found '")


def test_a_stop_that_is_neither_true_nor_false_needs_no_factor() -> None:
    changes: dict[str, object] = {"synergies.0.stops": "yes", "synergies.0.synergy": ...}
    assert errors_of(changes) == ["synergies[0]: stops: found 'yes', expected true or false; correct it"]


def test_two_poses_without_their_joints_are_two_errors() -> None:
    changes: dict[str, object] = {"cell.robot.poses.home": [], "cell.robot.poses.aside": "up"}
    assert errors_of(changes) == [
        "cell: robot: poses: home: found '[]', expected 7 numbers; correct it",
        "cell: robot: poses: aside: found 'up', expected a list of numbers; correct it",
    ]


def test_a_long_list_of_errors_is_cut() -> None:
    value = scenario_json()
    value["work"] = [{**entry, "sigma": -1} for entry in value["work"] * 2]
    with pytest.raises(ScenarioError) as caught:
        scenario_from_json(value, "mine.json")
    first, *lines = str(caught.value).splitlines()
    assert first == f"mine.json: {len(value['work'])} problems"
    assert (len(lines), lines[-1]) == (21, f"  ... and {len(value['work']) - 20} more")


def test_the_errors_of_a_problem_file_are_listed_at_once(tmp_path: Path) -> None:
    problem = scenario_json()["problem"]
    wrong = copy.deepcopy(problem)
    wrong["tasks"][1]["due_s"] = -1
    del wrong["counts"][0]["count"]
    with pytest.raises(ScenarioError) as caught:
        problem_of_file(wrong, "p.json")
    assert str(caught.value).splitlines() == [
        "p.json: 2 problems",
        "  tasks[1]: due_s: found '-1', expected a number from 0; correct it",
        "  counts[0]: 'count' is missing; add it",
    ]
    assert problem_of_file(problem, "p.json").agents == ("robot", "human")
    path = tmp_path / "p.json"
    path.write_text(json.dumps(wrong))
    result = CliRunner().invoke(plan.command, [str(path)])
    assert "p.json: 2 problems" in str(result.exception)


def test_all_contradictions_of_a_problem_whose_parts_are_right_are_listed() -> None:
    tasks = [{"name": name, "agents": ["human"], "targets": ["x"]} for name in ("a", "b")]
    counts = [{"task": "a", "count": 2}, {"task": "b", "count": 3}]
    value = {
        "agents": ["human"],
        "tasks": tasks,
        "counts": counts,
        "precedences": [{"before": "a", "after": "b", "kind": "each"}],
    }
    with pytest.raises(ScenarioError) as caught:
        problem_of_file(value, "p.json")
    assert len(str(caught.value).splitlines()) == 4


@pytest.mark.parametrize("name", scenario_names())
def test_any_field_of_a_scenario_may_be_anything_and_is_refused_or_read(name: str) -> None:
    value = json.loads((SCENARIO_FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    for path in list(paths_of(value))[::7]:
        changed = copy.deepcopy(value)
        for junk in (None, -1, "junk", [], {}, [{}]):
            put(changed, path, junk)
            try:
                scenario_from_json(changed, "mine.json")
            except ScenarioError as error:
                assert "mine.json" in str(error)  # noqa: PT017 - most, but not all, are refused
    assert load_scenario(name)


def paths_of(value: object, path: str = "") -> list[str]:
    """Return the paths of all parts of JSON values; of a list, those of the first entry."""
    if isinstance(value, dict):
        return [p for name, part in value.items() for p in (f"{path}{name}", *paths_of(part, f"{path}{name}."))]
    if isinstance(value, list) and value:
        return [f"{path}0", *paths_of(value[0], f"{path}0.")]
    return []
