"""The rule that says what an agent may start."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from hrclog.events import Outcome
from hrclog.planning.dispatch_rule import Decision, Rules, Verdict, decide
from hrclog.planning.plan import PlanItem

FIRST = PlanItem("1", "H", "pick")
SECOND = PlanItem("2", "H", "place", ("1", "r"), planned_start_s=5.0, planned_end_s=6.0)
QUEUE = (FIRST, SECOND)
DONE = Outcome.SUCCEEDED


def test_a_free_agent_starts_its_first_item() -> None:
    assert decide(QUEUE, {}, busy=False) == Decision(Verdict.START, FIRST)


def test_a_busy_agent_waits() -> None:
    assert decide(QUEUE, {}, busy=True) == Decision(Verdict.WAIT, FIRST)


def test_an_item_waits_for_another_agents_item() -> None:
    assert decide(QUEUE, {"1": DONE}, busy=False) == Decision(Verdict.WAIT, SECOND, ("r",))


def test_an_item_starts_once_all_before_it_succeeded() -> None:
    assert decide(QUEUE, {"1": DONE, "r": DONE}, busy=False) == Decision(Verdict.START, SECOND)


def test_an_item_whose_predecessor_was_lost_is_skipped_without_waiting_for_the_others() -> None:
    assert decide(QUEUE, {"1": Outcome.FAILED}, busy=False) == Decision(Verdict.SKIP, SECOND, ("1",))
    outcomes = {"1": DONE, "r": Outcome.SKIPPED}
    assert decide(QUEUE, outcomes, busy=False) == Decision(Verdict.SKIP, SECOND, ("r",))


def test_a_lost_item_does_not_hold_up_what_does_not_need_it() -> None:
    assert decide((FIRST, PlanItem("3", "H", "pick")), {"1": Outcome.FAILED}, busy=False).verdict is Verdict.START


def test_an_agent_is_done_when_all_its_items_are_over() -> None:
    assert decide(QUEUE, {"1": DONE, "2": Outcome.FAILED}, busy=False) == Decision(Verdict.DONE)
    assert decide((), {}, busy=False) == Decision(Verdict.DONE)


def test_planned_starts_are_waited_for_only_where_the_time_is_given() -> None:
    outcomes = {"1": DONE, "r": DONE}
    assert decide(QUEUE, outcomes, busy=False, now_s=4.9) == Decision(Verdict.WAIT, SECOND, not_before_s=5.0)
    assert decide(QUEUE, outcomes, busy=False, now_s=5.0) == Decision(Verdict.START, SECOND)
    assert decide(QUEUE, {}, busy=False, now_s=0.0) == Decision(Verdict.START, FIRST)


def test_an_item_waits_for_facts_in_every_mode() -> None:
    item = PlanItem("1", "H", "pick", needs=("part", "door"))
    assert decide((item,), {}, busy=False, facts={"door"}) == Decision(Verdict.WAIT, item, missing=("part",))
    assert decide((item,), {}, busy=False, facts={"door", "part"}) == Decision(Verdict.START, item)


def test_what_must_be_over_first_may_end_in_any_way_and_holds_up_a_skip_too() -> None:
    rules = Rules(over_first={"2": ("x",)})
    outcomes: dict[str, str] = {"1": Outcome.FAILED}
    assert decide(QUEUE, outcomes, busy=False, rules=rules) == Decision(Verdict.WAIT, SECOND, ("x",))
    outcomes["x"] = Outcome.FAILED
    assert decide(QUEUE, outcomes, busy=False, rules=rules) == Decision(Verdict.SKIP, SECOND, ("1",))


def test_an_item_goes_with_its_partners_or_not_at_all() -> None:
    rules = Rules(partners={"1": ("x",)})
    assert decide(QUEUE, {}, busy=False, rules=rules) == Decision(Verdict.START, FIRST)
    assert decide(QUEUE, {"x": Outcome.SKIPPED}, busy=False, rules=rules) == Decision(Verdict.SKIP, FIRST, ("x",))


def test_what_must_follow_never_goes_ahead_of_what_it_follows() -> None:
    queue = (PlanItem("1", "H", "pick", needs=("part",)), PlanItem("2", "H", "place"), PlanItem("3", "H", "wave"))
    rules = Rules(follows={"2": "1"}, free_order=True)
    assert decide(queue, {}, busy=False, rules=rules) == Decision(Verdict.START, queue[2])
    assert decide(queue, {"3": DONE}, busy=False, rules=rules) == Decision(Verdict.WAIT, queue[0], missing=("part",))
    assert decide(queue, {"1": DONE}, busy=False, rules=rules) == Decision(Verdict.START, queue[1])


def test_an_item_waits_for_those_under_way_that_use_what_it_needs() -> None:
    rules = Rules(resources={"1": ("jig", "tool"), "x": ("tool",), "y": ("door",), "z": ("jig",)})
    assert decide(QUEUE, {}, busy=False, rules=rules, under_way=["y"]) == Decision(Verdict.START, FIRST)
    waits = decide(QUEUE, {}, busy=False, rules=rules, under_way=["x", "y", "z"])
    assert waits == Decision(Verdict.WAIT, FIRST, ("x", "z"))


def test_partners_use_what_they_need_together() -> None:
    rules = Rules(resources={"1": ("jig",), "x": ("jig",)}, partners={"1": ("x",)})
    assert decide(QUEUE, {}, busy=False, rules=rules, under_way=["x"]) == Decision(Verdict.START, FIRST)


def test_what_can_never_start_is_skipped_though_a_resource_is_taken() -> None:
    rules = Rules(resources={"2": ("jig",), "x": ("jig",)})
    outcomes = {"1": Outcome.FAILED}
    assert decide(QUEUE, outcomes, busy=False, rules=rules, under_way=["x"]).verdict is Verdict.SKIP


def test_in_free_order_what_needs_a_taken_resource_is_left_for_later() -> None:
    queue = (PlanItem("1", "H", "pick"), PlanItem("2", "H", "place"), PlanItem("3", "H", "wave"))
    rules = Rules(resources={"2": ("jig",), "x": ("jig",)}, follows={"2": "1"}, free_order=True)
    assert decide(queue, {}, busy=False, rules=rules, under_way=["x"]) == Decision(Verdict.START, queue[2])
    assert decide(queue, {}, busy=False, rules=rules) == Decision(Verdict.START, queue[0])


@given(st.permutations(["1", "2", "3", "4"]), st.data())
def test_work_never_overtakes_in_the_queue_and_never_starts_before_its_predecessors(
    order: list[str], data: st.DataObject
) -> None:
    queue = tuple(
        PlanItem(name, "H", "t", tuple(data.draw(st.sets(st.sampled_from(["x", "y", *order[:place]])))))
        for place, name in enumerate(order)
    )
    outcomes = data.draw(st.dictionaries(st.sampled_from([*order, "x", "y"]), st.sampled_from(list(Outcome))))
    decision = decide(queue, outcomes, busy=data.draw(st.booleans()))
    open_items = [item for item in queue if item.item_id not in outcomes]
    assert decision.item == (open_items[0] if open_items else None)
    if decision.verdict is Verdict.START:
        assert decision.item is not None
        assert all(outcomes.get(other) == Outcome.SUCCEEDED for other in decision.item.after)
