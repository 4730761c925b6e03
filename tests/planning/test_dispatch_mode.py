"""What each mode asks of the items."""

from __future__ import annotations

import pytest
from dispatching import line, problem_of

from hrclog.errors import ScenarioError
from hrclog.planning.dispatch_mode import DispatchMode, schedule_of
from hrclog.planning.dispatch_rule import Rules
from hrclog.planning.plan import Plan, PlanItem
from hrclog.planning.problem import Precedence, PrecedenceKind

PLAN = line("a-1", "b-1", "a-2<a-1", "b-2", "a-3")


@pytest.mark.parametrize("mode", [DispatchMode.SEQUENTIAL, DispatchMode.TIMED])
def test_the_plain_modes_ask_for_nothing_more(mode: DispatchMode) -> None:
    schedule = schedule_of(PLAN, mode, problem_of(PLAN))
    assert schedule.rules == Rules()
    assert schedule.queues == {"a": PLAN.queue("a"), "b": PLAN.queue("b")}


def test_a_row_is_over_before_the_next_begins_in_synchronous_mode() -> None:
    rules = schedule_of(PLAN, DispatchMode.SYNCHRONOUS, problem_of(PLAN)).rules
    first, second = ("a-1", "b-1"), ("a-2", "b-2")
    assert rules.over_first == {"a-2": first, "b-2": first, "a-3": second}


def test_items_that_meet_have_the_same_conditions_in_asynchronous_mode() -> None:
    plan = Plan(
        "p",
        (
            PlanItem("a1", "a", "t"),
            PlanItem("a2", "a", "t", ("a1",), meet="x"),
            PlanItem("b1", "b", "t", ("a1",), meet="x", needs=("part",)),
        ),
    )
    schedule = schedule_of(plan, DispatchMode.ASYNCHRONOUS, problem_of(plan))
    assert schedule.rules.over_first == {"a2": ("a1",), "b1": ("a1",)}
    assert schedule.rules.partners == {"a2": ("b1",), "b1": ("a2",)}
    assert [(i.after, i.needs) for queue in schedule.queues.values() for i in queue] == [
        ((), ()),
        (("a1",), ("part",)),
        (("a1",), ("part",)),
    ]


@pytest.mark.parametrize("mode", DispatchMode)
def test_every_mode_knows_what_each_item_uses(mode: DispatchMode) -> None:
    problem = problem_of(PLAN, resources={"1": ("jig",), "3": ("jig", "tool")})
    used = schedule_of(PLAN, mode, problem).rules.resources
    assert used == {"a-1": ("jig",), "b-1": ("jig",), "a-3": ("jig", "tool")}


MEETING = Plan(
    "p", (PlanItem("a1", "a", "lift", meet="x"), PlanItem("b1", "b", "hold", meet="x"), PlanItem("c1", "c", "see"))
)


def test_items_that_meet_take_all_that_they_use_at_once() -> None:
    problem = problem_of(MEETING, resources={"lift": ("crane",), "hold": ("jig",), "see": ("jig",)})
    used = schedule_of(MEETING, DispatchMode.ASYNCHRONOUS, problem).rules.resources
    assert used == {"a1": ("crane", "jig"), "b1": ("crane", "jig"), "c1": ("jig",)}


def test_items_that_meet_may_not_need_the_same_resource() -> None:
    problem = problem_of(MEETING, resources={"lift": ("crane",), "hold": ("jig", "crane")})
    with pytest.raises(ScenarioError, match="items 'a1' and 'b1' meet at 'x', but both need 'crane'"):
        schedule_of(MEETING, DispatchMode.ASYNCHRONOUS, problem)
    schedule_of(MEETING, DispatchMode.SEQUENTIAL, problem)


def test_only_what_must_follow_at_once_is_chained_in_reactive_mode() -> None:
    plan = line("a-1", "a-2", "a-3", "b-3")
    rules = [Precedence("1", "2"), Precedence("2", "3", PrecedenceKind.ALL)]
    schedule = schedule_of(plan, DispatchMode.REACTIVE, problem_of(plan, rules[1:]))
    assert schedule.rules == Rules(free_order=True)
    assert schedule_of(plan, DispatchMode.REACTIVE, problem_of(plan, rules)).rules.follows == {"a-2": "a-1"}
