"""Another plan for a run under way: when it is asked for, what it may change, and what the run comes to."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest
from dispatch_strategies import plans, policies, scripts
from dispatching import START_NS, Played, line, play, problem_of, steps_of
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.analyzers.projections.intervals import rebuild
from hrclog.errors import ScenarioError
from hrclog.event_rows import from_row, to_row
from hrclog.events import Event, Outcome, PlanChanged, RunStarted, TaskDispatched, TaskEnded, TaskFact
from hrclog.log.messages.decode import frame_of_rows
from hrclog.log.reader import read_events
from hrclog.planning.dispatch_mode import DispatchMode
from hrclog.planning.plan import Arrival, Plan, PlanItem, plan_of_value
from hrclog.planning.problem import Problem, Task
from hrclog.planning.run_state import Replan, Running, RunState, run_state
from hrclog.recorders.dispatch.live_run import run_live
from hrclog.recorders.dispatch.policy import DispatchPolicy, OnFailure
from hrclog.recorders.dispatch.real_time import RealTimeLoop
from hrclog.recorders.dispatch.run_setup import RunSetup
from hrclog.recorders.executors.scripted import Misbehaviour, ScriptedExecutor, ScriptStep
from hrclog.sim.event_queue import EventQueue
from hrclog.sim.run import carry_out, plan_of, policy_of
from hrclog.sim.scenario import load_scenario

ON_FAILURE = DispatchPolicy(replan_on=("failure",))
FAILS = ScriptStep(agent="", task="", outcome="failed", reason="grasp lost")


def took(seconds: float) -> ScriptStep:
    """Return a step of so many seconds."""
    return ScriptStep(agent="", task="", duration_s=seconds)


def shared(plan: Plan) -> Problem:
    """Return a problem of a plan in which every agent can do everything."""
    problem = problem_of(plan)
    return replace(problem, tasks=tuple(Task(task.name, problem.agents) for task in problem.tasks))


def for_everybody(plan: Plan, failing: str = "") -> list[ScriptStep]:
    """Return a step of a second for every agent and task; one item fails the first time."""
    steps = [ScriptStep(agent=agent, task=i.task) for agent in plan.agents() for i in plan.items]
    return [replace(FAILS, agent=i.agent, task=i.task) for i in plan.items if i.item_id == failing] + steps


def always(plan: Plan | None) -> Replan:
    """Return a planner of one answer."""
    return lambda _, __: plan


def again(state: RunState, _: str) -> Plan:
    """Give all that failed back as a new item before what is left, which waits for it in place of the old one."""
    failed = {
        i.item_id: replace(i, item_id=f"{i.item_id}'")
        for i in state.plan.items
        if state.outcomes.get(i.item_id) in LOST
    }
    running = {run.item_id for run in state.running.values()}
    kept = [i for i in state.plan.items if i.item_id not in failed]
    begun = [i for i in kept if i.item_id in state.outcomes or i.item_id in running]
    rest = [*failed.values(), *(i for i in kept if i not in begun)]
    new_ids = {old: new.item_id for old, new in failed.items()}
    waiting = [replace(i, after=tuple(new_ids.get(other, other) for other in i.after)) for i in rest]
    return Plan("again", (*begun, *waiting), state.plan.arrivals)


LOST = (Outcome.FAILED, Outcome.TIMED_OUT)


def changes(played: Played) -> list[PlanChanged]:
    """Return every change of the plan, in order."""
    return [event for event in played.events if isinstance(event, PlanChanged)]


def test_a_failed_item_that_comes_back_as_a_new_one_makes_the_run_end_well() -> None:
    plan = line("a-1", "a-2<a-1", "b-1")
    played = play(plan, for_everybody(plan, "a-1"), ON_FAILURE, shared(plan), replan=again)
    assert played.dispatched_s() == {"a-1": 0.0, "b-1": 0.0, "a-1'": 1.0, "a-2": 2.0}
    assert played.dispatcher.outcomes == {
        "a-1": "failed",
        "b-1": "succeeded",
        "a-1'": "succeeded",
        "a-2": "succeeded",
    }
    assert played.dispatcher.verdict() == (Outcome.SUCCEEDED, "")
    (change,) = changes(played)
    assert (change.time_ns, change.reason) == (START_NS + 10**9, "a-1 (1) failed: grasp lost")
    assert plan_of_value(change.plan, "log").orders() == {"a": ("1", "2"), "b": ("1",)}


def test_the_other_agent_may_take_over() -> None:
    plan = line("a-1", "a-2", "b-3")
    handed = Plan("handed", (plan.items[2], PlanItem("b-1", "b", "1"), PlanItem("a-2", "b", "2")))
    played = play(plan, for_everybody(plan, "a-1"), ON_FAILURE, shared(plan), replan=always(handed))
    assert played.dispatched_s() == {"a-1": 0.0, "b-3": 0.0, "b-1": 1.0, "a-2": 2.0}
    assert {event.agent for event in played.events if isinstance(event, TaskEnded) and event.item_id == "a-2"} == {"b"}
    assert played.dispatcher.verdict() == (Outcome.SUCCEEDED, "")


def test_what_a_new_plan_leaves_out_is_missed_in_the_end() -> None:
    plan = line("a-1", "a-2", "b-3")
    less = Plan("less", (plan.items[2],))
    played = play(plan, for_everybody(plan, "a-1"), ON_FAILURE, shared(plan), replan=always(less))
    assert played.dispatcher.outcomes == {"a-1": "failed", "b-3": "succeeded"}
    expected = "not all of the first plan was done: 1 0 of 1 times, 2 0 of 1 times"
    assert played.dispatcher.verdict() == (Outcome.FAILED, expected)


def test_a_failure_is_replanned_only_after_the_last_attempt_and_before_it_is_skipped_or_aborted() -> None:
    plan = line("a-1", "a-2<a-1")
    asked: list[float] = []

    def replan(state: RunState, reason: str) -> Plan | None:
        asked.append(state.now_s)
        return again(state, reason)

    steps = [replace(FAILS, agent="a", task="1")] * 2 + for_everybody(plan)
    policy = DispatchPolicy(max_attempts=2, on_failure="abort", replan_on=("failure",))
    played = play(plan, steps, policy, replan=replan)
    assert asked == [2.0]
    assert played.dispatcher.verdict() == (Outcome.SUCCEEDED, "")


@pytest.mark.parametrize(
    ("on_failure", "outcomes", "verdict"),
    [
        ("skip", {"a-1": "failed", "a-2": "skipped", "b-3": "succeeded"}, "2 of 3 items did not succeed"),
        ("abort", {"a-1": "failed", "b-3": "canceled"}, r"a-1 (1) failed 1 times"),
    ],
)
def test_without_another_plan_all_goes_on_as_it_would_have(
    on_failure: str, outcomes: dict[str, str], verdict: str
) -> None:
    plan = line("a-1", "a-2<a-1", "b-3")
    steps = steps_of(plan, {"a-1": FAILS, "b-3": took(5.0)})
    policy = replace(ON_FAILURE, on_failure=on_failure)
    same = play(plan, steps, replace(policy, replan_on=()))
    for replan in (always(None), always(plan)):
        played = play(plan, steps, policy, replan=replan)
        assert played.story() == same.story()
        assert played.dispatcher.outcomes == outcomes
        assert played.dispatcher.verdict() == (Outcome.FAILED, verdict)


def test_nobody_is_asked_on_what_the_policy_does_not_name() -> None:
    plan = line("a-1", "b-1")
    for policy in (DispatchPolicy(), DispatchPolicy(replan_on=("delay",))):
        played = play(plan, steps_of(plan, {"a-1": FAILS}), policy, replan=always(Plan("none", ())))
        assert not changes(played)


def timed(plan: Plan, seconds: float = 1.0) -> Plan:
    """Return a plan with planned times of so many seconds for each item."""
    places = {item.item_id: place for agent in plan.agents() for place, item in enumerate(plan.queue(agent))}
    return replace(
        plan,
        items=tuple(
            replace(i, planned_start_s=places[i.item_id] * seconds, planned_end_s=(places[i.item_id] + 1) * seconds)
            for i in plan.items
        ),
    )


def test_each_item_that_is_late_asks_once_when_it_runs_over_or_starts() -> None:
    plan = timed(line("a-1", "a-2", "a-3", "b-1"))
    asked: list[tuple[float, str]] = []

    def replan(state: RunState, reason: str) -> None:
        asked.append((round(state.now_s, 6), reason))

    policy = DispatchPolicy(replan_on=("delay",), delay_s=2.0)
    play(plan, steps_of(plan, {"a-1": took(7.0)}), policy, replan=replan)
    assert asked == [
        (3.0, "a-1 (1) is 2.0 s over its planned end"),
        (7.0, "a-2 (2) started 6.0 s late"),
        (8.0, "a-3 (3) started 6.0 s late"),
    ]


def test_a_delay_that_is_not_longer_than_allowed_is_none() -> None:
    plan = timed(line("a-1", "a-2"))
    asked: list[str] = []
    policy = DispatchPolicy(replan_on=("delay",), delay_s=2.0)
    play(plan, steps_of(plan, {"a-1": took(3.0)}), policy, replan=lambda _, reason: asked.append(reason))
    assert asked == []


def test_a_new_plan_for_a_late_run_moves_the_rest_and_what_runs_is_late_by_its_new_times_only() -> None:
    plan = timed(line("a-1", "a-2", "b-1"))
    later = Plan(
        "later",
        (
            replace(plan.items[0], planned_end_s=9.0),
            plan.items[2],
            replace(plan.items[1], agent="b", planned_start_s=3.0, planned_end_s=4.0),
        ),
    )
    policy = DispatchPolicy(replan_on=("delay",), delay_s=2.0)
    played = play(plan, [took_by("a", "1", 9.0), *for_everybody(plan)], policy, shared(plan), replan=always(later))
    assert [change.reason for change in changes(played)] == ["a-1 (1) is 2.0 s over its planned end"]
    assert round(played.dispatched_s()["a-2"], 6) == 3.0
    assert played.dispatcher.verdict() == (Outcome.SUCCEEDED, "")


def took_by(agent: str, task: str, seconds: float) -> ScriptStep:
    """Return a step of an agent's task."""
    return ScriptStep(agent=agent, task=task, duration_s=seconds)


