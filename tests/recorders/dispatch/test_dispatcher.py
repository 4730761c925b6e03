"""How a plan is handed out, mode by mode."""

from __future__ import annotations

from dataclasses import replace

import pytest
from dispatching import START_NS, line, play, problem_of, steps_of

from hrclog.errors import DispatchError, ScenarioError
from hrclog.events import Event, Outcome, Role, TaskDispatched, TaskFact
from hrclog.planning.plan import Arrival, Plan, PlanItem, make_plan
from hrclog.planning.problem import Precedence
from hrclog.recorders.clock import Clock
from hrclog.recorders.dispatch.dispatcher import Dispatcher
from hrclog.recorders.dispatch.policy import DispatchPolicy
from hrclog.recorders.dispatch.real_time import RealTimeLoop
from hrclog.recorders.dispatch.run_setup import RunSetup
from hrclog.recorders.executors.scripted import ScriptedExecutor, ScriptStep
from hrclog.sim.event_queue import EventQueue


def took(seconds: float) -> ScriptStep:
    """Return a step of so many seconds."""
    return ScriptStep(agent="", task="", duration_s=seconds)


def with_fields(plan: Plan, item_id: str, **fields: object) -> Plan:
    """Return a plan with an item changed."""
    items = (replace(i, **fields) if i.item_id == item_id else i for i in plan.items)  # type: ignore[arg-type] - fields of an item
    return replace(plan, items=tuple(items))


def test_each_agent_goes_its_own_way_in_sequential_mode() -> None:
    plan = line("a-1", "b-1", "a-2", "b-2<a-1")
    played = play(plan, steps_of(plan, {"a-1": took(5.0)}))
    assert played.dispatched_s() == {"a-1": 0.0, "b-1": 0.0, "a-2": 5.0, "b-2": 5.0}


def test_the_story_of_one_item() -> None:
    played = play(line("a-1"))
    assert played.story() == [
        (0.0, "task_dispatched", "a-1"),
        (0.0, "task_started", "a-1"),
        (1.0, "task_ended", "a-1", "succeeded"),
    ]
    first = played.events[0]
    assert isinstance(first, TaskDispatched)
    assert (first.task_type, first.role, first.attempt) == ("type of 1", "primary", 1)


def test_nothing_starts_before_its_planned_start_in_timed_mode() -> None:
    plan = with_fields(line("a-1", "a-2", "b-1"), "a-2", planned_start_s=7.5)
    assert play(plan, policy=DispatchPolicy(mode="timed")).dispatched_s() == {"a-1": 0.0, "b-1": 0.0, "a-2": 7.5}
    assert play(plan).dispatched_s()["a-2"] == 1.0


def test_rows_wait_for_each_other_in_synchronous_mode() -> None:
    plan = line("a-1", "b-1", "a-2", "b-2", "a-3")
    played = play(plan, steps_of(plan, {"a-1": took(5.0), "b-2": took(3.0)}), DispatchPolicy(mode="synchronous"))
    assert played.dispatched_s() == {"a-1": 0.0, "b-1": 0.0, "a-2": 5.0, "b-2": 5.0, "a-3": 8.0}


def test_a_barrier_opens_whatever_the_outcome_of_what_is_behind_it() -> None:
    plan = line("a-1", "b-1", "b-2")
    played = play(
        plan, steps_of(plan, {"a-1": replace(took(3.0), outcome="failed")}), DispatchPolicy(mode="synchronous")
    )
    assert played.dispatched_s()["b-2"] == 3.0


def test_items_that_meet_start_together_in_asynchronous_mode() -> None:
    plan = line("a-1", "b-1", "a-lift", "b-lift", "c-1")
    for item_id in ("a-lift", "b-lift"):
        plan = with_fields(plan, item_id, meet="lift")
    steps = steps_of(plan, {"a-1": took(5.0)})
    assert play(plan, steps, DispatchPolicy(mode="asynchronous")).dispatched_s() == {
        "a-1": 0.0,
        "b-1": 0.0,
        "c-1": 0.0,
        "a-lift": 5.0,
        "b-lift": 5.0,
    }
    assert play(plan, steps).dispatched_s()["b-lift"] == 1.0


