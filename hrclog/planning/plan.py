"""Who does what in which order: plans and their files."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from hrclog.errors import ScenarioError
from hrclog.files import write_output
from hrclog.json_record import JsonRecord, read_json
from hrclog.planning.order import Ledger, possible_sequence
from hrclog.planning.problem import Precedence, PrecedenceKind, Problem
from hrclog.planning.provenance import (
    FORECAST_FIELDS,
    MADE_FOR_FIELDS,
    Expected,
    MadeFor,
    expected_from_json,
    made_for_from_json,
)
from hrclog.wording import counted

Orders = dict[str, tuple[str, ...]]
"""The tasks of each agent, in its order."""

PLAN_VERSION: Final = 1

_PLAN_FIELDS: Final = ("schema_version", "name", "problem", "expected", "items", "arrivals")
_ITEM_FIELDS: Final = (
    *("item_id", "agent", "task", "after", "planned_start_s", "planned_end_s"),
    *("meet", "needs", "timeout_s"),
)


@dataclass(frozen=True, slots=True)
class PlanItem:
    """One piece of work of one agent.

    `after` lists the items that must have succeeded before it may start; the agent's own order comes on top of that.
    Planned instants are seconds from the start of the run, None where the plan has no times. Items of one `meet` label
    start together in asynchronous mode. `needs` names facts that must have arrived, `timeout_s` limits an attempt.
    """

    item_id: str
    agent: str
    task: str
    after: tuple[str, ...] = ()
    planned_start_s: float | None = None
    planned_end_s: float | None = None
    meet: str = ""
    needs: tuple[str, ...] = ()
    timeout_s: float | None = None


@dataclass(frozen=True, slots=True)
class Arrival:
    """A fact that is going to be known, in seconds from the start of the run: a part is there, a door is open."""

    fact: str
    at_s: float


@dataclass(frozen=True, slots=True)
class Plan:
    """Items in an order that is possible; each agent does its own in that order."""

    name: str
    items: tuple[PlanItem, ...]
    arrivals: tuple[Arrival, ...] = ()
    problem: MadeFor | None = None
    expected: Expected | None = None

    def agents(self) -> tuple[str, ...]:
        """Return the agents that have work, in order of their first item."""
        return tuple(dict.fromkeys(item.agent for item in self.items))

    def queue(self, agent: str) -> tuple[PlanItem, ...]:
        """Return the items of an agent, in its order."""
        return tuple(item for item in self.items if item.agent == agent)

    def orders(self) -> Orders:
        """Return the tasks of each agent, in its order; two plans with equal orders are the same plan."""
        return {agent: tuple(item.task for item in self.queue(agent)) for agent in sorted(self.agents())}

    def to_json(self) -> dict[str, Any]:
        """Return the plan as JSON values, the inverse of `plan_from_json`."""
        origin = {"problem": self.problem, "expected": self.expected}
        return self.work_json() | {name: value.to_json() for name, value in origin.items() if value}

    def work_json(self) -> dict[str, Any]:
        """Return what is to be done as JSON values: the plan without where it comes from."""
        values: dict[str, Any] = {
            "schema_version": PLAN_VERSION,
            "name": self.name,
            "items": [_item_json(item) for item in self.items],
        }
        if self.arrivals:
            values["arrivals"] = [{"fact": arrival.fact, "at_s": arrival.at_s} for arrival in self.arrivals]
        return values


def make_plan(problem: Problem, orders: Mapping[str, Sequence[str]], name: str = "plan") -> Plan:
    """Return the plan in which every agent does its tasks in the given order.

    Items of a task that is released later than the run starts need a fact, see `released`, which arrives then.

    Args:
        problem: what is to be done.
        orders: the tasks of each agent, in its order.
        name: name of the plan.

    Raises:
        ScenarioError: an agent has a task it cannot do, counts are not met, or the agents would wait for ever.
    """
    _check_counts(problem, orders, name)
    ledger = Ledger(problem)
    items: list[PlanItem] = []
    for agent, place in possible_sequence(problem, orders, f"plan {name!r}"):
        task = orders[agent][place]
        item_id = f"{agent}-{place + 1:02d}"
        needs = (released(task),) if problem.task(task).release_s else ()
        items.append(PlanItem(item_id, agent, task, ledger.do(agent, item_id, task), needs=needs))
    return Plan(name, tuple(items), _releases(problem, {item.task for item in items}))


def released(task: str) -> str:
    """Return the name of the fact that a task has been released."""
    return f"released: {task}"


def check_plan(problem: Problem, plan: Plan) -> None:
    """Raise if a plan does not solve a problem.

    Raises:
        ScenarioError: as for `make_plan`, or an item does not wait for what its precedences ask for or its release.
    """
    for item in plan.items:
        problem.task(item.task)
    _check_counts(problem, plan.orders(), plan.name)
    _check_meets(plan.items, f"plan {plan.name!r}")
    for precedence in problem.precedences:
        for item in _items_breaking(plan, precedence):
            rule = f"{precedence.before} -> {precedence.after} ({precedence.kind})"
            raise ScenarioError(f"plan {plan.name!r}: item {item.item_id!r} breaks the precedence {rule}; reorder it")
    _check_releases(problem, plan)


def with_planned_times(
    plan: Plan, durations_s: Mapping[tuple[str, str], float], gaps_s: Mapping[str, float] | None = None
) -> Plan:
    """Return the plan with the times it would have if no agent hindered another and facts came as announced.

    Args:
        plan: any plan.
        durations_s: expected duration of each (agent, task).
        gaps_s: time an agent needs before each of its items; 0 for agents not named.
    """
    free_s: dict[str, float] = {}
    end_s: dict[str, float] = {}
    arrival_s: dict[str, float] = {}
    for arrival in plan.arrivals:
        arrival_s[arrival.fact] = min(arrival.at_s, arrival_s.get(arrival.fact, arrival.at_s))
    items: list[PlanItem] = []
    for item in plan.items:
        known_s = (arrival_s.get(fact, 0.0) for fact in item.needs)
        ready_s = max([free_s.get(item.agent, 0.0), *(end_s[other] for other in item.after), *known_s])
        start_s = ready_s + (gaps_s or {}).get(item.agent, 0.0)
        free_s[item.agent] = end_s[item.item_id] = start_s + durations_s[item.agent, item.task]
        items.append(replace(item, planned_start_s=start_s, planned_end_s=end_s[item.item_id]))
    return replace(plan, items=tuple(items))


def read_plan(path: Path) -> Plan:
    """Return the plan of a JSON file.

    Raises:
        ScenarioError: the file cannot be read, or is no plan.
    """
    return plan_of_value(read_json(path, "a plan"), str(path))


def plan_of_value(value: object, where: str) -> Plan:
    """Return the plan of a JSON value.

    Args:
        value: the parsed JSON.
        where: where it stood, for messages.

    Raises:
        ScenarioError: as for `plan_from_json`, or it is no JSON object.
    """
    return plan_from_json(JsonRecord(value, where, _PLAN_FIELDS))


def write_plan(path: Path, plan: Plan) -> None:
    """Write a plan as a JSON file, replacing an older one as a whole.

    Raises:
        OutputError: the file cannot be written.
    """
    text = json.dumps(plan.to_json(), ensure_ascii=False, indent=1) + "\n"
    write_output(path, text.encode())


def plan_from_json(record: JsonRecord) -> Plan:
    """Return the plan of a JSON object.

    Raises:
        ScenarioError: a field is missing or wrong, ids are not unique, or items wait for each other in a circle.
    """
    version = record.integer("schema_version", PLAN_VERSION)
    if version > PLAN_VERSION:
        raise record.error("schema_version", f"at most {PLAN_VERSION} (a newer hrclog wrote it)")
    items = tuple(_item_from_json(entry) for entry in record.records("items", _ITEM_FIELDS))
    seen: set[str] = set()
    for index, item in enumerate(items):
        missing = [other for other in item.after if other not in seen]
        if missing or item.item_id in seen:
            fault = f"waits for {missing[0]!r}, which does not come before it" if missing else "has an id used before"
            raise ScenarioError(f"{record.where}: items[{index}] {item.item_id!r} {fault}; reorder or rename it")
        seen.add(item.item_id)
    _check_meets(items, record.where)
    arrivals = record.records("arrivals", ("fact", "at_s"), required=False)
    return Plan(
        record.text("name", "plan"),
        items,
        tuple(Arrival(entry.text("fact"), entry.number("at_s")) for entry in arrivals),
        made_for_from_json(record.record("problem", MADE_FOR_FIELDS)) if "problem" in record else None,
        expected_from_json(record.record("expected", FORECAST_FIELDS)) if "expected" in record else None,
    )


def _item_json(item: PlanItem) -> dict[str, Any]:
    values: dict[str, Any] = {"item_id": item.item_id, "agent": item.agent, "task": item.task}
    if item.after:
        values["after"] = list(item.after)
    if item.planned_start_s is not None:
        values["planned_start_s"] = item.planned_start_s
    if item.planned_end_s is not None:
        values["planned_end_s"] = item.planned_end_s
    if item.meet:
        values["meet"] = item.meet
    if item.needs:
        values["needs"] = list(item.needs)
    if item.timeout_s is not None:
        values["timeout_s"] = item.timeout_s
    return values


def _item_from_json(entry: JsonRecord) -> PlanItem:
    start, end = (entry.number(name) if name in entry else None for name in ("planned_start_s", "planned_end_s"))
    if start is not None and end is not None and end < start:
        raise entry.error("planned_end_s", f"at least planned_start_s = {start:g}")
    return PlanItem(
        item_id=entry.text("item_id"),
        agent=entry.text("agent"),
        task=entry.text("task"),
        after=entry.texts("after", ()),
        planned_start_s=start,
        planned_end_s=end,
        meet=entry.text("meet", ""),
        needs=entry.texts("needs", ()),
        timeout_s=entry.positive("timeout_s") if "timeout_s" in entry else None,
    )


def _check_meets(items: Sequence[PlanItem], where: str) -> None:
    agents_by_label: dict[str, list[str]] = {}
    for item in items:
        if item.meet:
            agents_by_label.setdefault(item.meet, []).append(item.agent)
    for label, agents in agents_by_label.items():
        if len(set(agents)) < max(len(agents), 2):
            items_text = f"meet {label!r} stands at items of {', '.join(map(repr, agents))}"
            raise ScenarioError(
                f"{where}: {items_text}, expected one item each of two or more agents; rename the label"
            )


def _releases(problem: Problem, tasks: Collection[str]) -> tuple[Arrival, ...]:
    return tuple(
        Arrival(released(task.name), task.release_s) for task in problem.tasks if task.release_s and task.name in tasks
    )


def _check_releases(problem: Problem, plan: Plan) -> None:
    for expected in _releases(problem, {item.task for item in plan.items}):
        arrival_s = min((arrival.at_s for arrival in plan.arrivals if arrival.fact == expected.fact), default=None)
        if arrival_s is None or arrival_s < expected.at_s:
            arrival_text = "never arrives" if arrival_s is None else f"arrives at {arrival_s:g} s"
            remedy = f"let it arrive at {expected.at_s:g} s, the task's release_s"
            raise ScenarioError(f"plan {plan.name!r}: fact {expected.fact!r} {arrival_text}; {remedy}")
    for item in plan.items:
        fact = released(item.task)
        if problem.task(item.task).release_s and fact not in item.needs:
            raise ScenarioError(
                f"plan {plan.name!r}: item {item.item_id!r} does not need {fact!r}; add it to its needs"
            )


def _check_counts(problem: Problem, orders: Mapping[str, Sequence[str]], name: str) -> None:
    for agent, tasks in orders.items():
        for task in tasks:
            if agent not in problem.task(task).agents:
                domain = ", ".join(problem.task(task).agents)
                raise ScenarioError(f"plan {name!r}: {agent!r} cannot do {task!r}, only {domain} can; move it")
    for task in (task.name for task in problem.tasks):
        n_done = sum(list(tasks).count(task) for tasks in orders.values())
        expected = problem.total(task)
        if n_done != expected and not problem.is_extra(task):
            raise ScenarioError(
                f"plan {name!r}: {task!r} is done {counted(n_done, 'time')}, expected {expected}; add or remove some"
            )
    for count in problem.counts:
        n_done = list(orders.get(count.agent, ())).count(count.task)
        if count.agent and n_done < count.count:
            text = f"{count.agent!r} does {count.task!r} {counted(n_done, 'time')}, expected {count.count}"
            raise ScenarioError(f"plan {name!r}: {text}; add or remove some")


def _items_breaking(plan: Plan, precedence: Precedence) -> Iterator[PlanItem]:
    """Yield the items that do not wait as a precedence requires."""
    open_items = {item.item_id: item for item in plan.items if item.task == precedence.before}
    for item in (item for item in plan.items if item.task == precedence.after):
        waits = [other for other in item.after if other in open_items]
        if precedence.kind is PrecedenceKind.ALL:
            is_kept = len(waits) == len(open_items)
        else:
            is_kept = any(
                precedence.kind is PrecedenceKind.EACH or _right_after(plan, open_items[w], item) for w in waits
            )
            for other in waits[:1]:
                del open_items[other]
        if not is_kept:
            yield item


def _right_after(plan: Plan, before: PlanItem, item: PlanItem) -> bool:
    queue = plan.queue(item.agent)
    return before in queue and queue.index(item) == queue.index(before) + 1
