"""The laws of dispatching, in every mode, whatever the executors do."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from itertools import pairwise

import pytest
from dispatch_strategies import FACTS, plans, policies, scripts
from dispatching import Played, play, problem_of
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hrclog.errors import ScenarioError
from hrclog.event_rows import check_row, to_row
from hrclog.events import AnnotationAdded, Outcome, TaskDispatched, TaskEnded, TaskFact, TaskStarted
from hrclog.planning.dispatch_mode import DispatchMode, schedule_of
from hrclog.planning.plan import Arrival, Plan
from hrclog.planning.problem import Precedence, Problem
from hrclog.recorders.dispatch.policy import DispatchPolicy, OnFailure
from hrclog.state import PLANNED, apply

pytestmark = pytest.mark.slow


def check_events(plan: Plan, played: Played, policy: DispatchPolicy) -> None:
    """Assert that the log is a possible one, and that it tells the outcomes that the dispatcher has."""
    items = {item.item_id: item for item in plan.items}
    states = defaultdict(lambda: PLANNED)
    active: dict[str, str] = {}
    over: dict[str, str] = {}
    facts: set[str] = set()
    attempts: dict[str, int] = defaultdict(int)
    for event in played.events:
        check_row(to_row(event))
        if isinstance(event, AnnotationAdded) and "arrived" in event.details:
            facts.add(event.details["arrived"])
        if not isinstance(event, TaskFact):
            continue
        states[event.execution_id], problem = apply(states[event.execution_id], event)
        assert problem is None
        item = items[event.item_id]
        if isinstance(event, TaskDispatched):
            attempts[event.item_id] += 1
            assert event.attempt == attempts[event.item_id] <= policy.max_attempts
            assert all(over.get(other) == Outcome.SUCCEEDED for other in item.after)
            assert facts >= set(item.needs)
            assert over.get(event.item_id) in (None, Outcome.FAILED, Outcome.TIMED_OUT)
            assert active.setdefault(event.agent, event.execution_id) == event.execution_id
        elif isinstance(event, TaskEnded):
            assert active.pop(event.agent, event.execution_id) == event.execution_id
            over[event.item_id] = event.outcome
    assert over == played.dispatcher.outcomes
    assert not active
    assert played.dispatcher.done
    assert all(before.time_ns <= after.time_ns for before, after in pairwise(played.events))


def started_rows(plan: Plan, played: Played) -> None:
    """Assert that no item of a row starts before all of the rows before it are over."""
    rows = {item.item_id: place for agent in plan.agents() for place, item in enumerate(plan.queue(agent))}
    left = dict(rows)
    for event in played.events:
        if isinstance(event, TaskStarted | TaskDispatched):
            assert all(row >= rows[event.item_id] for row in left.values())
        elif isinstance(event, TaskEnded) and event is last_end(played, event.item_id):
            del left[event.item_id]


def last_end(played: Played, item_id: str) -> TaskEnded:
    """Return the final end of an item."""
    return [end for end in played.ends() if end.item_id == item_id][-1]


def orders_kept(plan: Plan, played: Played) -> None:
    """Assert that each agent's items were handed out in the order of its queue."""
    given_out = list(played.dispatched_s())
    for agent in plan.agents():
        queue = [item.item_id for item in plan.queue(agent)]
        assert [name for name in given_out if name in queue] == [name for name in queue if name in given_out]


@settings(max_examples=150, deadline=None)
@given(st.data(), plans(), policies)
def test_every_run_ends_and_every_item_has_one_outcome_whatever_executors_do(
    data: st.DataObject, plan: Plan, policy: DispatchPolicy
) -> None:
    played = play(plan, data.draw(scripts(plan)), policy)
    check_events(plan, played, policy)
    outcome, reason = played.dispatcher.verdict()
    outcomes = played.dispatcher.outcomes
    if policy.on_failure == OnFailure.SKIP:
        assert set(outcomes) == {item.item_id for item in plan.items}
    all_well = len(outcomes) == len(plan.items) and set(outcomes.values()) <= {Outcome.SUCCEEDED}
    assert (outcome == Outcome.SUCCEEDED) == all_well == (not reason)


@settings(max_examples=60, deadline=None)
@given(st.data(), plans(fewest=2), policies)
def test_synchronous_rows_never_overlap(data: st.DataObject, plan: Plan, policy: DispatchPolicy) -> None:
    policy = replace(policy, mode=DispatchMode.SYNCHRONOUS, on_failure=OnFailure.SKIP)
    played = play(plan, data.draw(scripts(plan)), policy)
    started_rows(plan, played)
    orders_kept(plan, played)


