"""A small cell, and a stage on which its robot and human are told what to do, one command after the other."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from hrclog.events import Event, TaskDispatched, TaskEnded, TaskFact
from hrclog.json_record import JsonRecord
from hrclog.planning.plan import Plan, PlanItem
from hrclog.planning.problem import Count, Problem, Task
from hrclog.recorders.executors.protocol import Command
from hrclog.sim.bullet.engine import BulletCell
from hrclog.sim.cell.description import Cell
from hrclog.sim.cell.from_json import CELL_FIELDS, read_cell
from hrclog.sim.cell.safety_settings import Area, AreasSettings, Slew
from hrclog.sim.event_queue import EventQueue
from hrclog.sim.lognormal import Lognormal
from hrclog.sim.scenario import Gap, Scenario, Work

ROBOT = "robot"
HUMAN = "human"
START_NS = 1_000_000_000_000

_LONGEST = 1000
"""Tenths of a second after which a command that is still under way will never end."""

_TIME = {"median_s": 0.2, "sigma": 0.1}
_CUBE = {"size": [0.06, 0.06, 0.06], "color": [100, 100, 100]}
_TABLE = {"color": [150, 140, 125]}

_CELL: dict[str, Any] = {
    "robot": {
        "agent": ROBOT,
        "rail_y": -0.32,
        "base_z": 1.02,
        "poses": {
            "home": [0.6, 0.0, -1.57, 1.57, -1.57, -1.57, 0.0],
            "aside": [0.0, 0.0, -1.57, 1.57, -1.57, -1.57, 0.0],
        },
        "speed": 0.8,
        "acceleration": 0.8,
        "approach": 0.5,
        "approach_m": 0.1,
        "grasp_s": 0.3,
        "release_s": 0.3,
        "planning": {"pick": _TIME, "place": _TIME},
    },
    "human": {
        "agent": HUMAN,
        "home": [1.0, 1.15, -90],
        "walk_speed": 1.5,
        "hand_speed": 1.2,
        "grasp_s": 0.4,
        "release_s": 0.3,
        "person_sigma": 0.03,
        "repetition_sigma": 0.08,
        "hesitation_probability": 0.0,
        "hesitation": {"median_s": 1.0, "sigma": 0.3},
    },
    "objects": [
        {"group": "red", "positions": [[0.7, -0.65, 1.03], [0.94, -0.65, 1.03]], **_CUBE},
        {"group": "blue", "positions": [[0.92, 0.05, 1.03], [1.16, 0.17, 1.03], [1.4, 0.05, 1.03]], **_CUBE},
        {"group": "white", "positions": [[1.84, 1.25, 0.88], [1.96, 1.43, 0.88]], **_CUBE},
    ],
    "fixtures": [
        {"name": "shared_table", "size": [2.1, 0.55, 0.04], "position": [1.0, 0.17, 0.98], **_TABLE},
        {"name": "red_table", "size": [0.9, 0.2, 0.04], "position": [1.0, -0.655, 0.98], **_TABLE},
        {"name": "white_shelf", "size": [0.4, 0.7, 0.04], "position": [1.9, 1.43, 0.83], **_TABLE},
        {"name": "human_table", "size": [0.4, 0.7, 0.04], "position": [0.1, 1.25, 0.88], **_TABLE},
    ],
    "slots": [
        {"group": "bin", "positions": [[x, y, 1.03] for y in (0.05, 0.17) for x in (0.08, 0.32, 0.56)]},
        {"group": "shelf", "positions": [[x, y, 0.93] for x in (0.07, 0.19) for y in (1.01, 1.25, 1.49)]},
    ],
    "stands": [
        {"group": "blue", "offset": [0.1, 0.55]},
        {"group": "white", "offset": [-0.5, 0.0]},
        {"group": "shelf", "offset": [0.5, 0.0]},
    ],
    "skills": [
        {"agent": ROBOT, "task": "pick_red", "skill": "pick", "objects": "red"},
        {"agent": ROBOT, "task": "pick_blue", "skill": "pick", "objects": "blue"},
        {"agent": ROBOT, "task": "put", "skill": "place", "slots": "bin"},
        {"agent": ROBOT, "task": "carry_red", "skill": "pick_place", "objects": "red", "slots": "bin"},
        {"agent": ROBOT, "task": "go_home", "skill": "go_to"},
        {"agent": ROBOT, "task": "step_aside", "skill": "go_to", "pose": "aside"},
        {"agent": ROBOT, "task": "tour", "skill": "sequence", "steps": ["step_aside", "pick_red", "put"]},
        {"agent": HUMAN, "task": "pick_white", "skill": "pick", "objects": "white"},
        {"agent": HUMAN, "task": "pick_blue", "skill": "pick", "objects": "blue"},
        {"agent": HUMAN, "task": "put", "skill": "place", "slots": "shelf"},
        {"agent": HUMAN, "task": "carry_white", "skill": "pick_place", "objects": "white", "slots": "shelf"},
        {"agent": HUMAN, "task": "go_home", "skill": "go_to"},
        {"agent": HUMAN, "task": "tour", "skill": "sequence", "steps": ["pick_white", "put", "go_home"]},
    ],
    "safety": {"policy": "areas", "areas": {"areas": []}},
}


def cell_json(changes: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the small cell as JSON values, changed.

    Args:
        changes: values by path, as "robot.speed" or "skills.0.task"; a list grows by one at its own length.
    """
    value = copy.deepcopy(_CELL)
    for path, new in (changes or {}).items():
        *way, last = path.split(".")
        part: Any = value
        for name in way:
            part = part[int(name)] if isinstance(part, list) else part.setdefault(name, {})
        if isinstance(part, list):
            part[int(last) : int(last) + 1] = [new]
        else:
            part[last] = new
    return value


