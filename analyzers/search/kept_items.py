"""Items of a new plan for a run that goes on: items that it had before keep their ids and what belongs to the ids."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from hrclog.planning.plan import Arrival, Plan, PlanItem
from hrclog.planning.run_state import RunState


def with_ids(plan: Plan, fixed: Mapping[str, Sequence[PlanItem]], state: RunState) -> Plan:
    """Keep the ids of what is over or under way, and of what has not begun; give new ones to what is done again.

    What an item needs, and how long it may take, stay with its id.

    Args:
        plan: of the whole run, with ids of its own.
        fixed: of each agent the items that are over, then the one under way; its queue begins with them.
        state: how the run stands.
    """
    free = {agent: [i for i in state.plan.queue(agent) if i.item_id not in state.outcomes
                    and i not in fixed[agent]] for agent in fixed}  # fmt: skip
    used = {item.item_id for item in state.plan.items} | set(state.outcomes)
    names: dict[str, str] = {}
    kept: dict[str, PlanItem] = {}
    for agent in plan.agents():
        for place, item in enumerate(plan.queue(agent)):
            match = _matching_item(item, place, fixed[agent], free[agent])
            names[item.item_id] = match.item_id if match else _new_id(agent, used)
            if match:
                kept[names[item.item_id]] = match
    items = []
    for item in plan.items:
        name = names[item.item_id]
        original = kept.get(name, item)
        needs = tuple(dict.fromkeys((*item.needs, *original.needs)))
        after = tuple(names[other] for other in item.after)
        items.append(replace(item, item_id=name, after=after, needs=needs, timeout_s=original.timeout_s))
    return replace(plan, items=tuple(items), arrivals=_arrivals(plan, items, state))


def _arrivals(plan: Plan, items: Iterable[PlanItem], state: RunState) -> tuple[Arrival, ...]:
    """Return when what the items need arrives, as far as it is known."""
    planned = {arrival.fact: arrival for arrival in (*state.plan.arrivals, *plan.arrivals)}
    facts = dict.fromkeys(fact for item in items for fact in item.needs)
    arrived = {fact: Arrival(fact, state.now_s) for fact in facts if fact in state.facts}
    return tuple({**arrived, **planned}[fact] for fact in facts if fact in arrived or fact in planned)


def _matching_item(item: PlanItem, place: int, fixed: Sequence[PlanItem], free: list[PlanItem]) -> PlanItem | None:
    """Return the item of the current plan that corresponds to an item of the new one, None without one."""
    if place < len(fixed):
        return fixed[place]
    for candidate in free:
        if candidate.task == item.task:
            free.remove(candidate)
            return candidate
    return None


def _new_id(agent: str, used: set[str]) -> str:
    number = len(used) + 1
    while f"{agent}-{number:02d}" in used:
        number += 1
    used.add(f"{agent}-{number:02d}")
    return f"{agent}-{number:02d}"