@settings(max_examples=60, deadline=None)
@given(st.data(), plans(meets=True, fewest=2), policies)
def test_partners_that_meet_are_handed_their_items_at_the_same_instant(
    data: st.DataObject, plan: Plan, policy: DispatchPolicy
) -> None:
    policy = replace(policy, mode=DispatchMode.ASYNCHRONOUS, on_failure=OnFailure.SKIP)
    problem = problem_of(plan)
    try:
        schedule_of(plan, DispatchMode.ASYNCHRONOUS, problem)
    except ScenarioError:
        assume(False)
    played = play(plan, data.draw(scripts(plan)), policy)
    check_events(plan, played, policy)
    orders_kept(plan, played)
    when = played.dispatched_s()
    for label in {item.meet for item in plan.items} - {""}:
        assert len({when[i.item_id] for i in plan.items if i.meet == label and i.item_id in when}) <= 1


@settings(max_examples=100, deadline=None)
@given(st.data(), plans(meets=True), policies)
def test_nothing_is_used_twice_at_a_time_and_every_run_still_ends(
    data: st.DataObject, plan: Plan, policy: DispatchPolicy
) -> None:
    used = {item.task: tuple(sorted(data.draw(st.sets(st.sampled_from("xyz"), max_size=2)))) for item in plan.items}
    problem = problem_of(plan, resources=used)
    try:
        schedule_of(plan, DispatchMode(policy.mode), problem)
    except ScenarioError:
        assume(False)
    played = play(plan, data.draw(scripts(plan)), policy, problem)
    check_events(plan, played, policy)
    taken: dict[str, str] = {}
    for event in played.events:
        if isinstance(event, TaskDispatched):
            assert {taken.setdefault(name, event.item_id) for name in used[event.task]} <= {event.item_id}
        elif isinstance(event, TaskEnded):
            taken = {name: item_id for name, item_id in taken.items() if item_id != event.item_id}
    if policy.on_failure == OnFailure.SKIP:
        assert set(played.dispatcher.outcomes) == {item.item_id for item in plan.items}


@pytest.mark.parametrize("mode", DispatchMode)
@given(plan=plans(), data=st.data())
@settings(max_examples=15, deadline=None)
def test_well_behaved_agents_share_resources_to_a_good_end(mode: DispatchMode, plan: Plan, data: st.DataObject) -> None:
    used = {item.task: tuple(data.draw(st.sets(st.sampled_from("xy")))) for item in plan.items}
    arrivals = tuple(Arrival(fact, 2.0) for fact in FACTS)
    problem = problem_of(plan, resources=used)
    played = play(replace(plan, arrivals=arrivals), None, DispatchPolicy(mode=mode), problem)
    assert played.dispatcher.verdict() == (Outcome.SUCCEEDED, "")


@settings(max_examples=60, deadline=None)
@given(st.data(), plans(), policies)
def test_planned_starts_are_kept_in_timed_mode_and_orders_in_all_but_the_reactive(
    data: st.DataObject, plan: Plan, policy: DispatchPolicy
) -> None:
    played = play(plan, data.draw(scripts(plan)), policy)
    if policy.mode != DispatchMode.REACTIVE:
        orders_kept(plan, played)
    if policy.mode == DispatchMode.TIMED:
        when = played.dispatched_s()
        assert all(when[i.item_id] >= (i.planned_start_s or 0.0) for i in plan.items if i.item_id in when)


def paired(plan: Plan) -> tuple[Plan, Problem]:
    """Return a plan whose items 0 and 1, 2 and 3 of each agent must directly follow each other."""
    before = {
        item.item_id: earlier.item_id
        for agent in plan.agents()
        for earlier, item in list(pairwise(plan.queue(agent)))[::2]
    }
    items = (replace(i, after=(*i.after, before[i.item_id])) if i.item_id in before else i for i in plan.items)
    joined = replace(plan, items=tuple(items))
    pairs = [
        Precedence(queue[place].task, queue[place + 1].task)
        for queue in map(joined.queue, joined.agents())
        for place in range(0, len(queue) - 1, 2)
    ]
    return joined, problem_of(joined, pairs)


@settings(max_examples=60, deadline=None)
@given(st.data(), plans(fewest=2), policies)
def test_reactive_agents_never_tear_apart_what_must_follow_at_once(
    data: st.DataObject, plan: Plan, policy: DispatchPolicy
) -> None:
    plan, problem = paired(plan)
    policy = replace(policy, mode=DispatchMode.REACTIVE, on_failure=OnFailure.SKIP)
    played = play(plan, data.draw(scripts(plan)), policy, problem)
    check_events(plan, played, policy)
    given_out = list(played.dispatched_s())
    for agent in plan.agents():
        queue = [item.item_id for item in plan.queue(agent)]
        mine = [name for name in given_out if name in queue]
        for first, second in zip(queue[::2], queue[1::2], strict=False):
            if second in mine:
                assert mine.index(second) == mine.index(first) + 1


@pytest.mark.parametrize("mode", DispatchMode)
@given(plan=plans())
@settings(max_examples=15, deadline=None)
def test_well_behaved_agents_bring_every_plan_to_a_good_end(mode: DispatchMode, plan: Plan) -> None:
    arrivals = tuple(Arrival(fact, 2.0) for fact in FACTS)
    played = play(replace(plan, arrivals=arrivals), None, DispatchPolicy(mode=mode))
    assert played.dispatcher.verdict() == (Outcome.SUCCEEDED, "")
