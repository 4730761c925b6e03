"""The physical cell of a scenario: where things stand, how its robot and human move, and what guards them. Data."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

from hrclog.errors import ScenarioError
from hrclog.sim.cell.safety_settings import POLICIES, SafetySettings
from hrclog.sim.lognormal import Lognormal

Point = tuple[float, float, float]
AgentTask = tuple[str, str]

PICK: Final = "pick"
PLACE: Final = "place"
PICK_PLACE: Final = "pick_place"
GO_TO: Final = "go_to"
SEQUENCE: Final = "sequence"
HOME: Final = "home"
LOOKS_HZ: Final = 50.0
"""How often the safety policy looks, and how often signals can be sampled."""
SKILLS: Final = (PICK, PLACE, PICK_PLACE, GO_TO, SEQUENCE)


@dataclass(frozen=True, slots=True)
class Box:
    """A box: movable objects have a group that tasks choose from; fixtures (tables) have none. Metres, centre."""

    name: str
    size: Point
    position: Point
    color: tuple[int, int, int]
    group: str = ""


@dataclass(frozen=True, slots=True)
class Slot:
    """A place to put an object; the position is the object's centre once it stands there."""

    name: str
    group: str
    position: Point


@dataclass(frozen=True, slots=True)
class Stand:
    """Where the human stands to reach a group: the offset (x, y) in m from what is reached for."""

    group: str
    offset: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Skill:
    """What a task of an agent is in motion.

    kind: one of `SKILLS`. objects: group picked from. slots: group placed into. pose: name of where to go.
    steps: tasks of the same agent that a sequence is made of.
    """

    agent: str
    task: str
    kind: str
    objects: str = ""
    slots: str = ""
    pose: str = ""
    steps: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Fault:
    """How often an attempt fails, why, and how much of its way it gets."""

    agent: str
    task: str
    probability: float
    reason: str


@dataclass(frozen=True, slots=True)
class Pose:
    """Joint positions (7,) of the robot, m and rad, by a name."""

    name: str
    joints: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class RobotModel:
    """How the robot moves.

    `speed` and `acceleration` are shares of the joints' largest; `approach` is the share of `speed` near a target.
    `grasp_s` and `release_s` are the times the gripper takes to close and to open. One pose is "home".
    """

    agent: str
    rail_y: float
    base_z: float
    poses: tuple[Pose, ...]
    speed: float
    acceleration: float
    approach: float
    approach_m: float
    grasp_s: float
    release_s: float
    planning_pick: Lognormal
    planning_place: Lognormal

    def pose(self, name: str) -> Pose | None:
        """Return a pose by its name, None if there is none of that name."""
        return next((pose for pose in self.poses if pose.name == name), None)

    def planning(self, kind: str) -> Lognormal:
        """Return the time that planning a skill of a kind takes."""
        return self.planning_pick if kind == PICK else self.planning_place

    @property
    def home(self) -> Pose:
        """Where the robot is at first."""
        return next(pose for pose in self.poses if pose.name == HOME)


@dataclass(frozen=True, slots=True)
class HumanModel:
    """How the human moves.

    `home` is (x, y, yaw). Every duration is multiplied by a factor of the person (drawn once a run) and one of the
    repetition (drawn once an attempt), lognormal with median 1. Before a grasp the human hesitates now and then.
    It takes any of the `choice` nearest objects.
    While the robot's gripper is nearer than `yield_m` to what the human wants to pick, it waits, at most `patience_s`.
    """

    agent: str
    home: tuple[float, float, float]
    walk_speed: float
    hand_speed: float
    grasp_s: float
    release_s: float
    person_sigma: float
    repetition_sigma: float
    hesitation_probability: float
    hesitation: Lognormal
    yield_m: float
    patience_s: float
    choice: int


@dataclass(frozen=True, slots=True)
class ProtectiveStop:
    """Stops that no human causes: at any moment of the robot's motion, on average `rate_per_hour`, for a while."""

    rate_per_hour: float = 0.0
    duration_s: float = 3.0


