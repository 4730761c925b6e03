"""What an agent may do next, given what has ended: one pure rule for every dispatcher, real or simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from hrclog.events import Outcome
from hrclog.plan import PlanItem


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

    `because` lists the items that are waited for (WAIT) or that did not succeed (SKIP); `not_before_s` is the planned
    start that is waited for, in seconds from the start of the run.
    """

    verdict: Verdict
    item: PlanItem | None = None
    because: tuple[str, ...] = ()
    not_before_s: float | None = None


def decide(
    queue: Sequence[PlanItem], outcomes: Mapping[str, str], *, busy: bool, now_s: float | None = None
) -> Decision:
    """Return what an agent may do now.

    An item whose predecessor did not succeed is to be skipped. Work goes strictly in the order of the queue.

    Args:
        queue: all items of the agent, in its order.
        outcomes: final outcome of every item that is over, by item id; an item to be retried is not over.
        busy: whether an item of the agent is dispatched or running.
        now_s: seconds since the start of the run, given where planned starts are to be waited for.
    """
    item = next((item for item in queue if item.item_id not in outcomes), None)
    if item is None:
        return Decision(Verdict.DONE)
    if busy:
        return Decision(Verdict.WAIT, item)
    lost = tuple(other for other in item.after if outcomes.get(other, Outcome.SUCCEEDED) != Outcome.SUCCEEDED)
    if lost:
        return Decision(Verdict.SKIP, item, lost)
    waits = tuple(other for other in item.after if other not in outcomes)
    if waits:
        return Decision(Verdict.WAIT, item, waits)
    if now_s is not None and item.planned_start_s is not None and now_s < item.planned_start_s:
        return Decision(Verdict.WAIT, item, not_before_s=item.planned_start_s)
    return Decision(Verdict.START, item)