def test_what_arrives_in_a_new_plan_counts_from_the_start_and_the_old_plans_arrivals_do_not() -> None:
    plan = line("a-1", "a-2", "b-3", "b-4", arrivals=(Arrival("door", 2.0),))
    needy = [replace(i, needs=needs) for i, needs in zip(plan.items, ((), ("door",), (), ("part",)), strict=True)]
    plan = replace(plan, items=tuple(needy))
    new = Plan(
        "new",
        (needy[2], PlanItem("a-1'", "a", "1"), needy[1], needy[3]),
        (Arrival("part", 0.5), Arrival("door", 6.0)),
    )
    played = play(plan, for_everybody(plan, "a-1"), ON_FAILURE, shared(plan), replan=always(new))
    assert played.dispatched_s() == {"a-1": 0.0, "b-3": 0.0, "a-1'": 1.0, "b-4": 1.0, "a-2": 6.0}


def test_two_failures_at_one_instant_are_answered_by_one_plan_that_replaces_both() -> None:
    plan = line("b-2", "a-1")
    raises = ScriptStep(agent="b", task="2", misbehaviour=Misbehaviour.RAISES)
    rejects = ScriptStep(agent="a", task="1", misbehaviour=Misbehaviour.REJECTS)
    steps = [raises, raises, took_by("b", "2", 1.0), rejects, took_by("a", "1", 1.0)]
    played = play(plan, steps, replace(ON_FAILURE, max_attempts=2, on_failure="abort"), replan=again)
    assert len(changes(played)) == 1
    assert played.dispatcher.verdict() == (Outcome.SUCCEEDED, "")


