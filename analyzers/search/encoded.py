"""Plans as arrays, so that many of them can be judged at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from hrclog.arrays import FloatArray, IntArray
from hrclog.errors import ScenarioError
from hrclog.knowledge.task_times import AgentTask
from hrclog.planning.dispatch_mode import MODES, DispatchMode, Schedule, schedule_of
from hrclog.planning.plan import Plan
from hrclog.planning.problem import Problem

Queues = Mapping[str, Sequence[str]]
"""The tasks of each agent, in its order."""

END: Final = -1
"""In place of a task, where an agent's queue has come to its end."""


@dataclass(frozen=True, slots=True)
class Encoded:
    """B plans of A agents with up to P items each.

    An agent does its items in order, so an item waits until a number of items of each agent are over.

    Attributes:
        agents: names.
        keys: (agent, task) by number.
        task: number of each item's key, `END` past the last one, shape (B, A, P + 1).
        repeat: how often its agent did the same task before, shape as `task`.
        waits: how many items of each agent must be over before, shape (B, A, P + 1, A); None if none wait.
        not_before_s: earliest dispatch of each item, shape as `task`; None if there is none.
        resources: what each item holds, as a set of bits, shape as `task`; None if nothing is held.
        asked: numbers of the agents in the order in which a dispatcher asks them, shape (B, A); it matters where two
            want the same resource at the same instant.
    """

    agents: tuple[str, ...]
    keys: tuple[AgentTask, ...]
    task: IntArray
    repeat: IntArray
    waits: IntArray | None = None
    not_before_s: FloatArray | None = None
    resources: IntArray | None = None
    asked: IntArray | None = None

    @property
    def size(self) -> int:
        """Return how many plans there are."""
        return len(self.task)


def encode_queues(agents: Sequence[str], keys: Sequence[AgentTask], plans: Sequence[Queues]) -> Encoded:
    """Return plans in which no item waits for another agent.

    Args:
        agents: all that any plan names.
        keys: all (agent, task) that occur.
        plans: the tasks of each agent, in its order.
    """
    number = {key: index for index, key in enumerate(keys)}
    longest = max((len(tasks) for plan in plans for tasks in plan.values()), default=0)
    task = np.full((len(plans), len(agents), longest + 1), END, np.int64)
    for index, plan in enumerate(plans):
        for place, agent in enumerate(agents):
            tasks = plan.get(agent, ())
            task[index, place, : len(tasks)] = [number[agent, name] for name in tasks]
    return Encoded(tuple(agents), tuple(keys), task, repeats(task))


def encode_plans(
    problem: Problem,
    keys: Sequence[AgentTask],
    plans: Sequence[Plan],
    mode: DispatchMode = DispatchMode.SEQUENTIAL,
) -> Encoded:
    """Return plans with all that a dispatcher waits for in a mode.

    Args:
        problem: what the plans solve.
        keys: all (agent, task) that occur.
        plans: which; items without planned starts are not held back by `timed`.
        mode: how they are handed out; in `reactive` mode the order is made on the way and cannot be judged before.

    Raises:
        ScenarioError: the mode is reactive, or items wait for each other in a circle.
    """
    if not MODES[mode].predictable:
        raise ScenarioError(
            "mode reactive: the order of items is made while the run goes on, so a plan cannot be judged beforehand;"
            " choose another mode"
        )
    agents = problem.agents
    schedules = [schedule_of(plan, mode, problem) for plan in plans]
    queues = [{a: [item.task for item in items] for a, items in schedule.queues.items()} for schedule in schedules]
    encoded = encode_queues(agents, keys, queues)
    waits = np.zeros((*encoded.task.shape, len(agents)), np.int64)
    not_before = np.zeros(encoded.task.shape)
    for index, (plan, schedule) in enumerate(zip(plans, schedules, strict=True)):
        _note_waits(waits[index], agents, schedule)
        _note_instants(not_before[index], agents, plan, schedule, timed=MODES[mode].timed)
    resources = encode_resources(problem, encoded)
    return replace(
        encoded,
        waits=waits if waits.any() else None,
        not_before_s=not_before if not_before.any() else None,
        resources=resources,
        asked=None if resources is None else _asking_order(agents, plans),
    )


def encode_resources(problem: Problem, plans: Encoded) -> IntArray | None:
    """Return what each item holds while it lasts, as a set of bits, shape as `task`; None if nothing is held."""
    resources_of = {task.name: task.resources for task in problem.tasks}
    names = sorted({name for resources in resources_of.values() for name in resources})
    if not names:
        return None
    bits = np.array(
        [sum(1 << names.index(name) for name in resources_of[task]) for _, task in plans.keys] + [0], np.int64
    )
    item_bits: IntArray = bits[plans.task]
    return item_bits


def repeats(task: IntArray) -> IntArray:
    """Return how often the same task stands before each item in its agent's queue, shape as `task`, (..., P)."""
    counts = np.zeros_like(task)
    for key in np.unique(task):
        same = task == key
        counts[same] = (np.cumsum(same, axis=-1) - 1)[same]
    return counts


def _asking_order(agents: Sequence[str], plans: Sequence[Plan]) -> IntArray:
    """Return the agents in the order of their first items, then those without any."""
    orders = [dict.fromkeys((*plan.agents(), *agents)) for plan in plans]
    return np.array([[agents.index(agent) for agent in order] for order in orders], np.int64)


def _note_waits(waits: IntArray, agents: Sequence[str], schedule: Schedule) -> None:
    place_of = {
        item.item_id: (agents.index(agent), position)
        for agent, items in schedule.queues.items()
        for position, item in enumerate(items)
    }
    for items in schedule.queues.values():
        for item in items:
            item_place = place_of[item.item_id]
            for other in (*item.after, *schedule.rules.over_first.get(item.item_id, ())):
                agent, position = place_of[other]
                waits[*item_place, agent] = max(waits[*item_place, agent], position + 1)


def _note_instants(
    not_before: FloatArray, agents: Sequence[str], plan: Plan, schedule: Schedule, *, timed: bool
) -> None:
    arrivals = {arrival.fact: arrival.at_s for arrival in plan.arrivals}
    for agent, items in schedule.queues.items():
        for position, item in enumerate(items):
            missing = [fact for fact in item.needs if fact not in arrivals]
            if missing:
                raise ScenarioError(
                    f"plan {plan.name!r}: item {item.item_id!r} needs {missing[0]!r}, and it is not said when that"
                    " arrives; add it to the plan's arrivals"
                )
            instants = [arrivals[fact] for fact in item.needs]
            if timed and item.planned_start_s is not None:
                instants.append(item.planned_start_s)
            not_before[agents.index(agent), position] = max(instants, default=0.0)
