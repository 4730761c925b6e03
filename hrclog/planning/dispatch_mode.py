"""The ways to hand a plan out, and what each asks of the items."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise, zip_longest
from typing import Final

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


Queues = Mapping[str, tuple[PlanItem, ...]]
"""The items of each agent, in its order."""

Resources = Mapping[str, tuple[str, ...]]
"""What items use, by item id."""


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
    schedule = MODES[mode].schedule(plan, problem, queues, resources)
    _check_waits(plan, mode, schedule)
    return schedule


def _resources(plan: Plan, problem: Problem) -> dict[str, tuple[str, ...]]:
    """Return what each item uses, for those that use anything."""
    by_task = {task.name: task.resources for task in problem.tasks if task.resources}
    return {item.item_id: by_task[item.task] for item in plan.items if item.task in by_task}


def _barriers(queues: Mapping[str, tuple[PlanItem, ...]]) -> dict[str, tuple[str, ...]]:
    rows = [[item.item_id for item in row if item is not None] for row in zip_longest(*queues.values())]
    return {item_id: tuple(before) for before, row in pairwise(rows) for item_id in row}


def _check_meetings(plan: Plan, resources: Mapping[str, tuple[str, ...]]) -> None:
    users: dict[tuple[str, str], str] = {}
    for item in (item for item in plan.items if item.meet):
        for name in resources.get(item.item_id, ()):
            other = users.setdefault((item.meet, name), item.item_id)
            if other != item.item_id:
                conflict = f"items {other!r} and {item.item_id!r} meet at {item.meet!r}, but both need {name!r}"
                raise ScenarioError(f"plan {plan.name!r}: {conflict}, which one at a time may use; take a label away")


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
    uses = dict(resources)
    for items in meetings.values():
        after = tuple(dict.fromkeys(other for item in items for other in item.after))
        needs = tuple(dict.fromkeys(fact for item in items for fact in item.needs))
        names = tuple(name for item in items for name in resources.get(item.item_id, ()))
        for item in items:
            over_first[item.item_id] = tuple(before[partner.item_id] for partner in items if partner.item_id in before)
            partners[item.item_id] = tuple(partner.item_id for partner in items if partner is not item)
            shared[item.item_id] = replace(item, after=after, needs=needs)
            uses |= {item.item_id: names} if names else {}
    joined = {agent: tuple(shared.get(item.item_id, item) for item in queue) for agent, queue in queues.items()}
    return Schedule(joined, Rules(over_first=over_first, partners=partners, resources=uses))


def _follows(queues: Mapping[str, tuple[PlanItem, ...]], problem: Problem) -> dict[str, str]:
    nexts = {(rule.before, rule.after) for rule in problem.precedences if rule.kind is PrecedenceKind.NEXT}
    return {
        item.item_id: before.item_id
        for queue in queues.values()
        for before, item in pairwise(queue)
        if (before.task, item.task) in nexts
    }


def _check_waits(plan: Plan, mode: DispatchMode, schedule: Schedule) -> None:
    item_ids = {item.item_id for item in plan.items}
    sorter: TopologicalSorter[str] = TopologicalSorter()
    for queue in schedule.queues.values():
        for before, item in pairwise(queue):
            sorter.add(item.item_id, before.item_id)
        for item in queue:
            unknown = [other for other in item.after if other not in item_ids]
            if unknown:
                wait = f"item {item.item_id!r} waits for {unknown[0]!r}"
                raise ScenarioError(f"plan {plan.name!r}: {wait}, which is not in the plan; add or rename it")
            sorter.add(item.item_id, *item.after, *schedule.rules.over_first.get(item.item_id, ()))
    try:
        sorter.prepare()
    except CycleError as error:
        circle = " -> ".join(error.args[1])
        raise ScenarioError(
            f"plan {plan.name!r}: in mode {mode} the items {circle} wait for each other in a circle; "
            "change the order of an agent, its labels, or the mode"
        ) from error


def _in_order(_plan: Plan, _problem: Problem, queues: Queues, resources: Resources) -> Schedule:
    return Schedule(queues, Rules(resources=resources))


def _in_rows(_plan: Plan, _problem: Problem, queues: Queues, resources: Resources) -> Schedule:
    return Schedule(queues, Rules(over_first=_barriers(queues), resources=resources))


def _with_rendezvous(plan: Plan, _problem: Problem, queues: Queues, resources: Resources) -> Schedule:
    _check_meetings(plan, resources)
    return _with_meetings(queues, resources)


def _as_ready(_plan: Plan, problem: Problem, queues: Queues, resources: Resources) -> Schedule:
    return Schedule(queues, Rules(follows=_follows(queues, problem), resources=resources, free_order=True))


@dataclass(frozen=True, slots=True)
class ModeRecord:
    """A way to hand a plan out.

    Attributes:
        mode: its name.
        summary: when an agent's next item starts.
        schedule: makes queues and rules of a plan.
        timed: whether items wait for their planned start.
        predictable: whether the order in which items are done is known before the run, so that a plan can be judged.
    """

    mode: DispatchMode
    summary: str
    schedule: Callable[[Plan, Problem, Queues, Resources], Schedule]
    timed: bool = False
    predictable: bool = True


MODES: Final[Mapping[str, ModeRecord]] = {
    str(record.mode): record
    for record in (
        ModeRecord(
            DispatchMode.SEQUENTIAL,
            "as soon as the agent is free and everything in `after` has succeeded",
            _in_order,
        ),
        ModeRecord(
            DispatchMode.TIMED, "as in `sequential`, but not before its `planned_start_s`", _in_order, timed=True
        ),
        ModeRecord(
            DispatchMode.SYNCHRONOUS,
            "when all k-th items are over, whatever their outcome, all agents begin their (k+1)-th",
            _in_rows,
        ),
        ModeRecord(
            DispatchMode.ASYNCHRONOUS,
            "as in `sequential`; those who `meet` wait until all of them have got there. If one cannot come, all are "
            "skipped",
            _with_rendezvous,
        ),
        ModeRecord(
            DispatchMode.REACTIVE,
            "the first item of its queue that is ready, rather than strictly the next",
            _as_ready,
            predictable=False,
        ),
    )
}
"""By name; the first is the default."""
