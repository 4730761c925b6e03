"""The truth's side file."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hrclog.errors import LogExistsError, ScenarioError
from hrclog.sim.run import simulate_run
from hrclog.sim.scenario import load_scenario, scenario_names
from hrclog.sim.truth import read_truth, scenario_truth, write_truth


@pytest.mark.parametrize("name", scenario_names())
def test_the_truth_comes_back_from_its_file(name: str, tmp_path: Path) -> None:
    scenario = load_scenario(name)
    truth = scenario_truth(scenario, 4, [simulate_run(scenario, 4, index).truth for index in range(3)])
    write_truth(tmp_path / "truth.json", truth)
    assert read_truth(tmp_path / "truth.json") == truth
    assert json.loads((tmp_path / "truth.json").read_text())["schema_version"] == 1


def test_every_ordered_pair_of_different_agents_has_one_row_and_pairs_not_given_have_no_effect() -> None:
    scenario = load_scenario("three-agents")
    rows = scenario_truth(scenario, 1).synergies
    keys = scenario.problem.agent_tasks()
    assert [(r.agent, r.task, r.other_agent, r.other_task) for r in rows] == [
        (*key, *other) for key in keys for other in keys if key[0] != other[0]
    ]
    found = {(r.agent, r.task, r.other_agent, r.other_task): r.synergy for r in rows}
    assert found["robot_left", "pick_part", "robot_right", "pick_part"] == 1.6
    assert found["human", "pack_box", "robot_left", "pick_part"] == 1.0


def test_a_full_stop_has_no_finite_synergy() -> None:
    rows = scenario_truth(load_scenario("machine-tending"), 1).synergies
    assert {(r.task, r.other_task) for r in rows if r.synergy is None} == {
        ("load_blank", "sweep_chips"),
        ("unload_part", "sweep_chips"),
    }


def test_an_older_truth_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "truth.json"
    path.write_text("mine")
    with pytest.raises(LogExistsError, match=r"truth\.json: exists already"):
        write_truth(path, scenario_truth(load_scenario("paper"), 1))
    assert path.read_text() == "mine"


@pytest.mark.parametrize("text", [None, "", "[]", "{}", '{"scenario": "a", "seed": 1, "engine": "e", "tasks": [{}]}'])
def test_a_file_that_is_no_truth_is_named(text: str | None, tmp_path: Path) -> None:
    path = tmp_path / "truth.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ScenarioError, match=r"truth.json: not a truth file .*`hrclog sim`"):
        read_truth(path)
