"""What an agent may do next, given what has ended: one pure rule for every dispatcher, real or simulated."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field, replace
from enum import StrEnum

from hrclog.events import Outcome
from hrclog.planning.plan import PlanItem


class Verdict(StrEnum):
    """What to do about an agent.

    START: dispatch its item. WAIT: nothing yet. SKIP: close its item, which can never start. DONE: it has no work left.
    """

    START = "start"
    WAIT = "wait"
    SKIP = "skip"
    DONE = "done"


@dataclass(frozen=True, slots=True)
class Decision:
    """A verdict and its reasons.

    `because` lists the items that are waited for (WAIT), as predecessors or as users of a resource, or that did not
    succeed (SKIP); `missing` the facts that are waited for; `not_before_s` is the planned start that is waited for, in
    seconds from the start of the run.
    """

    verdict: Verdict
    item: PlanItem | None = None
    because: tuple[str, ...] = ()
    not_before_s: float | None = None
    missing: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Rules:
    """What a dispatch mode asks for on top of the items' own `after` and `needs`; all by item id.

    `over_first` lists what must be over, whatever its outcome, before an item is started or skipped; `partners` what it
    starts with or not at all; `follows` the item it must follow with none of its agent's in between. `resources` names
    what an item uses from being dispatched until it is over, all at once, and no other at that time but its partners.
    With `free_order` an agent takes the first item of its queue that is ready, else strictly the next.
    """

    over_first: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    partners: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    follows: Mapping[str, str] = field(default_factory=dict)
    resources: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    free_order: bool = False


PLAIN = Rules()
"""The rules of a mode that asks for nothing more."""


@dataclass(frozen=True, slots=True)
class _Now:
    """All that a decision depends on besides the queue, see `decide`."""

    outcomes: Mapping[str, str]
    facts: AbstractSet[str]
    rules: Rules
    under_way: Collection[str]


def decide(
    queue: Sequence[PlanItem],
    outcomes: Mapping[str, str],
    *,
    busy: bool,
    now_s: float | None = None,
    facts: AbstractSet[str] = frozenset(),
    rules: Rules = PLAIN,
    under_way: Collection[str] = (),
) -> Decision:
    """Return what an agent may do now.

    An item whose predecessor did not succeed is to be skipped.

    Args:
        queue: all items of the agent, in its order.
        outcomes: final outcome of every item that is over, by item id; an item to be retried is not over.
        busy: whether an item of the agent is dispatched or running.
        now_s: seconds since the start of the run, given where planned starts are to be waited for.
        facts: what has arrived.
        rules: what the mode asks for.
        under_way: the items of all agents that are dispatched, running or about to be tried again.
    """
    remaining = [item for item in queue if item.item_id not in outcomes]
    if not remaining:
        return Decision(Verdict.DONE)
    if busy:
        return Decision(Verdict.WAIT, remaining[0])
    now = _Now(outcomes, facts, rules, under_way)
    if rules.free_order:
        return _first_ready(remaining, now)
    return _judge_item(remaining[0], now, now_s)


def _judge_item(item: PlanItem, now: _Now, now_s: float | None = None) -> Decision:
    """Return whether an item may start, taken by itself."""
    outcomes, rules = now.outcomes, now.rules
    before = tuple(other for other in rules.over_first.get(item.item_id, ()) if other not in outcomes)
    if before:
        return Decision(Verdict.WAIT, item, before)
    required = item.after + rules.partners.get(item.item_id, ())
    failed = tuple(other for other in required if outcomes.get(other, Outcome.SUCCEEDED) != Outcome.SUCCEEDED)
    if failed:
        return Decision(Verdict.SKIP, item, failed)
    open_items = tuple(other for other in item.after if other not in outcomes)
    missing = tuple(fact for fact in item.needs if fact not in now.facts)
    if open_items or missing:
        return Decision(Verdict.WAIT, item, open_items, missing=missing)
    if now_s is not None and item.planned_start_s is not None and now_s < item.planned_start_s:
        return Decision(Verdict.WAIT, item, not_before_s=item.planned_start_s)
    users = tuple(_users(item, now))
    return Decision(Verdict.WAIT, item, users) if users else Decision(Verdict.START, item)


def _users(item: PlanItem, now: _Now) -> Iterator[str]:
    """Yield the items under way that use a resource which an item needs; partners use theirs together."""
    resources = set(now.rules.resources.get(item.item_id, ()))
    if resources:
        partners = now.rules.partners.get(item.item_id, ())
        for other in now.under_way:
            if other not in partners and resources.intersection(now.rules.resources.get(other, ())):
                yield other


def _first_ready(remaining: Sequence[PlanItem], now: _Now) -> Decision:
    """Return the decision on the first item that is ready together with all that must follow it.

    Where there is none, the first of the queue may still go: a plan's own order is always possible.
    """
    follows = now.rules.follows
    for item in remaining:
        if follows.get(item.item_id) in now.outcomes:
            return _judge_item(item, now)  # its predecessor is over: nothing may come in between
    heads = [_judge_item(item, now) for item in remaining if item.item_id not in follows]
    for decision in heads:
        if decision.verdict is Verdict.SKIP:
            return decision
    for decision in heads:
        if decision.verdict is Verdict.START and _ready_throughout(decision.item, remaining, now):
            return decision
    return heads[0]


def _ready_throughout(head: PlanItem | None, remaining: Sequence[PlanItem], now: _Now) -> bool:
    """Return whether all that must follow an item at once waits for nothing but the item."""
    chain = list(_chain(head, remaining, now.rules))
    moment_after = replace(now, outcomes={**now.outcomes, **{item.item_id: Outcome.SUCCEEDED for item in chain}})
    return all(_judge_item(item, moment_after).verdict is Verdict.START for item in chain[1:])


def _chain(head: PlanItem | None, remaining: Sequence[PlanItem], rules: Rules) -> Iterator[PlanItem]:
    while head is not None:
        yield head
        item_id = head.item_id
        head = next((item for item in remaining if rules.follows.get(item.item_id) == item_id), None)
