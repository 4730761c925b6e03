"""What runs declare of their tasks: agents, targets, and a guess of how long they take."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from hrclog.events import Role
from hrclog.json_text import parse_json
from hrclog.knowledge.rows import clean_text


@dataclass(frozen=True, slots=True)
class TaskProperties:
    """A task as it was declared; `expected_s` is the guessed duration by agent, where there is one."""

    task: str
    task_type: str = ""
    agents: tuple[str, ...] = ()
    targets: tuple[str, ...] = ()
    role: str = Role.PRIMARY.value
    expected_s: Mapping[str, float] = field(default_factory=dict)

    def to_row(self) -> dict[str, str]:
        """Return the columns of `TASK_PROPERTIES` but for the snapshot, the inverse of `properties_from_row`."""
        return {
            "task": self.task,
            "task_type": self.task_type,
            "agents": _json(self.agents),
            "targets": _json(self.targets),
            "role": self.role,
            "expected_s": _json(dict(self.expected_s)),
        }


def properties_from_row(row: Mapping[str, str]) -> TaskProperties:
    """Return the task of a row of `TASK_PROPERTIES`."""
    return TaskProperties(
        row["task"],
        row["task_type"],
        tuple(parse_json(row["agents"])),
        tuple(parse_json(row["targets"])),
        row["role"],
        parse_json(row["expected_s"]),
    )


def declared_properties(value: object) -> tuple[TaskProperties, ...]:
    """Return the tasks of a run_started event's `task_properties`, sorted; what is not of their form is left out."""
    entries = value if isinstance(value, list) else []
    tasks = {task.task: task for task in map(_task_from_entry, entries) if task is not None}
    return tuple(tasks[name] for name in sorted(tasks))


def snapshot_id(tasks: Iterable[TaskProperties]) -> str:
    """Return the SHA-256 of what is declared, "" of nothing."""
    rows = [task.to_row() for task in tasks]
    return hashlib.sha256(_json(rows).encode()).hexdigest() if rows else ""


def guesses_s(tasks: Iterable[TaskProperties]) -> dict[tuple[str, str], float]:
    """Return the declared guesses by (agent, task), in seconds."""
    return {(agent, task.task): guess for task in tasks for agent, guess in sorted(task.expected_s.items())}


def _task_from_entry(entry: object) -> TaskProperties | None:
    if not isinstance(entry, Mapping) or not isinstance(entry.get("name"), str) or not entry["name"]:
        return None
    agents = _texts(entry.get("agents"))
    return TaskProperties(
        clean_text(entry["name"]),
        _text(entry.get("type")),
        agents,
        _texts(entry.get("targets")),
        _text(entry.get("role")) or Role.PRIMARY.value,
        _guesses(entry.get("expected_s"), agents),
    )


def _guesses(value: object, agents: tuple[str, ...]) -> dict[str, float]:
    """Return the guess by agent of a number for all of them, or of an object by agent."""
    by_agent = value if isinstance(value, Mapping) else dict.fromkeys(agents, value)
    numbers = {clean_text(agent): _seconds(by_agent[agent]) for agent in sorted(by_agent)}
    return {agent: seconds for agent, seconds in numbers.items() if seconds is not None}


def _seconds(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= sys.float_info.max:
        return None
    return float(value)


def _texts(value: object) -> tuple[str, ...]:
    return tuple(map(_text, filter(_text, value))) if isinstance(value, list) else ()


def _text(value: object) -> str:
    return clean_text(value) if isinstance(value, str) else ""


def _json(value: Any) -> str:  # noqa: ANN401 - any JSON value
    return json.dumps(value, ensure_ascii=False, sort_keys=True)