@dataclass(frozen=True)
class Cell:
    """Everything physical about a scenario.

    A run that is not over after `longest_s` is given up; `signals_hz` is how often signals are sampled, 0 for never.

    Raises:
        ScenarioError: parts contradict each other; the message names them.
    """

    robot: RobotModel
    human: HumanModel
    objects: tuple[Box, ...]
    fixtures: tuple[Box, ...]
    slots: tuple[Slot, ...]
    stands: tuple[Stand, ...]
    skills: tuple[Skill, ...]
    safety: SafetySettings
    faults: tuple[Fault, ...] = ()
    protective_stop: ProtectiveStop = field(default_factory=ProtectiveStop)
    longest_s: float = 900.0
    signals_hz: float = LOOKS_HZ

    def __post_init__(self) -> None:
        _check_names("agent", [self.robot.agent, self.human.agent])
        _check_names("object", [box.name for box in self.objects])
        _check_names("slot", [slot.name for slot in self.slots])
        _check_names("object and slot", [box.name for box in self.objects] + [slot.name for slot in self.slots])
        _check_names("fixture", [box.name for box in self.fixtures])
        _check_names("skill of", [f"{skill.task} by {skill.agent}" for skill in self.skills])
        _check_names("stand for", [stand.group for stand in self.stands])
        _check_names("fault of", [f"{fault.task} by {fault.agent}" for fault in self.faults])
        _check_names("area", [area.name for area in self.safety.areas.areas])
        _check_poses(self.robot)
        for skill in self.skills:
            _check_skill(self, skill)

    @cached_property
    def skill(self) -> dict[AgentTask, Skill]:
        """Skill by (agent, task)."""
        return {(skill.agent, skill.task): skill for skill in self.skills}

    @cached_property
    def fault(self) -> dict[AgentTask, Fault]:
        """Fault by (agent, task)."""
        return {(fault.agent, fault.task): fault for fault in self.faults}

    @cached_property
    def stand(self) -> dict[str, tuple[float, float]]:
        """Offset of the human's place by group."""
        return {stand.group: stand.offset for stand in self.stands}

    def objects_of(self, group: str) -> tuple[Box, ...]:
        """Return the movable objects of a group."""
        return tuple(box for box in self.objects if box.group == group)

    def places_of(self, group: str) -> list[tuple[str, Point]]:
        """Return name and position of all that a hand may have to reach in a group: its objects and its slots."""
        objects = [(box.name, box.position) for box in self.objects_of(group)]
        return objects + [(slot.name, slot.position) for slot in self.slots_of(group)]

    def slots_of(self, group: str) -> tuple[Slot, ...]:
        """Return the slots of a group."""
        return tuple(slot for slot in self.slots if slot.group == group)


def check_policy(name: str) -> None:
    """Raise if there is no safety policy of that name.

    Raises:
        ScenarioError: there is none.
    """
    if name not in POLICIES:
        raise ScenarioError(f"safety policy: found {name!r}, expected one of {', '.join(POLICIES)}")


def _check_names(kind: str, names: Iterable[str]) -> None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise ScenarioError(f"cell: {kind} {name!r} is given twice; names must be unique")
        seen.add(name)


def _check_poses(robot: RobotModel) -> None:
    from hrclog.sim.cell.robot_kinematics import JOINT_NAMES, RailArm  # numpy: not for a list of scenarios

    arm = RailArm()
    for pose in robot.poses:
        for name, value, low, high in zip(JOINT_NAMES, pose.joints, arm.lower, arm.upper, strict=True):
            if not low <= value <= high:
                raise ScenarioError(
                    f"cell: pose {pose.name!r}: {name} is {value:g}, expected {low:.4g} to {high:.4g}; correct it"
                )


def _check_skill(cell: Cell, skill: Skill) -> None:
    where = f"cell: skill of {skill.task!r} by {skill.agent!r}"
    if skill.agent not in (cell.robot.agent, cell.human.agent):
        raise ScenarioError(f"{where}: the cell has the agents {cell.robot.agent}, {cell.human.agent}; name one")
    if skill.kind in (PICK, PICK_PLACE) and not cell.places_of(skill.objects):
        raise ScenarioError(f"{where}: no object is in the group {skill.objects!r}; {_groups_text(cell.objects)}")
    if skill.kind in (PLACE, PICK_PLACE) and not cell.slots_of(skill.slots):
        raise ScenarioError(f"{where}: no slot is in the group {skill.slots!r}; {_groups_text(cell.slots)}")
    if skill.kind == GO_TO and skill.agent == cell.robot.agent and cell.robot.pose(skill.pose) is None:
        poses = ", ".join(pose.name for pose in cell.robot.poses)
        raise ScenarioError(f"{where}: pose {skill.pose!r} is unknown; the poses are {poses}")
    _check_steps(cell, skill, where)
    if skill.agent == cell.human.agent:
        for group in (skill.objects, skill.slots):
            if group and group not in cell.stand:
                raise ScenarioError(f"{where}: it is not said where to stand for {group!r}; add it to stands")


def _check_steps(cell: Cell, skill: Skill, where: str) -> None:
    for step in skill.steps:
        step_skill = cell.skill.get((skill.agent, step))
        if step_skill is None or step_skill.kind == SEQUENCE:
            raise ScenarioError(f"{where}: step {step!r} is no simple task of {skill.agent!r}; name its own tasks")
    if skill.kind == SEQUENCE and not skill.steps:
        raise ScenarioError(f"{where}: a sequence without steps; name its tasks in 'steps'")


def _groups_text(members: tuple[Box, ...] | tuple[Slot, ...]) -> str:
    return "the groups are " + ", ".join(sorted({member.group for member in members}))
