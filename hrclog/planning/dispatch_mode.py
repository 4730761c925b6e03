"""The ways to hand a plan out, and what each asks of the items."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise, zip_longest

from hrclog.errors import ScenarioError
from hrclog.planning.dispatch_rule import Rules
from hrclog.planning.plan import Plan, PlanItem
from hrclog.planning.problem import PrecedenceKind, Problem


class DispatchMode(StrEnum):
    """How items are handed out.

    SEQUENTIAL: each agent its own order, as soon as precedences allow. TIMED: no item before its planned start either.
    SYNCHRONOUS: the k-th items of all agents only after all (k-1)-th are over. ASYNCHRONOUS: as sequential, but items
    that meet start together. REACTIVE: each agent the first of its items that is ready.
    """

    SEQUENTIAL = "sequential"
    TIMED = "timed"
    SYNCHRONOUS = "synchronous"
    ASYNCHRONOUS = "asynchronous"
    REACTIVE = "reactive"


@dataclass(frozen=True, slots=True)
class Schedule:
    """A plan made ready for a mode: each agent's queue, and the rules that hold besides."""

    queues: Mapping[str, tuple[PlanItem, ...]]
    rules: Rules


def schedule_of(plan: Plan, mode: DispatchMode, problem: Problem) -> Schedule:
    """Return what a dispatcher in a mode goes by.

    Args:
        plan: what is to be carried out.
        mode: how.
        problem: says which tasks must directly follow each other, and which resources they use.

    Raises:
        ScenarioError: items wait for each other in a circle, for one that is not in the plan, or must start together
            although only one at a time may use what they need.
    """
    queues = {agent: plan.queue(agent) for agent in plan.agents()}
    resources = _resources(plan, problem)
    match mode:
        case DispatchMode.SYNCHRONOUS:
            schedule = Schedule(queues, Rules(over_first=_barriers(queues), resources=resources))
        case DispatchMode.ASYNCHRONOUS:
            _check_meetings(plan, resources)
            schedule = _with_meetings(queues, resources)
        case DispatchMode.REACTIVE:
            follows = _follows(queues, problem)
            schedule = Schedule(queues, Rules(follows=follows, resources=resources, free_order=True))
        case _:
            schedule = Schedule(queues, Rules(resources=resources))
    _check_waits(plan, mode, schedule)
    return schedule


def _resources(plan: Plan, problem: Problem) -> dict[str, tuple[str, ...]]:
    """Return what each item uses, for those that use anything."""
    used = {task.name: task.resources for task in problem.tasks if task.resources}
    return {item.item_id: used[item.task] for item in plan.items if item.task in used}


def _barriers(queues: Mapping[str, tuple[PlanItem, ...]]) -> dict[str, tuple[str, ...]]:
    rows = [[item.item_id for item in row if item is not None] for row in zip_longest(*queues.values())]
    return {item_id: tuple(before) for before, row in pairwise(rows) for item_id in row}


def _check_meetings(plan: Plan, resources: Mapping[str, tuple[str, ...]]) -> None:
    users: dict[tuple[str, str], str] = {}
    for item in (item for item in plan.items if item.meet):
        for name in resources.get(item.item_id, ()):
            other = users.setdefault((item.meet, name), item.item_id)
            if other != item.item_id:
                found = f"items {other!r} and {item.item_id!r} meet at {item.meet!r}, but both need {name!r}"
                raise ScenarioError(f"plan {plan.name!r}: {found}, which one at a time may use; take a label away")


def _with_meetings(queues: Mapping[str, tuple[PlanItem, ...]], resources: Mapping[str, tuple[str, ...]]) -> Schedule:
    """Give the items of a meeting the same conditions: they become ready at the same instant.

    Each of them takes what all of them use, so that none finds it taken when its turn comes.
    """
    meetings: dict[str, list[PlanItem]] = {}
    before: dict[str, str] = {}
    for queue in queues.values():
        before |= {item.item_id: earlier.item_id for earlier, item in pairwise(queue)}
        for item in queue:
            if item.meet:
                meetings.setdefault(item.meet, []).append(item)
    over_first: dict[str, tuple[str, ...]] = {}
    partners: dict[str, tuple[str, ...]] = {}
    shared: dict[str, PlanItem] = {}
    together = dict(resources)
    for items in meetings.values():
        after = tuple(dict.fromkeys(other for item in items for other in item.after))
        needs = tuple(dict.fromkeys(fact for item in items for fact in item.needs))
        used = tuple(name for item in items for name in resources.get(item.item_id, ()))
        for item in items:
            over_first[item.item_id] = tuple(before[one.item_id] for one in items if one.item_id in before)
            partners[item.item_id] = tuple(one.item_id for one in items if one is not item)
            shared[item.item_id] = replace(item, after=after, needs=needs)
            together |= {item.item_id: used} if used else {}
    joined = {agent: tuple(shared.get(item.item_id, item) for item in queue) for agent, queue in queues.items()}
    return Schedule(joined, Rules(over_first=over_first, partners=partners, resources=together))


def _follows(queues: Mapping[str, tuple[PlanItem, ...]], problem: Problem) -> dict[str, str]:
    nexts = {(rule.before, rule.after) for rule in problem.precedences if rule.kind is PrecedenceKind.NEXT}
    return {
        item.item_id: before.item_id
        for queue in queues.values()
        for before, item in pairwise(queue)
        if (before.task, item.task) in nexts
    }


def _check_waits(plan: Plan, mode: DispatchMode, schedule: Schedule) -> None:
    known = {item.item_id for item in plan.items}
    sorter: TopologicalSorter[str] = TopologicalSorter()
    for queue in schedule.queues.values():
        for before, item in pairwise(queue):
            sorter.add(item.item_id, before.item_id)
        for item in queue:
            unknown = [other for other in item.after if other not in known]
            if unknown:
                found = f"item {item.item_id!r} waits for {unknown[0]!r}"
                raise ScenarioError(f"plan {plan.name!r}: {found}, which is not in the plan; add or rename it")
            sorter.add(item.item_id, *item.after, *schedule.rules.over_first.get(item.item_id, ()))
    try:
        sorter.prepare()
    except CycleError as error:
        circle = " -> ".join(error.args[1])
        raise ScenarioError(
            f"plan {plan.name!r}: in mode {mode} the items {circle} wait for each other in a circle; "
            "change the order of an agent, its labels, or the mode"
        ) from error
