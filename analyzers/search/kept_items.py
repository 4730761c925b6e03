"""Items of a plan that a run goes on with: those that it had before keep their ids, and what belongs to them."""

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
            known = _known(item, place, fixed[agent], free[agent])
            names[item.item_id] = known.item_id if known else _new_id(agent, used)
            if known:
                kept[names[item.item_id]] = known
    items = []
    for item in plan.items:
        name = names[item.item_id]
        before = kept.get(name, item)
        needs = tuple(dict.fromkeys((*item.needs, *before.needs)))
        after = tuple(names[other] for other in item.after)
        items.append(replace(item, item_id=name, after=after, needs=needs, timeout_s=before.timeout_s))
    return replace(plan, items=tuple(items), arrivals=_arrivals(plan, items, state))


def _arrivals(plan: Plan, items: Iterable[PlanItem], state: RunState) -> tuple[Arrival, ...]:
    """Return when what the items need arrives, as far as it is known."""
    told = {arrival.fact: arrival for arrival in (*state.plan.arrivals, *plan.arrivals)}
    facts = dict.fromkeys(fact for item in items for fact in item.needs)
    here = {fact: Arrival(fact, state.now_s) for fact in facts if fact in state.facts}
    return tuple({**here, **told}[fact] for fact in facts if fact in here or fact in told)


def _known(item: PlanItem, place: int, fixed: Sequence[PlanItem], free: list[PlanItem]) -> PlanItem | None:
    """Return the item of the present plan that an item of the new one is, if it is one."""
    if place < len(fixed):
        return fixed[place]
    for known in free:
        if known.task == item.task:
            free.remove(known)
            return known
    return None


def _new_id(agent: str, used: set[str]) -> str:
    number = len(used) + 1
    while f"{agent}-{number:02d}" in used:
        number += 1
    used.add(f"{agent}-{number:02d}")
    return f"{agent}-{number:02d}"