def test_who_waits_for_a_fact_keeps_the_partner_waiting_too() -> None:
    plan = line("a-lift", "b-lift", arrivals=(Arrival("crane", 4.0),))
    plan = with_fields(with_fields(plan, "a-lift", meet="lift", needs=("crane",)), "b-lift", meet="lift")
    assert play(plan, policy=DispatchPolicy(mode="asynchronous")).dispatched_s() == {"a-lift": 4.0, "b-lift": 4.0}


def test_a_meeting_that_a_partner_cannot_come_to_is_skipped_by_all() -> None:
    plan = line("a-1", "a-lift<a-1", "b-lift", "b-2")
    for item_id in ("a-lift", "b-lift"):
        plan = with_fields(plan, item_id, meet="lift")
    steps = steps_of(plan, {"a-1": replace(took(1.0), outcome="failed")})
    played = play(plan, steps, DispatchPolicy(mode="asynchronous"))
    assert played.dispatcher.outcomes == {"a-1": "failed", "a-lift": "skipped", "b-lift": "skipped", "b-2": "succeeded"}
    reasons = {end.item_id: end.reason for end in played.ends() if end.outcome == "skipped"}
    assert reasons == {"a-lift": "needs a-1 (failed)", "b-lift": "needs a-1 (failed), a-lift (skipped)"}


def test_reactive_agents_take_the_first_item_that_is_ready() -> None:
    plan = line("a-1", "a-2", "a-3", arrivals=(Arrival("part", 1.5),))
    plan = with_fields(plan, "a-1", needs=("part",))
    assert play(plan, policy=DispatchPolicy(mode="reactive")).dispatched_s() == {"a-2": 0.0, "a-3": 1.0, "a-1": 2.0}


def test_in_the_other_modes_a_missing_fact_holds_up_the_queue() -> None:
    plan = with_fields(line("a-1", "a-2", arrivals=(Arrival("part", 1.5),)), "a-1", needs=("part",))
    played = play(plan)
    assert played.dispatched_s() == {"a-1": 1.5, "a-2": 2.5}
    (note,) = played.notes()
    assert (note.time_ns, note.reason, note.details) == (START_NS + 1_500_000_000, "part arrived", {"arrived": "part"})


def test_a_reactive_agent_picks_what_it_cannot_place_yet_only_when_nothing_else_is_left() -> None:
    plan = line("b-1", "a-pick", "a-place<a-pick,b-1", "a-2")
    problem = problem_of(plan, [Precedence("pick", "place")])
    steps = steps_of(plan, {"b-1": took(2.5)})
    played = play(plan, steps, DispatchPolicy(mode="reactive"), problem)
    assert played.dispatched_s() == {"b-1": 0.0, "a-2": 0.0, "a-pick": 1.0, "a-place": 2.5}


def test_a_picked_part_is_placed_before_anything_that_has_become_ready() -> None:
    plan = line("a-pick", "a-place<a-pick", "a-0", arrivals=(Arrival("go", 0.5),))
    plan = with_fields(replace(plan, items=(plan.items[2], *plan.items[:2])), "a-0", needs=("go",))
    played = play(plan, policy=DispatchPolicy(mode="reactive"), problem=problem_of(plan, [Precedence("pick", "place")]))
    assert list(played.dispatched_s()) == ["a-pick", "a-place", "a-0"]


def test_a_handshake_in_the_middle_of_a_chain_does_not_stop_a_reactive_agent() -> None:
    plan = line("a-pick", "b-1<a-pick", "a-place<a-pick,b-1")
    played = play(plan, policy=DispatchPolicy(mode="reactive"), problem=problem_of(plan, [Precedence("pick", "place")]))
    assert played.dispatched_s() == {"a-pick": 0.0, "b-1": 1.0, "a-place": 2.0}


def test_a_reactive_agent_skips_what_is_lost_wherever_it_stands() -> None:
    plan = with_fields(line("b-1", "a-1", "a-2<b-1"), "a-1", needs=("never",))
    steps = steps_of(plan, {"b-1": replace(took(1.0), outcome="failed")})
    reasons = {end.item_id: end.reason for end in play(plan, steps, DispatchPolicy(mode="reactive")).ends()}
    assert reasons == {"b-1": "", "a-2": "needs b-1 (failed)", "a-1": "needs never, which never arrived"}


