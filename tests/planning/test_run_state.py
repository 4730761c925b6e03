"""How a run stands, told by its events alone."""

from __future__ import annotations

import pytest
from dispatching import START_NS, line, play, steps_of

from hrclog.errors import ScenarioError
from hrclog.event_rows import from_row, to_row
from hrclog.events import Event, PlanChanged, RunStarted, TaskEnded, TaskStarted
from hrclog.planning.plan import Arrival, Plan, PlanItem
from hrclog.planning.run_state import Running, RunState, run_state
from hrclog.recorders.dispatch.policy import DispatchPolicy
from hrclog.recorders.executors.scripted import ScriptStep

PLAN = line("a-1", "a-2", "b-1", arrivals=(Arrival("part", 2.5),))


def logged(plan: Plan = PLAN) -> list[Event]:
    """Return the events of a run: a-1 is tried twice, b-1 starts after half a second."""
    failing = ScriptStep(agent="", task="", duration_s=2.0, outcome="failed")
    slow = ScriptStep(agent="", task="", delay_s=0.5, duration_s=5.0)
    steps = steps_of(plan, {"a-1": failing, "b-1": slow})
    again = ScriptStep(agent="a", task="1", duration_s=1.0)
    played = play(plan, [steps[0], again, *steps[1:]], DispatchPolicy(max_attempts=2))
    return [RunStarted(time_ns=START_NS, run_id="run", plan=plan.to_json()), *played.events]


def until(second: float) -> RunState:
    """Return the state after all that happened up to a second."""
    now_ns = START_NS + round(second * 1e9)
    return run_state([event for event in logged() if event.time_ns <= now_ns], now_ns)


def test_what_is_only_dispatched_has_no_time_since_its_start() -> None:
    assert until(0.25) == RunState(0.25, PLAN, {}, {"a": Running("a-1", 0.25), "b": Running("b-1")})


def test_an_item_that_is_tried_again_is_not_over() -> None:
    state = until(2.25)
    assert state.outcomes == {}
    assert state.running == {"a": Running("a-1", 0.25, 2), "b": Running("b-1", 1.75)}


def test_what_is_over_is_known_by_its_last_outcome_and_facts_by_their_arrival() -> None:
    state = until(3.0)
    assert state.outcomes == {"a-1": "succeeded"}
    assert state.facts == {"part"}
    assert [item.item_id for item in state.left()] == ["a-2", "b-1"]
    done = run_state(logged())
    assert (done.now_s, done.running, set(done.outcomes.values())) == (5.5, {}, {"succeeded"})


def test_the_plan_is_the_last_one_that_was_said_and_former_outcomes_stay_known() -> None:
    other = Plan("other", (PlanItem("b-7", "b", "1"),))
    changed = PlanChanged(time_ns=START_NS + 6 * 10**9, run_id="run", plan=other.to_json(), reason="late")
    state = run_state([*logged(), changed])
    assert (state.now_s, state.plan, set(state.outcomes)) == (6.0, other, {"a-1", "a-2", "b-1"})
    assert [item.item_id for item in state.left()] == ["b-7"]


def test_events_read_from_a_log_give_the_same_state() -> None:
    assert run_state(from_row(to_row(event)) for event in logged()) == run_state(logged())


def test_steps_within_an_item_and_work_without_one_do_not_count() -> None:
    events = logged()[:4]
    step = TaskStarted(
        time_ns=START_NS, agent="a", task="grip", execution_id="s", item_id="a-1", parent_execution_id="id0"
    )
    loose = TaskStarted(time_ns=START_NS, agent="c", task="sweep", execution_id="t")
    assert run_state([*events, step, loose]) == run_state(events)


def test_an_item_that_is_skipped_does_not_free_an_agent_of_another() -> None:
    events = [event for event in logged() if event.time_ns == START_NS]
    skip = TaskEnded(time_ns=START_NS, agent="a", task="2", execution_id="s", item_id="a-2", outcome="skipped")
    assert run_state([*events, skip]).running["a"].item_id == "a-1"


@pytest.mark.parametrize(
    ("events", "message"),
    [
        ([], "the run has no plan: found no run_started with one"),
        ([RunStarted(time_ns=0)], "the run has no plan"),
        ([RunStarted(time_ns=0, plan=[1])], r"plan of run_started: found '\[1\]', expected a JSON object"),
        (
            [RunStarted(time_ns=0, plan=PLAN.to_json()), PlanChanged(time_ns=0, plan={"items": 1})],
            "plan of plan_changed: items: found '1', expected a list",
        ),
    ],
)
def test_a_run_without_a_plan_that_can_be_read_is_refused(events: list[Event], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        run_state(events)
