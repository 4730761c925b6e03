"""A scenario: the problem of a cell, and how its agents really behave. Data, read from JSON."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Final, TypeVar

from hrclog.errors import ScenarioError
from hrclog.events import Role
from hrclog.json_record import JsonRecord, check_all, read_json
from hrclog.planning.dispatch_mode import DispatchMode
from hrclog.planning.problem import Problem
from hrclog.planning.problem_json import PROBLEM_FIELDS, read_problem
from hrclog.sim.cell.description import Cell
from hrclog.sim.cell.from_json import CELL_FIELDS, TIME_FIELDS, lognormal_from_json, read_cell
from hrclog.sim.lognormal import Lognormal

SCENARIO_FOLDER: Final = Path(__file__).parent / "scenarios"

SKIP: Final = "skip"
ABORT: Final = "abort"
SEQUENTIAL: Final = DispatchMode.SEQUENTIAL

AgentTask = tuple[str, str]
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Work:
    """What a task takes an agent when nobody hinders it, and how it may fail.

    `path_length` (m) belongs to the median work and grows with the work drawn; 0 logs none.
    """

    agent: str
    task: str
    time: Lognormal
    failure_probability: float = 0.0
    failure_reason: str = "task failed"
    path_length: float = 0.0
    planning: Lognormal | None = None


@dataclass(frozen=True, slots=True)
class Synergy:
    """Factor on the duration of an agent's task while another agent runs another; infinite where it stops."""

    agent: str
    task: str
    other_agent: str
    other_task: str
    factor: float


@dataclass(frozen=True, slots=True)
class Gap:
    """The time an agent takes from being given a task to starting it."""

    agent: str
    time: Lognormal


@dataclass(frozen=True, slots=True)
class Failures:
    """How often a task is tried, and whether the run goes on without it (`skip`) or ends (`abort`)."""

    max_attempts: int = 1
    on_failure: str = SKIP


@dataclass(frozen=True, slots=True)
class Safety:
    """The agents whose slowing down is a safety function's doing and is logged, and the zone it watches."""

    agents: tuple[str, ...] = ()
    zone: str = ""


@dataclass(frozen=True)
class Scenario:
    """A problem and the truth about its agents.

    Raises:
        ScenarioError: something is missing or impossible; the message names it.
    """

    name: str
    problem: Problem
    works: tuple[Work, ...]
    synergies: tuple[Synergy, ...] = ()
    gaps: tuple[Gap, ...] = ()
    failures: Failures = Failures()
    safety: Safety = Safety()
    dispatch_mode: str = SEQUENTIAL
    description: str = ""
    cell: Cell | None = None

    def __post_init__(self) -> None:
        _check(self)

    @cached_property
    def work(self) -> dict[AgentTask, Work]:
        """Work by (agent, task)."""
        return {(work.agent, work.task): work for work in self.works}

    @cached_property
    def gap(self) -> dict[str, Lognormal]:
        """Gap by agent; agents not named have none."""
        return {gap.agent: gap.time for gap in self.gaps}

    @cached_property
    def factors(self) -> dict[tuple[AgentTask, AgentTask], float]:
        """Factor s by (agent, task) and (other agent, other task), where it is given."""
        return {((s.agent, s.task), (s.other_agent, s.other_task)): s.factor for s in self.synergies}

    @cached_property
    def rates(self) -> dict[AgentTask, dict[AgentTask, float]]:
        """Rate of work of (agent, task) while another (agent, task) runs, where it is not 1."""
        rates: dict[AgentTask, dict[AgentTask, float]] = {key: {} for key in self.problem.agent_tasks()}
        for (key, other), factor in self.factors.items():
            rates[key][other] = 1.0 / factor
        return rates

    @cached_property
    def durations_s(self) -> dict[AgentTask, float]:
        """Mean duration of (agent, task) when nobody hinders it."""
        return {key: work.time.mean_s for key, work in self.work.items()}

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all that the scenario says of its discrete events, as hexadecimal text."""
        scenario = asdict(replace(self, cell=None), dict_factory=_without_defaults)
        event_fields = {name: value for name, value in scenario.items() if name != "cell"}
        return hashlib.sha256(json.dumps(event_fields, sort_keys=True).encode()).hexdigest()

    @cached_property
    def cell_digest(self) -> str:
        """SHA-256 of the physical cell, as hexadecimal text."""
        return hashlib.sha256(json.dumps(self.cell and asdict(self.cell), sort_keys=True).encode()).hexdigest()


_DEFAULTS: Final = {"role": Role.PRIMARY, "resources": (), "release_s": 0.0, "due_s": None, "expected_s": {}}


def _without_defaults(fields: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return fields without defaults of a task, so that the digest equals that from before these fields existed."""
    return {name: value for name, value in fields if name not in _DEFAULTS or value != _DEFAULTS[name]}


