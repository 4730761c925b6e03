"""Read a problem from the JSON object of a file."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from hrclog.errors import ScenarioError
from hrclog.events import Role
from hrclog.json_record import JsonRecord
from hrclog.planning.problem import Count, Precedence, PrecedenceKind, Problem, Task

PROBLEM_FIELDS: Final = ("agents", "tasks", "counts", "precedences")

_TASK_FIELDS: Final = (
    *("name", "type", "agents", "targets", "role"),
    *("resources", "release_s", "due_s", "expected_s"),
)


@dataclass(frozen=True, slots=True)
class ProblemParts:
    """What a file says of a problem, before its parts are checked against each other."""

    where: str
    agents: tuple[str, ...]
    tasks: tuple[Task, ...]
    counts: tuple[Count, ...]
    precedences: tuple[Precedence, ...]

    def problem(self) -> Problem:
        """Return the problem.

        Raises:
            ScenarioError: the parts contradict each other.
        """
        try:
            return Problem(self.agents, self.tasks, self.counts, self.precedences)
        except ScenarioError as error:
            raise error.at(self.where) from error


def problem_from_json(record: JsonRecord) -> Problem:
    """Return the problem of a JSON object with the fields of `PROBLEM_FIELDS`.

    Raises:
        ScenarioError: a field is missing or wrong, or the parts contradict each other.
    """
    parts = read_problem(record)
    record.check()
    return parts.problem()


def read_problem(record: JsonRecord) -> ProblemParts:
    """Return what a JSON object with the fields of `PROBLEM_FIELDS` says of a problem.

    Raises:
        ScenarioError: a field is missing or wrong, where the record does not collect problems.
    """
    tasks = record.parts(record.records("tasks", _TASK_FIELDS), _task_from_json)
    counts = record.parts(
        record.records("counts", ("task", "agent", "count")),
        lambda entry: Count(entry.text("task"), entry.integer("count"), entry.text("agent", "")),
    )
    precedences = record.parts(
        record.records("precedences", ("before", "after", "kind"), required=False),
        _precedence_from_json,
    )
    return ProblemParts(record.where, record.texts("agents"), tasks, counts, precedences)


def _task_from_json(entry: JsonRecord) -> Task:
    agents = entry.texts("agents")
    return Task(
        name=entry.text("name"),
        agents=agents,
        task_type=entry.text("type", ""),
        targets=entry.texts("targets", ()),
        role=Role(entry.choice("role", tuple(Role), Role.PRIMARY)),
        resources=entry.texts("resources", ()),
        release_s=entry.number("release_s", 0.0),
        due_s=entry.number("due_s") if "due_s" in entry else None,
        expected_s=_expected_s(entry, agents),
    )


def _expected_s(entry: JsonRecord, agents: Iterable[str]) -> dict[str, float]:
    """Return the declared durations by agent; a single number holds for all of them."""
    if "expected_s" not in entry:
        return {}
    strict = entry.strict()
    with suppress(ScenarioError):
        return dict.fromkeys(agents, strict.positive("expected_s"))
    try:
        names = strict.names("expected_s")
    except ScenarioError as error:
        raise entry.error("expected_s", "a number above 0, or an object with one for each agent") from error
    by_agent = entry.record("expected_s", names)
    return {agent: by_agent.positive(agent) for agent in names}


def _precedence_from_json(entry: JsonRecord) -> Precedence:
    kind = entry.choice("kind", tuple(PrecedenceKind), PrecedenceKind.NEXT)
    return Precedence(entry.text("before"), entry.text("after"), PrecedenceKind(kind))
