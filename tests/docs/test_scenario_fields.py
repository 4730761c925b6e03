"""docs/simulation.md names every field that a scenario file may have, and none that hrclog refuses."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest

from hrclog.errors import ScenarioError
from hrclog.sim.cell.description import Cell, ProtectiveStop
from hrclog.sim.cell.safety_settings import POLICIES, SsmSettings
from hrclog.sim.engine import ENGINES
from hrclog.sim.scenario import SCENARIO_FOLDER, scenario_from_json

ROOT: Final = Path(__file__).parents[2]
PAGE: Final = (ROOT / "docs" / "simulation.md").read_text(encoding="utf-8")
TABLE: Final = re.compile(r"^\| field of `([^`]+)` \|.*\n\|.*\n((?:\|.*\n)+)", re.MULTILINE)
NO_FIELD: Final = "no such field"
TIME: Final = {"median_s": 1.0, "sigma": 0.1}
SLEW: Final = {"fall_per_s": 1.0, "rise_per_s": 1.0, "deceleration": 2.5}
FREE_NAMES: Final = ("cell.robot.poses", "problem.tasks[].expected_s")
"""Objects whose fields are names of poses and of agents."""


def with_every_field() -> dict[str, Any]:
    """Return a scenario file in which every field stands somewhere."""
    value: dict[str, Any] = json.loads((SCENARIO_FOLDER / "kitting.json").read_text(encoding="utf-8"))
    work, task, cell = value["work"], value["problem"]["tasks"][0], value["cell"]
    first, other = ({"agent": entry["agent"], "task": entry["task"]} for entry in (work[0], work[-1]))
    work[0] |= {"failure_probability": 0.1, "failure_reason": "lost", "path_length": 1.0, "planning": TIME}
    pair = first | {"other_agent": other["agent"], "other_task": other["task"]}
    value["synergies"] = [pair | {"synergy": 2.0}, pair | {"stops": True}]
    value["gaps"] = [{"agent": work[0]["agent"], **TIME}]
    value["failures"] = {"max_attempts": 2, "on_failure": "skip"}
    value["safety"] = {"agents": [work[0]["agent"]], "zone": "zone"}
    value["dispatch_mode"] = "sequential"
    task |= {"targets": [], "role": "primary", "resources": [], "release_s": 0, "due_s": 1e6, "expected_s": {}}
    value["problem"]["counts"][0]["agent"] = work[0]["agent"]
    value["problem"]["precedences"] = [{"before": "a", "after": "b", "kind": "all"}]
    cell["human"] |= {"hesitation_probability": 0, "hesitation": TIME, "yield_m": 0, "patience_s": 0, "choice": 1}
    cell["skills"].append(first | {"skill": "sequence", "objects": "", "slots": "", "pose": "home", "steps": []})
    area = {"name": "a", "low": [0, 0], "high": [1, 1], "scale": 0.5, "guarded": [0, 0, 1, 1]}
    cell["safety"] = {
        "policy": "areas",
        "areas": {"areas": [area], **SLEW},
        "distance": {"bands": [{"nearer_than_m": 1.0, "scale": 0.5}], **SLEW},
        "ssm": {"human_speed": 1.6, "reaction_s": 0.1, "clearance_m": 0.2, "brakes": 3.0, **SLEW},
    }
    cell["faults"] = [first | {"probability": 0.1, "reason": "lost"}]
    cell["protective_stop"] = {"rate_per_hour": 1.0, "duration_s": 3.0}
    return copy.deepcopy(value | {"cell": cell | {"longest_s": 900, "signals_hz": 50}})


def objects(value: object, place: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield every JSON object of a file and its place, entries of lists as `[]`."""
    if isinstance(value, dict):
        yield place or "scenario", value
        for name, part in value.items():
            yield from objects(part, f"{place}.{name}" if place else name)
    elif isinstance(value, list):
        for part in value:
            yield from objects(part, f"{place}[]")