def scenario_names() -> list[str]:
    """Return the names of the scenarios that come with hrclog."""
    return sorted(path.stem for path in SCENARIO_FOLDER.glob("*.json"))


def load_scenario(name: str | Path) -> Scenario:
    """Return a scenario by its name or its file.

    Args:
        name: one of `scenario_names()`, or the path of a JSON file.

    Raises:
        ScenarioError: unknown, unreadable, or not a valid scenario.
    """
    path = SCENARIO_FOLDER / f"{name}.json"
    if not path.is_file():
        path = Path(name)
    if not path.is_file():
        names = ", ".join(scenario_names())
        raise ScenarioError(f"scenario {str(name)!r}: neither a file nor a known name; the names are {names}")
    return scenario_from_json(read_json(path, "a scenario"), str(path))


def scenario_from_json(value: object, where: str) -> Scenario:
    """Return the scenario of a JSON value.

    Args:
        value: the parsed JSON.
        where: file name, for messages.

    Raises:
        ScenarioError: a field is missing, unknown, wrong or contradicts another.
    """
    record = JsonRecord(value, where, _SCENARIO_FIELDS, problems=[])
    problem_parts = record.whole(lambda: read_problem(record.record("problem", PROBLEM_FIELDS)))
    cell_parts = record.whole(lambda: read_cell(record.record("cell", CELL_FIELDS))) if "cell" in record else None
    problem = record.noted(problem_parts.problem) if problem_parts else None
    cell = record.noted(partial(cell_parts.cell, where)) if cell_parts else None
    parts: dict[str, Any] = {
        "name": _name(record),
        "works": record.parts(record.records("work", _WORK_FIELDS), _work),
        "synergies": record.parts(record.records("synergies", _SYNERGY_FIELDS, required=False), _synergy),
        "gaps": record.parts(record.records("gaps", ("agent", *TIME_FIELDS), required=False), _gap),
        "failures": _failures(record),
        "safety": _safety(record),
        "dispatch_mode": record.choice("dispatch_mode", tuple(DispatchMode), SEQUENTIAL),
        "description": record.text("description", ""),
    }
    record.check()
    if problem is None:
        raise ScenarioError(f"{where}: problem: cannot be read")  # not so: what keeps it from being read was noted
    try:
        return Scenario(problem=problem, **parts, cell=cell)
    except ScenarioError as error:
        raise error.at(where) from error


_SCENARIO_FIELDS = (
    *("name", "description", "problem", "work", "synergies", "gaps", "failures", "safety", "dispatch_mode"),
    "cell",
)
_WORK_FIELDS = (
    *("agent", "task", *TIME_FIELDS),
    *("failure_probability", "failure_reason", "path_length", "planning"),
)
_SYNERGY_FIELDS = ("agent", "task", "other_agent", "other_task", "synergy", "stops")


def _name(record: JsonRecord) -> str:
    name = record.whole(lambda: record.text("name")) or ""
    if name:
        record.noted(partial(_check_name, name, f"{record.where}: "))
    return name


def _work(entry: JsonRecord) -> Work:
    return Work(
        agent=entry.text("agent"),
        task=entry.text("task"),
        time=lognormal_from_json(entry),
        failure_probability=entry.number("failure_probability", 0.0, most=1.0),
        failure_reason=entry.text("failure_reason", "task failed"),
        path_length=entry.number("path_length", 0.0),
        planning=lognormal_from_json(entry.record("planning", TIME_FIELDS)) if "planning" in entry else None,
    )


def _synergy(entry: JsonRecord) -> Synergy:
    stops = entry.whole(lambda: entry.flag("stops"))
    if stops and "synergy" in entry:
        entry.instead("synergy", "nothing, as the task stops", None)
    factor = entry.positive("synergy") if stops is False else math.inf
    return Synergy(entry.text("agent"), entry.text("task"), entry.text("other_agent"), entry.text("other_task"), factor)


def _gap(entry: JsonRecord) -> Gap:
    return Gap(entry.text("agent"), lognormal_from_json(entry))


def _failures(record: JsonRecord) -> Failures:
    if "failures" not in record:
        return Failures()
    entry = record.record("failures", ("max_attempts", "on_failure"))
    return Failures(entry.integer("max_attempts", 1, least=1), entry.choice("on_failure", (SKIP, ABORT), SKIP))


def _safety(record: JsonRecord) -> Safety:
    if "safety" not in record:
        return Safety()
    entry = record.record("safety", ("agents", "zone"))
    return Safety(entry.texts("agents"), entry.text("zone", ""))


def _check(scenario: Scenario) -> None:
    check_all(_checks(scenario))