def test_what_runs_is_watched_by_the_times_of_a_new_plan() -> None:
    plan = line("a-1", "b-2")
    reasons: list[str] = []

    def replan(state: RunState, reason: str) -> Plan:
        reasons.append(reason)
        return timed(again(state, reason), 2.0)

    policy = DispatchPolicy(replan_on=("failure", "delay"), delay_s=1.5)
    play(plan, [took_by("b", "2", 9.0), *for_everybody(plan, "a-1")], policy, shared(plan), replan=replan)
    assert reasons == ["a-1 (1) failed: grasp lost", "b-2 (2) is 1.5 s over its planned end"]


def test_a_planner_is_asked_when_what_is_tried_again_has_begun_again() -> None:
    plan = line("b-2", "a-1")
    seen: list[RunState] = []
    raises = ScriptStep(agent="b", task="2", misbehaviour=Misbehaviour.RAISES)
    steps = [raises, raises, took_by("b", "2", 3.0), ScriptStep(agent="a", task="1", misbehaviour=Misbehaviour.REJECTS)]
    play(plan, steps, replace(ON_FAILURE, max_attempts=3), replan=lambda state, _: seen.append(state))
    (state,) = seen
    assert state.outcomes == {"a-1": "failed"}
    assert state.running == {"b": Running("b-2", None, 3)}


