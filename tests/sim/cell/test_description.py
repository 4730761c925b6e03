"""A cell read from JSON: what it says, and that every mistake is named."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
from cells import cell_json, parsed, small_cell, small_scenario

from hrclog.errors import ScenarioError
from hrclog.json_record import JsonRecord
from hrclog.log.messages.encode import SceneSignal, signal_message
from hrclog.sim.bullet.cell_signals import scene_of
from hrclog.sim.bullet.engine import with_policy
from hrclog.sim.cell.description import Box, Fault, Pose, ProtectiveStop, Skill, Slot, Stand, check_policy
from hrclog.sim.cell.from_json import CELL_FIELDS, read_cell
from hrclog.sim.cell.safety_settings import (
    Area,
    AreasSettings,
    Band,
    DistanceSettings,
    SafetySettings,
    Slew,
    SsmSettings,
)
from hrclog.sim.lognormal import Lognormal
from hrclog.sim.scenario import SCENARIO_FOLDER, load_scenario, scenario_from_json

AREA = {"name": "red", "low": [0, 0], "high": [1, 2], "scale": 0.0}


def test_objects_and_slots_of_a_group_are_numbered_from_1() -> None:
    cell = small_cell()
    assert cell.objects[0] == Box("red_1", (0.06, 0.06, 0.06), (0.7, -0.65, 1.03), (100, 100, 100), "red")
    assert [box.name for box in cell.objects_of("blue")] == ["blue_1", "blue_2", "blue_3"]
    assert cell.slots_of("shelf")[5] == Slot("shelf_6", "shelf", (0.19, 1.49, 0.93))
    assert (cell.objects_of("none"), cell.slots_of("none")) == ((), ())


def test_fixtures_belong_to_no_group() -> None:
    assert small_cell().fixtures[0] == Box("shared_table", (2.1, 0.55, 0.04), (1.0, 0.17, 0.98), (150, 140, 125))
    assert small_cell({"fixtures": []}).fixtures == ()


def test_the_robot_is_as_the_json_says() -> None:
    robot = small_cell({"robot.planning.place": {"median_s": 0.5, "sigma": 0.0}}).robot
    assert (robot.agent, robot.rail_y, robot.base_z, robot.speed) == ("robot", -0.32, 1.02, 0.8)
    assert robot.home == Pose("home", (0.6, 0.0, -1.57, 1.57, -1.57, -1.57, 0.0))
    assert robot.pose("aside") is not None
    assert robot.pose("elsewhere") is None
    assert robot.planning("pick") == Lognormal(0.2, 0.1)
    assert robot.planning("place") == Lognormal(0.5, 0.0)


def test_the_human_stands_at_a_yaw_given_in_degrees() -> None:
    human = small_cell().human
    assert human.home == (1.0, 1.15, -math.pi / 2)
    assert (human.yield_m, human.patience_s) == (0.0, 0.0)
    assert small_cell({"human.yield_m": 0.3, "human.patience_s": 4}).human.yield_m == 0.3


def test_skills_are_found_by_agent_and_task() -> None:
    cell = small_cell()
    assert cell.skill["robot", "put"] == Skill("robot", "put", "place", slots="bin", pose="home")
    assert cell.skill["robot", "tour"].steps == ("step_aside", "pick_red", "put")
    assert cell.stand["blue"] == Stand("blue", (0.1, 0.55)).offset


def test_what_is_not_said_of_faults_and_stops_does_not_happen() -> None:
    cell = small_cell()
    assert cell.faults == ()
    assert cell.protective_stop == ProtectiveStop(0.0, 3.0)
    assert cell.longest_s == 900.0
    fault = {"agent": "robot", "task": "put", "probability": 0.25, "reason": "slipped"}
    told = small_cell({"faults": [fault], "protective_stop": {"rate_per_hour": 60, "duration_s": 2}, "longest_s": 50})
    assert told.fault == {("robot", "put"): Fault("robot", "put", 0.25, "slipped")}
    assert told.protective_stop == ProtectiveStop(60.0, 2.0)
    assert told.longest_s == 50.0


def test_safety_is_as_the_json_says() -> None:
    safety = {
        "policy": "ssm",
        "areas": {"areas": [AREA], "fall_per_s": 1.0, "rise_per_s": 0.1, "deceleration": 3.0},
        "distance": {"bands": [{"nearer_than_m": 0.5, "scale": 0.25}]},
        "ssm": {"human_speed": 1.0, "reaction_s": 0.2, "clearance_m": 0.1, "rise_per_s": 0.5},
    }
    assert small_cell({"safety": safety}).safety == SafetySettings(
        "ssm",
        AreasSettings((Area("red", (0.0, 0.0), (1.0, 2.0), 0.0),), Slew(1.0, 0.1), 3.0),
        DistanceSettings((Band(0.5, 0.25),), Slew(), 2.5),
        SsmSettings(1.0, 0.2, 2.5, 0.1, slew=Slew(None, 0.5)),
    )


def test_an_area_may_act_for_a_part_of_the_robots_reach_alone() -> None:
    cell = small_cell({"safety.areas.areas": [{**AREA, "guarded": [-1, -2, 3, 4]}]})
    assert cell.safety.areas.areas[0].guarded == ((-1.0, -2.0), (3.0, 4.0))


def test_brakes_are_by_default_as_good_as_separation_reckons_with() -> None:
    for ssm, brakes in (({}, 2.5), ({"deceleration": 0.5}, 0.5), ({"deceleration": 0.5, "brakes": 3}, 3.0)):
        assert small_cell({"safety": {"policy": "ssm", "ssm": ssm}}).safety.ssm.brakes == brakes


def test_signals_are_sampled_at_each_look_unless_it_is_said_otherwise() -> None:
    rates = [small_cell(change).signals_hz for change in ({}, {"signals_hz": 10}, {"signals_hz": 0})]
    assert rates == [50.0, 10.0, 0.0]


def test_the_parameters_of_separation_are_by_default_those_of_nn_ssm() -> None:
    assert small_cell({"safety": {"policy": "ssm", "ssm": {}}}).safety.ssm == SsmSettings(1.6, 0.15, 2.5, 0.2)
    assert small_cell({"safety": {"policy": "ssm"}}).safety.ssm == SsmSettings()


@pytest.mark.parametrize(
    "field",
    ["robot", "human", "objects", "slots", "stands", "skills", "safety", *[f"robot.{name}" for name in (
        "agent", "rail_y", "base_z", "poses", "speed", "acceleration", "approach", "approach_m", "planning",
        "planning.pick", "planning.place",
    )], *[f"human.{name}" for name in ("agent", "home", "walk_speed", "hand_speed", "grasp_s", "release_s")],
     "objects.0.group", "objects.1.positions", "slots.1.group", "stands.0.offset", "skills.0.agent", "skills.0.task",
     "skills.0.skill", "skills.0.objects", "skills.2.slots", "skills.3.slots", "skills.6.steps", "safety.policy",
     "fixtures.0.size", "fixtures.1.name"],
)  # fmt: skip
def test_a_field_that_is_missing_is_named(field: str) -> None:
    value: Any = cell_json()
    part, (*way, name) = value, field.split(".")
    for step in way:
        part = part[int(step)] if isinstance(part, list) else part[step]
    del part[name]
    with pytest.raises(ScenarioError, match=rf"^cell\.json: .*\b{name}'?\b.*(is missing|expected)"):
        parsed(value)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("robto", {}, r"cell.json: unknown field 'robto'; the fields are faults, fixtures"),
        ("robot.colour", "red", r"cell.json: robot: unknown field 'colour'"),
        ("human.speed", 1, r"cell.json: human: unknown field 'speed'"),
        ("objects.1.name", "x", r"cell.json: objects\[1\]: unknown field 'name'"),
        ("skills.2.kind", "x", r"cell.json: skills\[2\]: unknown field 'kind'"),
        ("safety.ssm", {"bands": []}, r"cell.json: safety: ssm: unknown field 'bands'"),
        ("safety.speed", {}, r"cell.json: safety: unknown field 'speed'; the fields are areas, distance, policy, ssm"),
        ("robot", [], r"cell.json: robot: found '\[\]', expected a JSON object"),
        ("robot.speed", 0, r"cell.json: robot: speed: found '0', expected a number above 0"),
        ("robot.speed", 1.5, r"cell.json: robot: speed: found '1.5', expected a share above 0 and at most 1"),
        ("robot.acceleration", -1, r"robot: acceleration: found '-1'"),
        ("robot.approach", "fast", r"robot: approach: found 'fast', expected a number"),
        ("robot.approach_m", 0.0, r"robot: approach_m: found '0.0', expected a number above 0"),
        ("robot.poses", {"aside": [0.0] * 7}, r"robot: poses: .* expected at least the pose 'home'"),
        ("robot.poses.home", [0.0] * 6, r"robot: poses: home: found .* expected 7 numbers"),
        ("robot.planning.pick.median_s", 0.0, r"robot: planning: pick: median_s: found '0.0', expected a number above"),
        ("robot.planning.pick.sigma", 6, r"pick: sigma: found '6', expected a number from 0 to 5"),
        ("human.home", [1.0, 2.0], r"human: home: found '\[1.0, 2.0\]', expected 3 numbers"),
        ("human.walk_speed", 0, r"human: walk_speed: .* expected a number above 0"),
        ("human.person_sigma", 2, r"human: person_sigma: .* expected a number from 0 to 1"),
        ("human.hesitation_probability", 1.1, r"hesitation_probability: .* expected a number from 0 to 1"),
        ("human.patience_s", -1, r"patience_s: found '-1', expected a number from 0"),
        ("objects.0.size", [1, 2], r"objects\[0\]: size: .* expected 3 numbers"),
        (
            "objects.0.positions",
            [[1, 2, 3], [1, 2]],
            r"objects\[0\]: positions: .* lists of 3 numbers, found 2 in numb",
        ),
        ("objects.0.positions", [1, 2, 3], r"objects\[0\]: positions: .* expected a list of lists of numbers"),
        ("objects.0.positions", [[1, 2, float("nan")]], r"positions: .* expected a list of lists of numbers"),
        ("objects.0.color", [1, 2], r"objects\[0\]: color: .* expected 3 numbers"),
        ("slots.0.positions", [[1, 2]], r"slots\[0\]: positions: .* expected lists of 3 numbers"),
        ("stands.1.offset", [1.0], r"stands\[1\]: offset: .* expected 2 numbers"),
        ("skills.0.skill", "grab", r"skills\[0\]: skill: found 'grab', expected one of pick, place, pick_place, go_to"),
        ("skills.6.steps", "put", r"skills\[6\]: steps: found 'put', expected a list of texts"),
        ("safety.policy", "none", r"safety: policy: found 'none', expected one of areas, distance, ssm"),
        ("safety.areas.areas", [{**AREA, "scale": 2}], r"areas: areas\[0\]: scale: .* expected a number from 0 to 1"),
        ("safety.areas.areas", [{**AREA, "low": [0]}], r"areas\[0\]: low: .* expected 2 numbers"),
        ("safety.areas.fall_per_s", 0.0, r"areas: fall_per_s: .* expected a number above 0"),
        ("safety.areas.deceleration", 0, r"areas: deceleration: .* expected a number above 0"),
        ("safety.distance", {"bands": [{"nearer_than_m": 0, "scale": 0}]}, r"bands\[0\]: nearer_than_m: .* above 0"),
        ("safety.ssm", {"reaction_s": -1}, r"ssm: reaction_s: found '-1', expected a number from 0"),
        ("faults", [{"agent": "robot", "task": "put", "probability": 2, "reason": "x"}], r"faults\[0\]: probability"),
        ("protective_stop", {"rate_per_hour": -1}, r"protective_stop: rate_per_hour: found '-1'"),
        ("signals_hz", 51, r"signals_hz: found '51', expected a number from 0 to 50"),
        ("safety.areas.areas", [{**AREA, "guarded": [0, 1]}], r"areas\[0\]: guarded: .* expected 4 numbers"),
        ("human.choice", 0, r"human: choice: found '0', expected a whole number of at least 1"),
        ("longest_s", 0, r"longest_s: found '0', expected a number from 1"),
    ],
)
def test_a_field_that_is_wrong_is_named_with_what_was_found(path: str, value: object, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        small_cell({path: value})


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (
            "skills.0.agent",
            "nobody",
            r"skill of 'pick_red' by 'nobody': the cell has the agents robot, human; name one",
        ),
        (
            "skills.0.objects",
            "green",
            r"skill of 'pick_red' by 'robot': no object is in the group 'green'; the groups are blu",
        ),
        (
            "skills.2.slots",
            "green",
            r"skill of 'put' by 'robot': no slot is in the group 'green'; the groups are bin, shelf",
        ),
        ("skills.5.pose", "up", r"skill of 'step_aside' by 'robot': pose 'up' is unknown; the poses are home, aside"),
        ("skills.6.steps", ["put", "fly"], r"skill of 'tour' by 'robot': step 'fly' is no simple task of 'robot'"),
        ("skills.6.steps", ["tour"], r"skill of 'tour' by 'robot': step 'tour' is no simple task of 'robot'"),
        (
            "skills.6.steps",
            ["pick_white"],
            r"skill of 'tour' by 'robot': step 'pick_white' is no simple task of 'robot'; na",
        ),
        ("skills.6.steps", [], r"skill of 'tour' by 'robot': a sequence without steps; name its tasks in 'steps'"),
        ("stands.0.group", "red", r"skill of 'pick_blue' by 'human': it is not said where to stand for 'blue'"),
        ("skills.13", {"agent": "robot", "task": "put", "skill": "go_to"}, r"skill of 'put by robot' is given twice"),
        ("objects.1.group", "red", r"object 'red_1' is given twice; names must be unique"),
        ("slots.1.group", "bin", r"slot 'bin_1' is given twice"),
        ("fixtures.1.name", "shared_table", r"fixture 'shared_table' is given twice"),
    ],
)
def test_parts_that_contradict_each_other_are_named(path: str, value: object, message: str) -> None:
    with pytest.raises(ScenarioError, match=r"^cell: " + message):
        small_cell({path: value})


def test_an_object_and_a_slot_of_one_name_are_refused_or_kept_apart() -> None:
    # the stock knows both by their names alone
    with pytest.raises(ScenarioError, match="red_1"):
        small_cell({"slots.0.group": "red", "skills.2.slots": "red", "skills.3.slots": "red"})


def test_a_robot_and_a_human_of_one_name_are_refused() -> None:
    skills = [skill for skill in cell_json()["skills"] if skill["agent"] == "robot"]
    with pytest.raises(ScenarioError, match="agent"):
        small_cell({"human.agent": "robot", "skills": skills})


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("safety.areas.areas", [{**AREA, "low": [1, 0]}]),
        ("safety.areas.areas", [{**AREA, "high": [1, -1]}]),
        ("safety.areas.areas", [AREA, AREA]),
        ("objects.0.color", [300, 0, 0]),
        ("objects.0.color", [-1, 0, 0]),
        ("objects.0.size", [0.06, 0.0, 0.06]),
        ("fixtures.0.size", [0.06, -1.0, 0.06]),
        ("fixtures.0.position", [0.0, 0.0, 1e5]),
    ],
)
def test_what_no_log_could_hold_is_refused_when_the_cell_is_read(path: str, value: object) -> None:
    with pytest.raises(ScenarioError):
        small_cell({path: value})


@pytest.mark.parametrize("home", [[2.0, 0.0, -1.57, 1.57, -1.57, -1.57, 0.0], [0.6, 0.0, 1.0, 1.57, -1.57, -1.57, 0.0]])
def test_a_pose_beyond_the_limits_of_the_joints_is_refused(home: list[float]) -> None:
    with pytest.raises(ScenarioError, match="home"):
        small_cell({"robot.poses.home": home})


def test_a_fault_that_is_given_twice_is_refused() -> None:
    fault = {"agent": "robot", "task": "put", "probability": 0.25, "reason": "slipped"}
    with pytest.raises(ScenarioError, match="put"):
        small_cell({"faults": [fault, {**fault, "probability": 0.5}]})


def test_a_stand_that_is_given_twice_is_refused() -> None:
    with pytest.raises(ScenarioError, match="blue"):
        small_cell({"stands.3": {"group": "blue", "offset": [0.0, 0.9]}})


def test_a_policy_of_another_name_is_refused() -> None:
    check_policy("ssm")
    with pytest.raises(ScenarioError, match="safety policy: found 'fast', expected one of areas, distance, ssm"):
        check_policy("fast")


def test_a_cell_survives_json() -> None:
    value = json.loads(json.dumps(cell_json()))
    assert read_cell(JsonRecord(value, "x", CELL_FIELDS)).cell() == small_cell()


def test_the_scene_of_a_cell_can_be_written_into_a_log() -> None:
    cell = small_cell({"safety.areas.areas": [AREA, {**AREA, "name": "slow", "scale": 0.5}]})
    scene = scene_of(cell)
    signal_message(SceneSignal("run", 0, scene), 0)
    assert [box["name"] for box in scene["boxes"]] == [box.name for box in cell.objects]
    assert [area["kind"] for area in scene["areas"]] == ["red", "orange"]
    assert [slot["position"] for slot in scene["slots"]] == [list(slot.position) for slot in cell.slots]


def test_only_the_policy_of_areas_has_areas_to_show() -> None:
    cell = small_cell({"safety.areas.areas": [AREA], "safety.policy": "ssm"})
    assert scene_of(cell)["areas"] == []


def test_another_cell_has_another_digest() -> None:
    digests = [small_scenario(small_cell(change)).cell_digest for change in ({}, {}, {"robot.speed": 0.7})]
    assert digests[0] == digests[1] != digests[2]


def paper_json() -> dict[str, Any]:
    """Return the paper's scenario as JSON values."""
    value: dict[str, Any] = json.loads((SCENARIO_FOLDER / "paper.json").read_text(encoding="utf-8"))
    return value


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, r"file.json: cell: it is not said how 'human' does 'pick_blue_box'; add it to skills"),
        ({"robot.speed": 9}, r"file.json: cell: robot: speed: found '9'"),
    ],
)
def test_a_scenario_says_where_its_cell_is_wrong(changes: dict[str, Any], message: str) -> None:
    value = paper_json() | {"cell": cell_json(changes)}
    with pytest.raises(ScenarioError, match=message):
        scenario_from_json(value, "file.json")


def test_faults_of_tasks_that_nobody_does_are_refused() -> None:
    fault = {"agent": "robot", "task": "dance", "probability": 0.25, "reason": "slipped"}
    with pytest.raises(ScenarioError, match="cell: faults: 'dance' by 'robot' is not in the problem"):
        small_scenario(small_cell({"faults": [fault]}))


def test_a_scenario_cannot_be_guarded_by_a_policy_that_does_not_exist() -> None:
    with pytest.raises(ScenarioError, match="found 'fast', expected one of areas, distance, ssm"):
        with_policy(load_scenario("paper"), "fast")