def _checks(scenario: Scenario) -> Iterator[Callable[[], object]]:
    """Yield checks that depend on no other."""
    yield partial(_check_name, scenario.name)
    yield partial(_check_choice, "dispatch_mode", scenario.dispatch_mode, tuple(DispatchMode))
    yield partial(_check_choice, "failures: on_failure", scenario.failures.on_failure, (SKIP, ABORT))
    yield from _key_checks(scenario)
    yield partial(_check_stops, scenario)
    if scenario.cell is not None:
        yield partial(_check_cell, scenario, scenario.cell)


def _check_name(name: str, place: str = "") -> None:
    if not name or not set(name) <= _NAME_CHARACTERS:
        expected = "letters, digits, '-' and '_' (it begins file names)"
        raise ScenarioError(f"{place}name: found {name!r}, expected {expected}; rename it")


def _check_cell(scenario: Scenario, cell: Cell) -> None:
    possible = set(scenario.problem.agent_tasks())
    for agent, task in sorted(possible - set(cell.skill)):
        raise ScenarioError(f"cell: it is not said how {agent!r} does {task!r}; add it to skills")
    for agent, task in sorted({(fault.agent, fault.task) for fault in cell.faults}):
        _check_possible("cell: faults", (agent, task), possible)
    for kind in scenario.problem.tasks:
        for agent in kind.agents:
            boxes = [box.name for box in cell.objects_of(cell.skill[agent, kind.name].objects)]
            for name in kind.targets:
                if name not in boxes:
                    known_names = ", ".join(boxes) or "none"
                    raise ScenarioError(
                        f"task {kind.name!r}: target {name!r} is not in the cell, which has {known_names}"
                    )


_NAME_CHARACTERS = frozenset("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_")


def _check_choice(field: str, value: str, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise ScenarioError(f"{field}: found {value!r}, expected one of {', '.join(allowed)}")


def _key_checks(scenario: Scenario) -> Iterator[Callable[[], object]]:
    """Yield checks that entries on agents and tasks are unique, complete, and name existing agents and tasks."""
    possible = set(scenario.problem.agent_tasks())
    work_keys = [(work.agent, work.task) for work in scenario.works]
    for agent, task in _duplicates(work_keys):
        yield partial(_fail, f"work: {task!r} by {agent!r} is given twice; remove one")
    for agent, task in sorted(possible - set(work_keys)):
        yield partial(_fail, f"work: {task!r} by {agent!r} is missing; add its median_s and sigma")
    for key in work_keys:
        yield partial(_check_possible, "work", key, possible)
    pairs = [((s.agent, s.task), (s.other_agent, s.other_task)) for s in scenario.synergies]
    for key, other in pairs:
        yield partial(_check_pair, key, other, possible)
    for key, other in _duplicates(pairs):
        yield partial(_fail, f"synergies: {key[1]!r} by {key[0]!r} with {other[1]!r} by {other[0]!r} is given twice")
    agents = [gap.agent for gap in scenario.gaps]
    for agent in (*agents, *scenario.safety.agents):
        if agent not in scenario.problem.agents:
            known_names = ", ".join(scenario.problem.agents)
            yield partial(_fail, f"gaps or safety: agent {agent!r} is unknown; the agents are {known_names}")
    for agent in _duplicates(agents):
        yield partial(_fail, f"gaps: agent {agent!r} is given twice; remove one")


def _check_pair(key: AgentTask, other: AgentTask, possible: set[AgentTask]) -> None:
    _check_possible("synergies", key, possible)
    _check_possible("synergies", other, possible)
    if key[0] == other[0]:
        raise ScenarioError(f"synergies: {key[1]!r} by {key[0]!r} with its own {other[1]!r}; name another agent")


def _fail(problem: str) -> None:
    raise ScenarioError(problem)


def _duplicates(values: list[T]) -> Iterator[T]:
    seen: set[T] = set()
    for value in values:
        if value in seen:
            yield value
        seen.add(value)


def _check_possible(field: str, key: AgentTask, possible: set[AgentTask]) -> None:
    if key not in possible:
        raise ScenarioError(f"{field}: {key[1]!r} by {key[0]!r} is not in the problem; check the names and the agents")


def _check_stops(scenario: Scenario) -> None:
    stops = {((s.agent, s.task), (s.other_agent, s.other_task)) for s in scenario.synergies if math.isinf(s.factor)}
    for (agent, task), (other, other_task) in sorted(stops):
        if agent not in scenario.safety.agents:
            raise ScenarioError(
                f"synergies: {task!r} by {agent!r} stops, but no safety function watches it; add it to safety"
            )
        if ((other, other_task), (agent, task)) in stops:
            raise ScenarioError(
                f"synergies: {task!r} by {agent!r} and {other_task!r} by {other!r} stop each other for ever"
            )