def run_over(_: RunState, __: str) -> Plan:
    """Fail as a planner."""
    raise ScenarioError("no plan was found in 2 s; give it longer")


def stumble(_: RunState, __: str) -> Plan:
    """Fail as no planner should."""
    raise KeyError("robot")


@pytest.mark.parametrize(
    ("replan", "message"),
    [
        (run_over, "no plan was found in 2 s; give it longer"),
        (stumble, "KeyError: 'robot'"),
        (
            always(line("a-1", "a-2", "a-4")),
            "plan 'line': first of what is left to 'b': found nothing, expected 'b-3', which is running; put it first",
        ),
        (
            always(line("b-4", "b-3")),
            "plan 'line': first of what is left to 'b': found 'b-4', expected 'b-3', which is running; put it first",
        ),
        (
            always(Plan("p", (PlanItem("b-3", "a", "3"),))),
            "plan 'p': item 'b-3' is '3' by 'a', but it was begun as '3' by 'b'; give it a new id",
        ),
        (
            always(Plan("p", (PlanItem("a-1", "a", "2"), PlanItem("b-3", "b", "3")))),
            "plan 'p': item 'a-1' is '2' by 'a', but it was begun as '1' by 'a'; give it a new id",
        ),
        (
            always(line("b-3", "a-9")),
            "task '9': unknown; the tasks are 1, 2, 3, 4",
        ),
        (
            always(Plan("p", (PlanItem("b-3", "b", "3"), PlanItem("x", "dog", "2")))),
            "plan 'p': 'dog' cannot do '2', only a, b can; move it",
        ),
        (
            always(line("b-3", "a-2<a-4", "a-4")),
            "plan 'line': items[1] 'a-2' waits for 'a-4', which does not come before it; reorder or rename it",
        ),
    ],
)
def test_a_plan_that_cannot_be_followed_is_told_and_the_old_one_goes_on(replan: Replan, message: str) -> None:
    plan = line("a-1", "a-2", "b-3", "b-4")
    played = play(plan, [took_by("b", "3", 5.0), *for_everybody(plan, "a-1")], ON_FAILURE, shared(plan), replan=replan)
    assert [note.reason for note in played.notes()] == [
        f"asked for another plan (a-1 (1) failed: grasp lost), going on as before: {message}"
    ]
    assert played.dispatched_s() == {"a-1": 0.0, "b-3": 0.0, "a-2": 1.0, "b-4": 5.0}
    assert not changes(played)


def test_a_plan_that_goes_in_a_circle_in_this_mode_is_not_followed() -> None:
    plan = line("a-1", "b-2", "b-3")
    circle = Plan("circle", (PlanItem("b-3", "b", "3"), PlanItem("b-2", "b", "2"), PlanItem("a'", "a", "1", ("b-2",))))
    steps = for_everybody(plan, "a-1")
    steps.insert(0, ScriptStep(agent="a", task="1", misbehaviour="raises"))
    played = play(plan, steps, replace(ON_FAILURE, mode="synchronous"), shared(plan), replan=always(circle))
    (note,) = played.notes()
    assert "in mode synchronous the items" in note.reason
    assert played.dispatcher.outcomes == {"a-1": "failed", "b-2": "succeeded", "b-3": "succeeded"}


def test_work_that_always_fails_does_not_come_back_for_ever() -> None:
    plan = line("a-1")
    steps = [replace(FAILS, agent="a", task="1")]
    played = play(plan, steps, replace(ON_FAILURE, max_replans=3), replan=again)
    assert len(changes(played)) == 3
    assert len(played.ends()) == 4
    assert played.notes()[-1].reason.endswith("the plan was changed 3 times; max_replans allows no more, raise it")
    assert played.dispatcher.verdict() == (Outcome.FAILED, "1 of 1 items did not succeed")


