"""What is to be done: tasks, the agents that can do them, how often, and what must come before what.

A problem says nothing about order or time; a plan (`hrclog.planning.plan`) does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial
from graphlib import CycleError, TopologicalSorter
from typing import Any, Final

from hrclog.errors import ScenarioError
from hrclog.events import Role
from hrclog.json_record import check_all
from hrclog.wording import counted

LONGEST_S: Final = 1e7
"""Four months: what is longer is no task of a run."""

MOST_TIMES: Final = 10_000
"""How often a task may be done in a run."""


class PrecedenceKind(StrEnum):
    """How the executions of two tasks are paired.

    NEXT: an agent does `after` right after its own `before` (place what was picked).
    EACH: the k-th `after` of the run waits for the k-th `before`, whoever did it (a hand-over).
    ALL: every `after` waits for all of `before`.
    """

    NEXT = "next"
    EACH = "each"
    ALL = "all"


@dataclass(frozen=True, slots=True)
class Task:
    """A kind of work, the agents that can do it, and the objects it may choose from (none: no choice to log).

    An auxiliary task (`go_home`) counts in timelines only, and without a count of its own it may stand anywhere in a
    plan, as often as one likes.

    `resources` names what only one execution at a time may use, whichever task and agent it is of: a fixture, a tool.
    No execution starts earlier than `release_s`, and all have ended by `due_s`, seconds from the start of the run; only
    planners look at the latter. `expected_s` is a declared guess of the duration, by agent, where there is one.
    """

    name: str
    agents: tuple[str, ...]
    task_type: str = ""
    targets: tuple[str, ...] = ()
    role: str = Role.PRIMARY
    resources: tuple[str, ...] = ()
    release_s: float = 0.0
    due_s: float | None = None
    expected_s: Mapping[str, float] = field(default_factory=dict, hash=False)


@dataclass(frozen=True, slots=True)
class Count:
    """How often a task is to be done, by one agent or, with `agent` "", by any that can."""

    task: str
    count: int
    agent: str = ""


@dataclass(frozen=True, slots=True)
class Precedence:
    """One task before another."""

    before: str
    after: str
    kind: PrecedenceKind = PrecedenceKind.NEXT


@dataclass(frozen=True, slots=True)
class Unit:
    """Tasks that one agent does without anything in between, and the agents that may be chosen for it."""

    tasks: tuple[str, ...]
    agents: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Problem:
    """Tasks, agents, domains, counts and precedences.

    Raises:
        ScenarioError: they contradict each other; the message names the part.
    """

    agents: tuple[str, ...]
    tasks: tuple[Task, ...]
    counts: tuple[Count, ...]
    precedences: tuple[Precedence, ...] = ()

    def __post_init__(self) -> None:
        check_all(_checks(self))
        check_all([partial(_check_units, self), partial(_check_dues, self)])  # these ask for all the others

    def task(self, name: str) -> Task:
        """Return a task by name.

        Raises:
            ScenarioError: there is none of that name.
        """
        for task in self.tasks:
            if task.name == name:
                return task
        names = ", ".join(task.name for task in self.tasks)
        raise ScenarioError(f"task {name!r}: unknown; the tasks are {names}")

    def total(self, name: str) -> int:
        """Return how often a task is done in a run, by all agents together."""
        return sum(count.count for count in self.counts if count.task == name)

    def is_extra(self, name: str) -> bool:
        """Return whether a plan may hold a task as often as it likes: it is auxiliary and has no count."""
        return self.task(name).role == Role.AUXILIARY and all(count.task != name for count in self.counts)

    def agent_tasks(self) -> list[tuple[str, str]]:
        """Return every (agent, task) that may happen, in order of agents, then tasks."""
        return [(agent, task.name) for agent in self.agents for task in self.tasks if agent in task.agents]

    def units(self) -> list[Unit]:
        """Return all that is to be done, in pieces that one agent does without anything in between."""
        follower = {p.before: p.after for p in self.precedences if p.kind is PrecedenceKind.NEXT}
        heads = [count for count in self.counts if count.task not in follower.values()]
        units: list[Unit] = []
        for head in heads:
            chain = tuple(_follow(head.task, follower))
            units += [Unit(chain, _unit_agents(self, chain, head.agent))] * head.count
        return units

    def to_json(self) -> dict[str, Any]:
        """Return the problem as JSON values, the inverse of `problem_json.problem_from_json`."""
        return {
            "agents": list(self.agents),
            "tasks": [_task_json(task) for task in self.tasks],
            "counts": [
                {"task": c.task, "count": c.count} | ({"agent": c.agent} if c.agent else {}) for c in self.counts
            ],
            "precedences": [{"before": p.before, "after": p.after, "kind": str(p.kind)} for p in self.precedences],
        }


def _task_json(task: Task) -> dict[str, Any]:
    values: dict[str, Any] = {
        "name": task.name,
        "type": task.task_type,
        "agents": list(task.agents),
        "targets": list(task.targets),
    }
    if task.role != Role.PRIMARY:
        values["role"] = str(task.role)
    if task.resources:
        values["resources"] = list(task.resources)
    if task.release_s:
        values["release_s"] = task.release_s
    if task.due_s is not None:
        values["due_s"] = task.due_s
    if task.expected_s:
        values["expected_s"] = dict(task.expected_s)
    return values


def _follow(task: str, follower: dict[str, str]) -> Iterator[str]:
    current: str | None = task
    while current is not None:
        yield current
        current = follower.get(current)


def _unit_agents(problem: Problem, chain: tuple[str, ...], agent: str) -> tuple[str, ...]:
    if agent:
        return (agent,)
    domains = [problem.task(name).agents for name in chain]
    return tuple(a for a in problem.agents if all(a in domain for domain in domains))


def _checks(problem: Problem) -> Iterator[Callable[[], object]]:
    """Yield checks that depend on no other."""
    yield partial(_unique, "agent", problem.agents)
    yield partial(_unique, "task", [task.name for task in problem.tasks])
    for task in problem.tasks:
        yield partial(_check_task, problem, task)
    yield partial(_check_counted, problem)
    for count in problem.counts:
        yield partial(_check_count, problem, count)
    for task in problem.tasks:
        yield partial(_check_targets, problem, task)
    for precedence in problem.precedences:
        yield partial(_check_precedence, problem, precedence)
    nexts = [p for p in problem.precedences if p.kind is PrecedenceKind.NEXT]
    yield partial(_unique, "tasks that come next after", [p.before for p in nexts])
    yield partial(_unique, "tasks that come right before", [p.after for p in nexts])
    yield partial(_check_cycles, problem)


def _check_task(problem: Problem, task: Task) -> None:
    if not task.agents:
        raise ScenarioError(f"task {task.name!r}: no agent can do it; name at least one in its agents")
    for agent in task.agents:
        _known_agent(problem, agent, f"task {task.name!r}")
    _unique(f"task {task.name!r}: target", task.targets)
    _unique(f"task {task.name!r}: resource", task.resources)
    _check_times(task)


def _check_times(task: Task) -> None:
    if not 0.0 <= task.release_s <= LONGEST_S:
        raise ScenarioError(
            f"task {task.name!r}: release_s: found {task.release_s:g}, expected a number from 0 to {LONGEST_S:g}"
        )
    if task.due_s is not None and not task.release_s < task.due_s <= LONGEST_S:
        expected = f"a number above its release_s = {task.release_s:g}"
        raise ScenarioError(f"task {task.name!r}: due_s: found {task.due_s:g}, expected {expected}")
    for agent, expected_s in task.expected_s.items():
        if agent not in task.agents:
            domain = ", ".join(task.agents)
            raise ScenarioError(f"task {task.name!r}: expected_s: {agent!r} cannot do it, only {domain} can")
        if not 0.0 < expected_s <= LONGEST_S:
            where = f"task {task.name!r}: expected_s of {agent!r}"
            raise ScenarioError(f"{where}: found {expected_s:g}, expected a number above 0, at most {LONGEST_S:g}")


def _unique(what: str, names: Iterable[str]) -> None:
    seen: set[str] = set()
    for name in names:
        if not name or name in seen:
            raise ScenarioError(f"{what} {name!r}: " + ("named twice" if name else "empty") + "; names must be unique")
        seen.add(name)


def _known_agent(problem: Problem, agent: str, where: str) -> None:
    if agent not in problem.agents:
        known = ", ".join(problem.agents) or "none"
        raise ScenarioError(f"{where}: agent {agent!r} is unknown; the agents are {known}")


def _check_counted(problem: Problem) -> None:
    if not sum(count.count for count in problem.counts):
        raise ScenarioError("counts: nothing is to be done; give at least one task a count above 0")
    _unique("count of", [f"{count.task} by {count.agent or 'any agent'}" for count in problem.counts])


def _check_count(problem: Problem, count: Count) -> None:
    task = problem.task(count.task)
    if count.count < 0:
        raise ScenarioError(f"count of {count.task!r}: found {count.count}, expected 0 or more")
    if count.count > MOST_TIMES:
        raise ScenarioError(f"count of {count.task!r}: found {count.count}, expected at most {MOST_TIMES:,} in a run")
    if count.agent:
        _known_agent(problem, count.agent, f"count of {count.task!r}")
        if task.agents and count.agent not in task.agents:
            domain = ", ".join(task.agents)
            raise ScenarioError(f"count of {count.task!r}: {count.agent!r} cannot do it, only {domain} can")


def _check_targets(problem: Problem, task: Task) -> None:
    if task.targets and problem.total(task.name) > len(task.targets):
        counts_text = f"{counted(problem.total(task.name), 'execution')} for {counted(len(task.targets), 'target')}"
        raise ScenarioError(f"task {task.name!r}: {counts_text}; lower its counts or add targets")


def _check_precedence(problem: Problem, p: Precedence) -> None:
    problem.task(p.before)
    problem.task(p.after)
    if p.kind is PrecedenceKind.NEXT:
        _check_next(problem, p)
    elif p.kind is PrecedenceKind.EACH and problem.total(p.before) < problem.total(p.after):
        counts_text = f"{problem.total(p.before)} and {problem.total(p.after)}"
        raise ScenarioError(
            f"{_name(p)}: each waits for one of its own, so at least as many before; found {counts_text}"
        )


def _check_next(problem: Problem, p: Precedence) -> None:
    if not set(problem.task(p.before).agents) & set(problem.task(p.after).agents):
        raise ScenarioError(f"{_name(p)}: one agent must do both, and none can; give them an agent in common")
    before, after = (
        {count.agent: count.count for count in problem.counts if count.task == name and count.count}
        for name in (p.before, p.after)
    )
    if before != after:
        agent = min((set(before) | set(after)), key=lambda a: (before.get(a) == after.get(a), a))
        counts_text = f"{before.get(agent, 0)} and {after.get(agent, 0)}"
        raise ScenarioError(f"{_name(p)}: {agent or 'any agent'} must do both equally often, found {counts_text}")


def _check_cycles(problem: Problem) -> None:
    sorter: TopologicalSorter[str] = TopologicalSorter()
    for p in problem.precedences:
        sorter.add(p.after, p.before)
    try:
        sorter.prepare()
    except CycleError as error:
        cycle = " -> ".join(error.args[1])
        raise ScenarioError(f"precedences: {cycle} is a cycle, so none of them can come first; remove one") from error


def _check_units(problem: Problem) -> None:
    for unit in problem.units():
        if not unit.agents:
            chain = " -> ".join(unit.tasks)
            raise ScenarioError(f"tasks {chain}: one agent must do all of them, and none can; widen their agents")


def _check_dues(problem: Problem) -> None:
    """Raise if a task is due before something that it waits for may start."""
    counted = {task.name: task for task in problem.tasks if problem.total(task.name)}
    before: dict[str, set[str]] = {name: set() for name in counted}
    for p in problem.precedences:
        if p.before in counted and p.after in counted:
            before[p.after].add(p.before)
    latest: dict[str, Task] = {}  # of all that comes before a task and itself, the one released last
    for name in TopologicalSorter(before).static_order():
        task = counted[name]
        last_released = max((latest[other] for other in sorted(before[name])), key=lambda t: t.release_s, default=task)
        latest[name] = last_released if last_released.release_s > task.release_s else task
        if task.due_s is not None and task.due_s <= latest[name].release_s:
            release_text = (
                f"it comes after {latest[name].name!r}, which is released at {latest[name].release_s:g} s only"
            )
            raise ScenarioError(
                f"task {name!r}: due_s: found {task.due_s:g}, but {release_text}; change one of the two"
            )


def _name(p: Precedence) -> str:
    return f"precedence {p.before} -> {p.after} ({p.kind})"
