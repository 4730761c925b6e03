"""A cell as JSON: read strictly, every error says where."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

from hrclog.errors import ScenarioError
from hrclog.json_record import JsonRecord
from hrclog.scene import scene_text
from hrclog.sim.cell.description import (
    GO_TO,
    HOME,
    LOOKS_HZ,
    PICK,
    PICK_PLACE,
    PLACE,
    SEQUENCE,
    SKILLS,
    Box,
    Cell,
    Fault,
    HumanModel,
    Pose,
    ProtectiveStop,
    RobotModel,
    Skill,
    Slot,
    Stand,
)
from hrclog.sim.cell.safety_settings import (
    AREAS,
    DECELERATION,
    POLICIES,
    Area,
    AreasSettings,
    Band,
    DistanceSettings,
    SafetySettings,
    Slew,
    SsmSettings,
)
from hrclog.sim.cell.scene import scene_of
from hrclog.sim.lognormal import Lognormal

CELL_FIELDS: Final = (
    *("robot", "human", "objects", "fixtures", "slots", "stands", "skills", "safety"),
    *("faults", "protective_stop", "longest_s", "signals_hz"),
)
TIME_FIELDS: Final = ("median_s", "sigma")


def lognormal_from_json(entry: JsonRecord) -> Lognormal:
    """Return the lognormal time of an object with `TIME_FIELDS`."""
    return Lognormal(entry.positive("median_s"), entry.number("sigma", most=5.0))


@dataclass(frozen=True, slots=True)
class CellParts:
    """What a file says of a cell, before its parts are checked against each other."""

    where: str
    fields: Mapping[str, Any]

    def cell(self, file: str = "") -> Cell:
        """Return the cell.

        Args:
            file: whose name stands before errors.

        Raises:
            ScenarioError: the parts contradict each other.
        """
        try:
            cell = Cell(**self.fields)
        except ScenarioError as error:
            raise (error.at(file) if file else error) from None
        _check_scene(cell, self.where)
        return cell


def read_cell(record: JsonRecord) -> CellParts:
    """Return what a JSON object with the fields of `CELL_FIELDS` says of a cell.

    Raises:
        ScenarioError: a field is missing, unknown or wrong, where the record does not collect problems.
    """
    boxes = record.parts(record.records("objects", _GROUP_FIELDS), _objects)
    slots = record.parts(record.records("slots", _SLOT_FIELDS), _slots)
    fields = {
        "robot": record.noted(lambda: _robot(record.record("robot", _ROBOT_FIELDS))),
        "human": record.noted(lambda: _human(record.record("human", _HUMAN_FIELDS))),
        "objects": tuple(box for group in boxes for box in group),
        "fixtures": record.parts(record.records("fixtures", _BOX_FIELDS, required=False), _fixture),
        "slots": tuple(slot for group in slots for slot in group),
        "stands": record.parts(record.records("stands", ("group", "offset")), _stand),
        "skills": record.parts(record.records("skills", _SKILL_FIELDS), _skill),
        "safety": record.noted(lambda: _safety(record)),
        "faults": record.parts(record.records("faults", _FAULT_FIELDS, required=False), _fault),
        "protective_stop": record.noted(lambda: _protective_stop(record)),
        "longest_s": record.number("longest_s", 900.0, least=1.0),
        "signals_hz": record.number("signals_hz", LOOKS_HZ, most=LOOKS_HZ),
    }
    return CellParts(record.where, fields)


def _fault(entry: JsonRecord) -> Fault:
    return Fault(entry.text("agent"), entry.text("task"), entry.number("probability", most=1.0), entry.text("reason"))


def _check_scene(cell: Cell, where: str) -> None:
    """Raise for a scene that no log can hold, before the first run."""
    for policy in POLICIES:
        try:
            scene_text(scene_of(replace(cell, safety=replace(cell.safety, policy=policy))))
        except ValueError as error:
            raise ScenarioError(f"{where}: {error}; correct it") from error


_SLOWEST = 0.01
_FASTEST_M_S = 10.0
_LONGEST_S = 600.0

_ROBOT_FIELDS = (
    *("agent", "rail_y", "base_z", "poses", "speed", "acceleration", "approach", "approach_m", "grasp_s"),
    *("release_s", "planning"),
)
_HUMAN_FIELDS = (
    *("agent", "home", "walk_speed", "hand_speed", "grasp_s", "release_s", "person_sigma", "repetition_sigma"),
    *("hesitation_probability", "hesitation", "yield_m", "patience_s", "choice"),
)
_BOX_FIELDS = ("name", "size", "position", "color")
_GROUP_FIELDS = ("group", "size", "color", "positions")
_SLOT_FIELDS = ("group", "positions")
_FAULT_FIELDS = ("agent", "task", "probability", "reason")
_SKILL_FIELDS = ("agent", "task", "skill", "objects", "slots", "pose", "steps")
_POLICY_FIELDS = {
    "areas": ("areas", "fall_per_s", "rise_per_s", "deceleration"),
    "distance": ("bands", "fall_per_s", "rise_per_s", "deceleration"),
    "ssm": ("human_speed", "reaction_s", "deceleration", "clearance_m", "brakes", "fall_per_s", "rise_per_s"),
}


def _robot(entry: JsonRecord) -> RobotModel:
    names = entry.whole(lambda: entry.names("poses"))
    if names is not None and HOME not in names:
        entry.instead("poses", "at least the pose 'home'", names)
    poses = tuple(Pose(name, numbers(entry.record("poses", names or ()), name, 7)) for name in names or ())
    planning = entry.record("planning", (PICK, PLACE))
    return RobotModel(
        agent=entry.text("agent"),
        rail_y=entry.number("rail_y", least=-math.inf),
        base_z=entry.number("base_z"),
        poses=poses,
        speed=share(entry, "speed"),
        acceleration=share(entry, "acceleration"),
        approach=share(entry, "approach"),
        approach_m=entry.positive("approach_m"),
        grasp_s=_seconds(entry, "grasp_s"),
        release_s=_seconds(entry, "release_s"),
        planning_pick=lognormal_from_json(planning.record(PICK, TIME_FIELDS)),
        planning_place=lognormal_from_json(planning.record(PLACE, TIME_FIELDS)),
    )


def _human(entry: JsonRecord) -> HumanModel:
    x, y, yaw_deg = numbers(entry, "home", 3)
    return HumanModel(
        agent=entry.text("agent"),
        home=(x, y, math.radians(yaw_deg)),
        walk_speed=_speed(entry, "walk_speed"),
        hand_speed=_speed(entry, "hand_speed"),
        grasp_s=_seconds(entry, "grasp_s"),
        release_s=_seconds(entry, "release_s"),
        person_sigma=entry.number("person_sigma", most=1.0),
        repetition_sigma=entry.number("repetition_sigma", most=1.0),
        hesitation_probability=entry.number("hesitation_probability", 0.0, most=1.0),
        hesitation=lognormal_from_json(entry.record("hesitation", TIME_FIELDS))
        if "hesitation" in entry
        else Lognormal(1.0, 0.0),
        yield_m=entry.number("yield_m", 0.0),
        patience_s=entry.number("patience_s", 0.0),
        choice=entry.integer("choice", 3, least=1),
    )


def _objects(entry: JsonRecord) -> list[Box]:
    group, size, color = entry.text("group"), numbers(entry, "size", 3), _color(entry)
    return [
        Box(f"{group}_{number}", size, position, color, group)
        for number, position in enumerate(points(entry, "positions"), 1)
    ]


def _fixture(entry: JsonRecord) -> Box:
    return Box(entry.text("name"), numbers(entry, "size", 3), numbers(entry, "position", 3), _color(entry))


def _slots(entry: JsonRecord) -> list[Slot]:
    group = entry.text("group")
    return [Slot(f"{group}_{number}", group, point) for number, point in enumerate(points(entry, "positions"), 1)]


def _stand(entry: JsonRecord) -> Stand:
    return Stand(entry.text("group"), numbers(entry, "offset", 2))


def _skill(entry: JsonRecord) -> Skill:
    kind = entry.whole(lambda: entry.choice("skill", SKILLS)) or GO_TO
    needed = {PICK: ("objects",), PLACE: ("slots",), PICK_PLACE: ("objects", "slots"), GO_TO: (), SEQUENCE: ("steps",)}
    for name in needed[kind]:
        if name not in entry:
            entry.instead(name, f"it, for a skill of kind {kind}", "")
    return Skill(
        agent=entry.text("agent"),
        task=entry.text("task"),
        kind=kind,
        objects=entry.text("objects", ""),
        slots=entry.text("slots", ""),
        pose=entry.text("pose", "home"),
        steps=entry.texts("steps", ()),
    )


def _safety(record: JsonRecord) -> SafetySettings:
    entry = record.record("safety", ("policy", *POLICIES))
    policy = entry.whole(lambda: entry.choice("policy", tuple(POLICIES)))
    if policy == AREAS and AREAS not in entry:
        entry.instead(AREAS, "the areas that the policy 'areas' goes by", policy)
    parts: dict[str, Any] = {"policy": policy or AREAS}
    for name in POLICIES:
        if name in entry:
            parts[name] = _POLICIES[name](entry.record(name, _POLICY_FIELDS[name]))
    return SafetySettings(**parts)


def _areas(entry: JsonRecord) -> AreasSettings:
    areas = [
        Area(
            area.text("name"),
            numbers(area, "low", 2),
            numbers(area, "high", 2),
            area.number("scale", most=1.0),
            _guarded(area),
        )
        for area in entry.records("areas", ("name", "low", "high", "scale", "guarded"))
    ]
    return AreasSettings(tuple(areas), _slew(entry), _deceleration(entry))


def _guarded(entry: JsonRecord) -> tuple[tuple[float, float], tuple[float, float]] | None:
    if "guarded" not in entry:
        return None
    x0, y0, x1, y1 = numbers(entry, "guarded", 4)
    return (x0, y0), (x1, y1)


def _distance(entry: JsonRecord) -> DistanceSettings:
    bands = entry.whole(lambda: entry.parts(entry.records("bands", ("nearer_than_m", "scale")), _band))
    if bands == ():
        entry.instead("bands", "at least one band", bands)
    return DistanceSettings(bands or (), _slew(entry), _deceleration(entry))


def _band(entry: JsonRecord) -> Band:
    return Band(entry.positive("nearer_than_m"), entry.number("scale", most=1.0))


def _ssm(entry: JsonRecord) -> SsmSettings:
    defaults = SsmSettings()
    return SsmSettings(
        human_speed=entry.number("human_speed", defaults.human_speed),
        reaction_s=entry.number("reaction_s", defaults.reaction_s),
        deceleration=_deceleration(entry),
        clearance_m=entry.number("clearance_m", defaults.clearance_m),
        brakes=entry.positive("brakes") if "brakes" in entry else _deceleration(entry),
        slew=_slew(entry),
    )


_POLICIES: Final[Mapping[str, Any]] = {"areas": _areas, "distance": _distance, "ssm": _ssm}


def _slew(entry: JsonRecord) -> Slew:
    fall, rise = (entry.positive(name) if name in entry else None for name in ("fall_per_s", "rise_per_s"))
    return Slew(fall, rise)


def _deceleration(entry: JsonRecord) -> float:
    return entry.positive("deceleration") if "deceleration" in entry else DECELERATION


def _protective_stop(record: JsonRecord) -> ProtectiveStop:
    defaults = ProtectiveStop()
    if "protective_stop" not in record:
        return defaults
    entry = record.record("protective_stop", ("rate_per_hour", "duration_s"))
    return ProtectiveStop(entry.number("rate_per_hour"), entry.number("duration_s", defaults.duration_s))


def _color(entry: JsonRecord) -> tuple[int, int, int]:
    red, green, blue = (round(value) for value in numbers(entry, "color", 3))
    valid = all(0 <= value <= 255 for value in (red, green, blue))
    return (red, green, blue) if valid else entry.instead("color", "3 numbers from 0 to 255", (0, 0, 0))


def share(entry: JsonRecord, name: str) -> float:
    """Return a number above 0 and at most 1; what is slower than a hundredth does not move in any run."""
    return _number_in_range(entry, name, 1.0, f"a share above 0 and at most 1, no smaller than {_SLOWEST:g}")


def _speed(entry: JsonRecord, name: str) -> float:
    return _number_in_range(entry, name, _FASTEST_M_S, f"a number from {_SLOWEST:g} to {_FASTEST_M_S:g} m/s")


def _number_in_range(entry: JsonRecord, name: str, most: float, expected: str) -> float:
    value = entry.whole(lambda: entry.positive(name))
    if value is None:
        return most
    return value if _SLOWEST <= value <= most else entry.instead(name, expected, most)


def _seconds(entry: JsonRecord, name: str) -> float:
    return entry.number(name, most=_LONGEST_S)


def numbers(entry: JsonRecord, name: str, count: int) -> tuple[Any, ...]:
    """Return a list of a given number of finite numbers."""
    values = entry.whole(lambda: entry.numbers(name))
    if values is None:
        return (0.0,) * count
    return values if len(values) == count else entry.instead(name, f"{count} numbers", (0.0,) * count)


def points(entry: JsonRecord, name: str) -> list[tuple[float, float, float]]:
    """Return a list of points of three finite numbers."""
    triples = []
    for index, values in enumerate(entry.number_lists(name)):
        if len(values) == 3:
            triples.append((values[0], values[1], values[2]))
        else:
            entry.instead(name, f"lists of 3 numbers, found {len(values)} in number {index + 1}", values)
    return triples