def test_a_fact_that_comes_from_outside_is_taken_in_once() -> None:
    plan = with_fields(line("a-1"), "a-1", needs=("part",))
    queue, events = EventQueue(START_NS), list[Event]()
    executors = {"a": ScriptedExecutor(steps_of(plan, {"a-1": took(5.0)}), queue)}
    dispatcher = Dispatcher(
        RunSetup(plan=plan, problem=problem_of(plan)), executors, queue, run_id="r", emit=events.append
    )
    for at_s in (3, 4):
        queue.schedule(START_NS + at_s * 10**9, lambda: dispatcher.arrive("part"))
    dispatcher.run()
    assert [(e.kind, (e.time_ns - START_NS) / 1e9) for e in events] == [
        ("annotation_added", 3.0),
        ("task_dispatched", 3.0),
        ("task_started", 3.0),
        ("task_ended", 8.0),
    ]


@pytest.mark.parametrize("mode", ["sequential", "timed", "synchronous", "asynchronous", "reactive"])
def test_a_resource_is_used_by_one_at_a_time_in_every_mode(mode: str) -> None:
    plan = line("a-1", "b-2", "c-3")
    problem = problem_of(plan, resources={"1": ("jig",), "2": ("jig", "tool"), "3": ("tool",)})
    played = play(plan, policy=DispatchPolicy(mode=mode), problem=problem)
    assert played.dispatched_s() == {"a-1": 0.0, "c-3": 0.0, "b-2": 1.0}


def test_who_is_asked_first_gets_a_resource_that_comes_free() -> None:
    plan = line("a-1", "b-2", "c-3")
    problem = problem_of(plan, resources={"1": ("jig",), "2": ("jig",), "3": ("jig",)})
    assert play(plan, problem=problem).dispatched_s() == {"a-1": 0.0, "b-2": 1.0, "c-3": 2.0}


def test_a_resource_is_kept_while_an_item_is_tried_again_and_given_back_when_it_is_given_up() -> None:
    plan = line("a-1", "a-3", "b-2")
    problem = problem_of(plan, resources={"1": ("jig",), "2": ("jig",)})
    steps = steps_of(plan, {"a-1": replace(took(2.0), outcome="failed")})
    played = play(plan, steps, DispatchPolicy(max_attempts=3), problem)
    assert played.dispatched_s() == {"a-1": 0.0, "a-3": 6.0, "b-2": 6.0}


def test_those_who_meet_wait_for_what_any_of_them_uses() -> None:
    plan = line("a-1", "c-1", "a-lift", "b-hold", "c-see")
    for item_id in ("a-lift", "b-hold"):
        plan = with_fields(plan, item_id, meet="lift")
    problem = problem_of(plan, resources={"1": (), "hold": ("jig",), "see": ("jig",)})
    steps = steps_of(plan, {"c-see": took(5.0), "a-1": took(2.0)})
    played = play(plan, steps, DispatchPolicy(mode="asynchronous"), problem)
    assert played.dispatched_s() == {"a-1": 0.0, "c-1": 0.0, "c-see": 1.0, "a-lift": 6.0, "b-hold": 6.0}


def test_nothing_is_handed_out_before_its_task_is_released() -> None:
    problem = problem_of(line("a-1", "b-2"))
    late = replace(problem, tasks=(replace(problem.task("1"), release_s=3.5), problem.task("2")))
    plan = make_plan(late, {"a": ["1"], "b": ["2"]})
    assert play(plan, problem=late).dispatched_s() == {"a-01": 3.5, "b-01": 0.0}


def test_auxiliary_tasks_are_told_as_such() -> None:
    plan = line("a-1", "a-home")
    problem = problem_of(plan)
    home = replace(problem.task("home"), role=Role.AUXILIARY)
    problem = replace(problem, tasks=(problem.task("1"), home))
    facts = [event for event in play(plan, problem=problem).events if isinstance(event, TaskFact)]
    assert {fact.item_id: fact.role for fact in facts} == {"a-1": "primary", "a-home": "auxiliary"}