def test_a_resource_is_kept_through_a_change_of_the_plan() -> None:
    plan = line("a-1", "b-2", "c-3")
    problem = problem_of(plan, resources={"2": ("jig",), "3": ("jig",)})
    played = play(plan, [took_by("b", "2", 4.0), *for_everybody(plan, "a-1")], ON_FAILURE, problem, replan=again)
    assert len(changes(played)) == 1
    assert played.dispatched_s() == {"a-1": 0.0, "b-2": 0.0, "a-1'": 1.0, "c-3": 4.0}


def test_an_aborted_run_asks_for_nothing_more() -> None:
    plan = line("a-1", "b-1")
    deaf = ScriptStep(agent="", task="", misbehaviour=Misbehaviour.NEVER_ANSWERS)
    policy = replace(ON_FAILURE, on_failure="abort", timeout_s=3.0, grace_s=1.0)
    asked: list[str] = []
    steps = steps_of(plan, {"a-1": FAILS, "b-1": deaf})
    play(plan, steps, policy, replan=lambda _, reason: asked.append(reason))
    assert asked == ["a-1 (1) failed: grasp lost"]


def test_a_live_run_follows_another_plan_too(tmp_path: Path) -> None:
    plan = line("a-1", "a-2<a-1")
    loop = RealTimeLoop()
    short = replace(FAILS, duration_s=0.01)
    steps = [replace(short, agent="a", task="1"), *(took_by("a", name, 0.01) for name in "12")]
    executor = ScriptedExecutor(steps, loop)
    outcome = run_live(
        tmp_path / "run.mcap",
        RunSetup(plan=plan, problem=problem_of(plan), policy=ON_FAILURE, replan=again),
        {"a": executor},
        loop,
    )
    assert outcome == ("succeeded", "")
    events = [from_row(row) for row in read_events(tmp_path / "run.mcap").iter_rows(named=True)]
    state = run_state(events)
    assert state.outcomes == {"a-1": "failed", "a-1'": "succeeded", "a-2": "succeeded"}
    assert state.plan.name == "again"


def test_simulated_runs_with_replanning_are_the_same_every_time_and_sound() -> None:
    scenario = load_scenario("failures")
    policy = replace(policy_of(scenario), max_attempts=1, replan_on=("failure", "delay"), delay_s=3.0)
    runs = [carry_out(scenario, plan_of(scenario, 1, index), 1, index, policy, replan=again) for index in (0, 1, 0)]
    assert runs[0] == runs[2]
    n_changes = 0
    for run in runs:
        assert rebuild(frame(run.events))[1] == []
        assert run.truth.outcome == ""
        n_changes += sum(isinstance(event, PlanChanged) for event in run.events)
    assert n_changes > 0


def frame(events: tuple[Event, ...]) -> pl.DataFrame:
    """Return events as a frame, as they would be read from a log."""
    rows = [{"log_time_ns": event.time_ns, **to_row(event)} for event in events]
    return frame_of_rows(rows).with_columns(path=pl.lit("run.mcap"))


@st.composite
def next_plans(draw: st.DrawFn, state: RunState, problem: Problem, n_asked: int) -> Plan | None:
    """Draw what a planner may answer: nothing, nonsense, an error, or a plan that moves, drops and brings back."""
    kind = draw(st.sampled_from(("none", "error", "nonsense", *("plan",) * 6)))
    if kind == "none":
        return None
    if kind == "error":
        raise ScenarioError("no plan")
    if kind == "nonsense":
        return Plan("nonsense", tuple(reversed(state.plan.items)))
    running = {run.item_id for run in state.running.values()}
    over = [i for i in state.plan.items if i.item_id in state.outcomes and draw(st.integers(0, 3))]
    waiting = [i for i in state.left() if i.item_id not in running and draw(st.integers(0, 4))]
    failed = [i for i in state.plan.items if state.outcomes.get(i.item_id, "succeeded") != "succeeded"]
    new = [
        replace(i, item_id=f"{i.item_id}/{n_asked}", agent=draw(st.sampled_from(problem.task(i.task).agents)), meet="")
        for i in failed
        if draw(st.booleans())
    ]
    moved = [replace(i, agent=draw(st.sampled_from(problem.task(i.task).agents)), meet="") for i in waiting]
    rest = draw(st.permutations([*new, *moved]))
    items: list[PlanItem] = []
    for item in (*over, *(i for i in state.left() if i.item_id in running), *rest):
        known = {other.item_id for other in items}
        items.append(replace(item, after=tuple(other for other in item.after if other in known), meet=""))
    arrivals = tuple(arrival for arrival in state.plan.arrivals if draw(st.booleans()))
    return Plan(f"plan {n_asked}", tuple(items), arrivals)