def accepted() -> dict[str, set[str]]:
    """Return the fields that hrclog accepts at each place, as its answers to one that it does not know say."""
    value = with_every_field()
    for place, entry in list(objects(value)):
        if place not in FREE_NAMES:
            entry[NO_FIELD] = 1
    with pytest.raises(ScenarioError) as caught:
        scenario_from_json(value, "file")
    fields: dict[str, set[str]] = {}
    for text in caught.value.problems:
        answer = re.fullmatch(rf"file:(.*?):? ?unknown field '{NO_FIELD}'; the fields are (.*)", text)
        if answer is None:  # something of the file contradicts something else
            continue
        place = re.sub(r"\[\d+\]", "[]", answer[1]).strip().replace(": ", ".")
        fields[place or "scenario"] = set(answer[2].split(", "))
    return fields


def documented() -> dict[str, set[str]]:
    """Return the fields that the tables of the page name at each place."""
    return {
        place: {name for row in rows.splitlines() for name in re.findall("`([^`]+)`", row.split("|")[1])}
        for place, rows in TABLE.findall(PAGE)
    }


def test_the_page_names_the_fields_that_are_accepted_and_no_others() -> None:
    fields, pages = accepted(), documented()
    times = {place: names for place, names in fields.items() if names == set(TIME)}
    assert set(times) == {
        *("work[].planning", "cell.human.hesitation"),
        *("cell.robot.planning.pick", "cell.robot.planning.place"),
    }
    assert pages.pop("TIME") == set(TIME)
    assert pages == {place: names for place, names in fields.items() if place not in times}


def test_the_file_that_is_asked_about_has_every_field() -> None:
    there: dict[str, set[str]] = {}
    for place, entry in objects(with_every_field()):
        there.setdefault(place, set()).update(entry)
    assert {place: names - there[place] for place, names in accepted().items() if names - there[place]} == {}


def default(place: str, name: str) -> str:
    rows = dict(TABLE.findall(PAGE))[place].splitlines()
    return next(row for row in rows if f"`{name}`" in row.split("|")[1]).split("|")[-2].strip()


def test_the_page_gives_the_defaults_of_the_code() -> None:
    ssm = SsmSettings()
    for name in ("human_speed", "reaction_s", "deceleration", "clearance_m"):
        assert default("cell.safety.ssm", name) == f"{getattr(ssm, name):g}"
    for policy in ("areas", "distance"):
        assert default(f"cell.safety.{policy}", "deceleration") == f"{ssm.deceleration:g}"
    assert default("cell", "longest_s") == f"{Cell.longest_s:g}"
    assert default("cell", "signals_hz") == f"{Cell.signals_hz:g}"
    assert default("cell.protective_stop", "duration_s") == f"{ProtectiveStop().duration_s:g}"


def test_the_page_tells_the_policies_and_engines_as_their_tables_do() -> None:
    rows = re.search(r"\| policy \|.*\n.*\n((?:\|.*\n)+)", PAGE)
    assert rows
    cells = [tuple(cell.strip() for cell in row.split("|")[1:3]) for row in rows[1].splitlines()]
    assert cells == [(f"`{policy.name}`", policy.summary) for policy in POLICIES.values()]
    for option, names in (("--safety", list(POLICIES)), ("--engine", ENGINES)):
        assert f"`{option} " + r"\|".join(names) + "`" in PAGE
    assert all(f"- **`{name}`**" in PAGE for name in ENGINES)


def test_modules_and_files_that_the_page_names_exist() -> None:
    for module in re.findall(r"hrclog\.(sim[\w.]*)", PAGE):
        path = ROOT / module.replace(".", "/")
        assert path.is_dir() or path.with_suffix(".py").is_file(), module
    for name in re.findall(r"`([\w-]+\.json)`", PAGE):
        assert name == "truth.json" or (SCENARIO_FOLDER / name).is_file(), name