def parsed(value: object) -> Cell:
    """Return the cell of JSON values."""
    return read_cell(JsonRecord(value, "cell.json", CELL_FIELDS)).cell()


def small_cell(changes: Mapping[str, Any] | None = None) -> Cell:
    """Return the small cell, changed as by `cell_json`."""
    return parsed(cell_json(changes))


def small_scenario(
    cell: Cell, items: tuple[tuple[str, str], ...] = (), gap_s: float = 0.0, name: str = "small"
) -> Scenario:
    """Return a scenario around a cell, in which the items (agent, task) are to be done, or every task once."""
    keys = list(cell.skill)
    names = dict.fromkeys(task for _, task in keys)
    tasks = tuple(Task(name, tuple(agent for agent, task in keys if task == name), "work") for name in names)
    counts = tuple(
        Count(task, max(items.count((agent, task)), 1), agent) for agent, task in dict.fromkeys(items or keys)
    )
    return Scenario(
        name,
        Problem((cell.robot.agent, cell.human.agent), tasks, counts),
        tuple(Work(agent, task, Lognormal(5.0, 0.1)) for agent, task in keys),
        gaps=tuple(Gap(agent, Lognormal(gap_s, 0.0)) for agent in (ROBOT, HUMAN) if gap_s),
        cell=cell,
    )


def small_plan(*items: tuple[str, str], timeout_s: float | None = None) -> Plan:
    """Return a plan of items (agent, task), each agent in that order."""
    return Plan("small", tuple(PlanItem(f"item{k}", *item, timeout_s=timeout_s) for k, item in enumerate(items)))


class Stage:
    """A cell that is told by hand what to do.

    Args:
        cell: of one run.
        gap_s: how long an agent takes to begin.
        seed: of the run.
    """

    def __init__(self, cell: Cell, gap_s: float = 0.0, seed: int = 1) -> None:
        self.events: list[Event] = []
        self.queue = EventQueue(START_NS)
        self.cell = BulletCell(small_scenario(cell, gap_s=gap_s), self.queue, seed, 0)
        for executor in self.cell.executors.values():
            executor.connect(self.events.append)
        self.cell.watch()
        self._count = 0

    def give(self, agent: str, task: str, *, item: str = "", attempt: int = 1) -> Command:
        """Hand out a command at once; it is carried out when time goes by."""
        self._count += 1
        name = f"c{self._count}"
        command = Command(
            run_id="run",
            command_id=name,
            execution_id=name,
            item_id=item or name,
            agent=agent,
            task=task,
            attempt=attempt,
        )
        self.events.append(
            TaskDispatched(
                time_ns=self.queue.now_ns, agent=agent, task=task, execution_id=name, item_id=command.item_id
            )
        )
        self.cell.executors[agent].start(command)
        return command

    def play(self, for_s: float | None = None) -> Stage:
        """Let time go by: until nothing moves any more, or for a while."""
        if for_s is None:
            self.queue.run()
            return self
        until_ns = self.queue.now_ns + round(for_s * 1e9)
        over: list[bool] = []
        self.queue.schedule(until_ns, lambda: over.append(True), 99)
        self.queue.run(lambda: bool(over))
        return self

    def play_until(self, happened: Callable[[], bool]) -> None:
        """Let time go by, in ticks, until something has happened."""
        for _ in range(10 * _LONGEST):
            if happened():
                return
            self.play(0.01)
        raise AssertionError("it does not happen")

    def do(self, agent: str, task: str, *, item: str = "", attempt: int = 1) -> TaskEnded:
        """Have a command carried out and return its end."""
        command = self.give(agent, task, item=item, attempt=attempt)
        for _ in range(_LONGEST):
            for end in self.ends():
                if end.execution_id == command.execution_id:
                    return end
            self.play(0.1)
        raise AssertionError(f"{task} by {agent} does not end")

    def ends(self) -> list[TaskEnded]:
        """Return every end so far."""
        return [event for event in self.events if isinstance(event, TaskEnded)]

    def of(self, command: Command | TaskFact) -> list[TaskFact]:
        """Return the events of an execution, without that of its parts."""
        return [e for e in self.events if isinstance(e, TaskFact) and e.execution_id == command.execution_id]

    def held(self, agent: str) -> str:
        """Return the name of what an agent holds, "" if nothing."""
        item = self.cell._stock.held_by(agent)
        return item.box.name if item else ""

    def placed(self) -> dict[str, str]:
        """Return the slots in which objects stand, by the objects' names."""
        items = self.cell._stock.items.values()
        return {item.box.name: item.slot.name for item in items if item.slot is not None and not item.held}

    def in_hands(self) -> list[str]:
        """Return whose hands hold something, once for each thing."""
        return [item.agent for item in self.cell._stock.items.values() if item.held]

    def put_back(self, agent: str) -> None:
        """Take what an agent holds out of its hand, and leave it to everybody."""
        item = self.cell._stock.held_by(agent)
        assert item is not None
        item.held, item.agent = False, ""

    def close(self) -> None:
        """Free the cell."""
        self.cell.stop()


def with_areas(
    cell: Cell, *areas: tuple[str, tuple[float, float], tuple[float, float], float], rise: float | None = None
) -> Cell:
    """Return a cell guarded by areas (name, low, high, scale) and nothing else."""
    settings = AreasSettings(tuple(Area(*area) for area in areas), Slew(None, rise))
    return replace(cell, safety=replace(cell.safety, policy="areas", areas=settings))
