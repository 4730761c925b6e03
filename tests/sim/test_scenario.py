"""Scenario files: all that come along are valid, and what is wrong with others is said."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hrclog.errors import ScenarioError
from hrclog.sim.scenario import SCENARIO_FOLDER, load_scenario, scenario_from_json, scenario_names

GOOD: dict[str, Any] = {
    "name": "two",
    "problem": {
        "agents": ["H", "R"],
        "tasks": [{"name": "pick", "agents": ["H", "R"]}],
        "counts": [{"task": "pick", "count": 3}],
    },
    "work": [{"agent": agent, "task": "pick", "median_s": 2.0, "sigma": 0.1} for agent in "HR"],
    "synergies": [{"agent": "R", "task": "pick", "other_agent": "H", "other_task": "pick", "synergy": 2.0}],
    "gaps": [{"agent": "R", "median_s": 0.5, "sigma": 0.2}],
}


def test_every_file_that_comes_along_is_valid_and_named_after_itself() -> None:
    assert {"paper", "failures", "three-agents"} <= set(scenario_names())
    assert len(scenario_names()) >= 4
    for name in scenario_names():
        scenario = load_scenario(name)
        assert scenario.name == name
        assert scenario.description


def test_a_scenario_is_read_from_any_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(GOOD))
    scenario = load_scenario(path)
    assert scenario.name == "two"
    assert scenario.rates == {("H", "pick"): {}, ("R", "pick"): {("H", "pick"): 0.5}}
    assert scenario.work["H", "pick"].time.mu == math.log(2.0)
    assert scenario.durations_s["H", "pick"] == pytest.approx(2.0 * math.exp(0.005))


def test_a_name_wins_over_a_file_of_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "paper").write_text("{}")
    assert load_scenario("paper").name == "paper"


def test_an_unknown_name_is_answered_with_the_known_ones() -> None:
    with pytest.raises(ScenarioError, match=r"scenario 'nope': neither .*; the names are authors-areas, .*paper"):
        load_scenario("nope")


def _set(*path: str | int, to: object) -> Callable[[dict[str, Any]], None]:
    def change(value: Any) -> None:  # noqa: ANN401 - a JSON value
        for step in path[:-1]:
            value = value[step]
        value[path[-1]] = to

    return change


STOP = {"agent": "R", "task": "pick", "other_agent": "H", "other_task": "pick", "stops": True}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_set("extra", to=1), "unknown field 'extra'; the fields are cell, description, dispatch_mode, failures"),
        (_set("name", to=""), "name: found '', expected a text that is not empty"),
        (_set("name", to="a/b"), "name: found 'a/b', expected letters, digits"),
        (_set("problem", to=[]), r"problem: found '\[\]', expected a JSON object"),
        (_set("problem", "counts", to=[]), "problem: counts: nothing is to be done"),
        (_set("work", 0, "median_s", to=0), r"work\[0\]: median_s: found '0', expected a number above 0"),
        (_set("work", 0, "median_s", to="2"), "median_s: found '2', expected a number above 0"),
        (_set("work", 0, "sigma", to=-0.1), "sigma: found '-0.1', expected a number from 0 to 5"),
        (_set("work", 0, "failure_probability", to=1.5), "found '1.5', expected a number from 0 to 1"),
        (_set("work", 0, "agent", to="R"), "'pick' by 'R' is given twice"),
        (_set("work", to=[]), "work: 'pick' by 'H' is missing"),
        (_set("work", 0, "task", to="fly"), "work: 'pick' by 'H' is missing"),
        (_set("synergies", 0, "synergy", to=0), r"synergies\[0\]: synergy: found '0', expected a number above 0"),
        (_set("synergies", 0, "other_agent", to="R"), "'pick' by 'R' with its own 'pick'"),
        (_set("synergies", 0, "other_task", to="fly"), "synergies: 'fly' by 'H' is not in the problem"),
        (_set("synergies", to=GOOD["synergies"] * 2), "'pick' by 'R' with 'pick' by 'H' is given twice"),
        (_set("synergies", to=[STOP]), "'pick' by 'R' stops, but no safety function watches it"),
        (_set("synergies", to=[{**STOP, "synergy": 2.0}]), "synergy: found '2.0', expected nothing, as the task stops"),
        (_set("synergies", 0, "stops", to="yes"), "stops: found 'yes', expected true or false"),
        (_set("gaps", to=GOOD["gaps"] * 2), "gaps: agent 'R' is given twice"),
        (_set("gaps", 0, "agent", to="X"), "agent 'X' is unknown; the agents are H, R"),
        (_set("safety", to={"agents": ["X"]}), "agent 'X' is unknown; the agents are H, R"),
        (_set("failures", to={"max_attempts": 0}), "max_attempts: found '0', expected a whole number of at least 1"),
        (_set("failures", to={"on_failure": "cry"}), "on_failure: found 'cry', expected one of skip, abort"),
        (_set("dispatch_mode", to="now"), "dispatch_mode: found 'now', expected one of sequential, timed"),
    ],
)
def test_a_bad_scenario_is_named_with_file_place_and_expectation(
    change: Callable[[dict[str, Any]], None], message: str
) -> None:
    value = copy.deepcopy(GOOD)
    change(value)
    with pytest.raises(ScenarioError, match=message) as caught:
        scenario_from_json(value, "cell.json")
    assert str(caught.value).startswith("cell.json: ")


def test_two_tasks_that_stop_each_other_are_refused() -> None:
    value = copy.deepcopy(GOOD)
    back = STOP | {"agent": "H", "other_agent": "R"}
    value |= {"synergies": [STOP, back], "safety": {"agents": ["H", "R"]}}
    with pytest.raises(ScenarioError, match="stop each other for ever"):
        scenario_from_json(value, "cell.json")


def test_the_files_spell_out_one_row_a_line() -> None:
    for path in SCENARIO_FOLDER.glob("*.json"):
        assert max(map(len, path.read_text().splitlines())) < 400


def test_all_errors_of_a_file_are_told_at_once(tmp_path: Path) -> None:
    value = json.loads((SCENARIO_FOLDER / "paper.json").read_text())
    del value["name"]
    value["problem"]["tasks"][0]["agents"] = "robot"
    value["problem"]["counts"][1]["count"] = -1
    value["work"][0]["sigma"] = "wide"
    value["work"][2]["surprise"] = 1
    value["cell"]["robot"]["speed"] = -3
    value["cell"]["skills"][0]["skill"] = "juggle"
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(value))
    with pytest.raises(ScenarioError) as caught:
        load_scenario(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: 7 problems\n")
    for place in (
        "'name' is missing",
        "problem: tasks[0]: agents: found 'robot', expected a list of texts",
        "problem: counts[1]: count: found '-1'",
        "work[0]: sigma: found 'wide'",
        "work[2]: unknown field 'surprise'",
        "cell: robot: speed",
        "cell: skills[0]: skill: found 'juggle'",
    ):
        assert f"\n  {place}" in message
    assert len(caught.value.problems) == 7


def test_contradictions_are_told_together_and_many_are_counted(tmp_path: Path) -> None:
    value = json.loads((SCENARIO_FOLDER / "failures.json").read_text())
    value["work"] = value["work"][:1]
    value["synergies"] = [
        {"agent": "nobody", "task": f"task {number}", "other_agent": "x", "other_task": "y", "synergy": 2}
        for number in range(30)
    ]
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(value))
    with pytest.raises(ScenarioError, match=r"(?s)mine\.json: \d+ problems\n.*\.\.\. and \d+ more$") as caught:
        load_scenario(path)
    assert str(caught.value).count("\n") == ScenarioError.MOST + 1