@pytest.mark.slow
@settings(max_examples=120, deadline=None)
@given(st.data(), plans(), policies, st.sampled_from((("failure",), ("delay",), ("failure", "delay"))))
def test_whatever_is_planned_anew_every_run_ends_and_no_item_is_done_twice(
    data: st.DataObject, plan: Plan, policy: DispatchPolicy, replan_on: tuple[str, ...]
) -> None:
    plan = timed(plan, 2.0)
    problem = shared(plan)
    policy = replace(policy, replan_on=replan_on, delay_s=data.draw(st.sampled_from((0.0, 1.0))), max_replans=5)
    queue, events = EventQueue(START_NS), list[Event]()
    started = RunStarted(time_ns=START_NS, run_id="run", plan=plan.to_json())
    states: list[tuple[RunState, RunState]] = []

    def replan(state: RunState, _: str) -> Plan | None:
        states.append((state, run_state([started, *events], queue.now_ns)))
        return data.draw(next_plans(state, problem, len(states)))

    steps = [replace(step, agent=agent) for step in data.draw(scripts(plan)) for agent in plan.agents()]
    played = play(plan, steps, policy, problem, queue=queue, replan=replan, events=events)
    for told, logged in states:
        assert told == logged
    check_log(plan, played, policy)
    check_state(started, played.events[: data.draw(st.integers(0, len(played.events)))])
    state = run_state([started, *played.events])
    assert played.dispatcher.done
    assert state.outcomes == played.dispatcher.outcomes
    assert state.running == {}
    if policy.on_failure == OnFailure.SKIP:
        assert {item.item_id for item in state.plan.items} <= set(state.outcomes)
    assert rebuild(frame((started, *played.events)))[1] == []


def check_state(started: RunStarted, events: tuple[Event, ...]) -> None:
    """Assert that the state after some events is what each item's last event says."""
    last = {event.item_id: event for event in events if isinstance(event, TaskFact)}
    state = run_state([started, *events])
    assert state.outcomes == {name: event.outcome for name, event in last.items() if isinstance(event, TaskEnded)}
    under_way = {event.agent: event for event in last.values() if not isinstance(event, TaskEnded)}
    assert {agent: (run.item_id, run.attempt) for agent, run in state.running.items()} == {
        agent: (event.item_id, event.attempt) for agent, event in under_way.items()
    }
    assert all(
        (state.running[agent].since_s is None) == isinstance(event, TaskDispatched)
        for agent, event in under_way.items()
    )


def check_log(plan: Plan, played: Played, policy: DispatchPolicy) -> None:
    """Assert that items are handed out by the plan in force, attempt by attempt, and never after they are over."""
    items = {item.item_id: item for item in plan.items}
    over: dict[str, str] = {}
    attempts: dict[str, int] = defaultdict(int)
    for event in played.events:
        if isinstance(event, PlanChanged):
            items = {item.item_id: item for item in plan_of_value(event.plan, "log").items}
        elif isinstance(event, TaskDispatched):
            item = items[event.item_id]
            assert (event.agent, event.task) == (item.agent, item.task)
            assert all(over.get(other) == Outcome.SUCCEEDED for other in item.after)
            attempts[event.item_id] += 1
            assert event.attempt == attempts[event.item_id] <= policy.max_attempts
            assert over.pop(event.item_id, "failed") in LOST
        elif isinstance(event, TaskEnded):
            assert event.item_id not in over
            assert event.item_id in items
            over[event.item_id] = event.outcome


@pytest.mark.parametrize("mode", DispatchMode)
def test_in_every_mode_failed_work_comes_back_until_all_is_done(mode: DispatchMode) -> None:
    plan = timed(line("a-1", "b-2", "a-3<b-2", "b-4<a-1", "c-5"), 1.0)
    steps = [replace(FAILS, agent=i.agent, task=i.task) for i in plan.items]
    policy = replace(ON_FAILURE, mode=mode)
    played = play(plan, [s for f in steps for s in (f, replace(f, outcome="succeeded"))], policy, replan=again)
    assert played.dispatcher.verdict() == (Outcome.SUCCEEDED, "")
    assert len(played.ends()) == 2 * len(plan.items)