def test_an_empty_plan_is_done_at_once() -> None:
    played = play(Plan("empty", ()), problem=problem_of(line("a-1")))
    assert played.events == ()
    assert played.dispatcher.verdict() == (Outcome.SUCCEEDED, "")


def test_who_is_told_that_all_is_done_is_told_once() -> None:
    plan = line("a-1", "b-1")
    queue, told = EventQueue(START_NS), list[int]()
    dispatcher = Dispatcher(
        RunSetup(plan=plan, problem=problem_of(plan)),
        {},
        queue,
        run_id="r",
        emit=lambda _: None,
        on_done=lambda: told.append(queue.now_ns),
    )
    dispatcher.run()
    assert told == [START_NS]


def test_a_thousand_items_that_end_at_once_do_not_pile_up() -> None:
    plan = Plan("long", tuple(PlanItem(str(n), "a", "t") for n in range(1000)))
    steps = [ScriptStep(agent="a", task="t", misbehaviour="raises")]
    played = play(plan, steps, DispatchPolicy(max_attempts=2))
    assert len(played.ends()) == 2000


@pytest.mark.parametrize(
    ("plan", "mode", "message"),
    [
        (
            Plan("p", (PlanItem("1", "a", "t", ("9",)),)),
            "sequential",
            "item '1' waits for '9', which is not in the plan",
        ),
        (
            Plan("p", (PlanItem("1", "a", "t", ("2",)), PlanItem("2", "a", "t"))),
            "sequential",
            "in mode sequential the items .* wait for each other in a circle",
        ),
        (
            Plan("p", (PlanItem("b1", "b", "t"), PlanItem("b2", "b", "t"), PlanItem("a1", "a", "t", ("b2",)))),
            "synchronous",
            "in mode synchronous the items .*b2.* wait for each other in a circle",
        ),
        (
            Plan(
                "p",
                (
                    PlanItem("a1", "a", "t", meet="x"),
                    PlanItem("a2", "a", "t", meet="y"),
                    PlanItem("b1", "b", "t", meet="y"),
                    PlanItem("b2", "b", "t", meet="x"),
                ),
            ),
            "asynchronous",
            "in mode asynchronous the items .* wait for each other in a circle",
        ),
    ],
)
def test_a_plan_that_could_never_end_is_refused_before_anything_happens(plan: Plan, mode: str, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        play(plan, [], DispatchPolicy(mode=mode))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"mode": "now"}, "mode: found 'now', expected one of sequential, timed"),
        ({"on_failure": "cry"}, "on_failure: found 'cry', expected one of skip, abort"),
        ({"replan_on": ("failure", "boredom")}, "replan_on: found 'boredom', expected one of failure, delay"),
        ({"delay_s": -1.0}, "delay_s: found -1.0, expected a finite number from 0"),
        ({"max_replans": -1}, "max_replans: found -1, expected at least 0"),
        ({"max_attempts": 0}, "max_attempts: found 0, expected at least 1"),
        ({"timeout_s": 0.0}, r"timeout_s: found 0.0, expected a finite number above 0"),
        ({"grace_s": float("inf")}, r"grace_s: found inf, expected a finite number from 0"),
        ({"grace_s": float("nan")}, r"grace_s: found nan, expected a finite number from 0"),
    ],
)
def test_a_policy_out_of_range_is_refused(fields: dict[str, object], message: str) -> None:
    with pytest.raises(DispatchError, match=message):
        DispatchPolicy(**fields)  # type: ignore[arg-type] - the wrong values are the point


@pytest.mark.parametrize("clock", [EventQueue(0), RealTimeLoop()], ids=["simulated", "real"])
def test_both_clocks_do_first_what_is_submitted_then_what_is_due(clock: Clock) -> None:
    seen: list[str] = []
    now_ns = clock.now_ns
    clock.schedule(now_ns + 10_000_000, lambda: seen.append("later"))
    clock.schedule(now_ns, lambda: seen.append("second"), 1)
    clock.schedule(now_ns, lambda: seen.append("first"))
    clock.submit(lambda: seen.append("at once"))
    clock.run(lambda: len(seen) == 4)
    assert seen == ["at once", "first", "second", "later"]
