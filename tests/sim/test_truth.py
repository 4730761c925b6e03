"""The truth's side file."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hrclog.errors import LogExistsError, ScenarioError
from hrclog.sim.run import simulate_run
from hrclog.sim.scenario import load_scenario, scenario_names
from hrclog.sim.truth import (
    ExecutionTruth,
    PairTruth,
    RunTruth,
    SynergyTruth,
    TaskTruth,
    Truth,
    read_truth,
    scenario_truth,
    write_truth,
)

SAMPLE = Path(__file__).parents[2] / "sample_logs" / "campaign" / "truth.json"


@pytest.mark.parametrize("name", scenario_names())
def test_the_truth_comes_back_from_its_file(name: str, tmp_path: Path) -> None:
    scenario = load_scenario(name)
    truth = scenario_truth(scenario, 4, [simulate_run(scenario, 4, index).truth for index in range(3)])
    write_truth(tmp_path / "truth.json", truth)
    assert read_truth(tmp_path / "truth.json") == truth
    assert json.loads((tmp_path / "truth.json").read_text())["schema_version"] == 1


def test_a_file_that_is_read_and_written_again_keeps_its_bytes(tmp_path: Path) -> None:
    write_truth(tmp_path / "truth.json", read_truth(SAMPLE))
    assert (tmp_path / "truth.json").read_bytes() == SAMPLE.read_bytes()


def test_what_nobody_knows_is_left_out_and_what_does_not_exist_is_null(tmp_path: Path) -> None:
    bare = RunTruth("r", "n", (ExecutionTruth("e", "i", "a", "t", 1, "succeeded", 2.0),))
    full = RunTruth(
        "r",
        "n",
        (ExecutionTruth("e", "i", "a", "t", 1, "succeeded", 2.0, 0.0, 0.5),),
        (PairTruth("a", "t", "b", "u", 3.0, 2.0, 1.0),),
        0,
    )
    synergies = SynergyTruth("a", "t", "b", "u", None), SynergyTruth("b", "u", "a", "t", None, None, 0.0)
    truth = Truth("s", 1, "bullet", (TaskTruth("a", "t", None, None, 0.0),), synergies, (bare, full), "ssm")
    write_truth(tmp_path / "truth.json", truth)
    value = json.loads((tmp_path / "truth.json").read_text())
    execution = {"execution_id": "e", "item_id": "i", "agent": "a", "task": "t", "attempt": 1, "outcome": "succeeded"}
    assert value["runs"] == [
        {"run_id": "r", "name": "n", "executions": [execution | {"work_s": 2.0}]},
        {
            "run_id": "r",
            "name": "n",
            "executions": [execution | {"work_s": 2.0, "planning_s": 0.0, "lost_s": 0.5}],
            "pairs": [
                {"agent": "a", "task": "t", "other_agent": "b", "other_task": "u", "overlap_s": 3.0, "progress_s": 2.0}
                | {"caused_progress_s": 1.0}
            ],
            "contacts": 0,
        },
    ]
    pair = {"agent": "a", "task": "t", "other_agent": "b", "other_task": "u", "synergy": None}
    assert value["synergies"][0] == pair
    assert value["synergies"][1]["overlap_s"] == 0.0
    assert value["tasks"] == [{"agent": "a", "task": "t", "mu": None, "sigma": None, "failure_probability": 0.0}]
    assert value["safety"] == "ssm"
    assert read_truth(tmp_path / "truth.json") == truth


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
