"""The laws of the discrete-event cell, on cells drawn at random and on the scenarios that come with hrclog."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.event_rows import from_row, to_row
from hrclog.events import (
    Event,
    Outcome,
    RunEnded,
    RunStarted,
    SafetyStateChanged,
    TaskDispatched,
    TaskEnded,
    TaskFact,
    TaskPaused,
    TaskResumed,
    TaskStarted,
)
from hrclog.planning.dispatch_mode import DispatchMode
from hrclog.planning.problem import Count, Precedence, PrecedenceKind, Problem, Task
from hrclog.recorders.executors.protocol import Executor
from hrclog.sim.discrete import DiscreteCell
from hrclog.sim.event_queue import EventQueue
from hrclog.sim.run import Run, simulate_run
from hrclog.sim.scenario import (
    ABORT,
    SEQUENTIAL,
    SKIP,
    Failures,
    Gap,
    Lognormal,
    Safety,
    Scenario,
    Synergy,
    Work,
    load_scenario,
    scenario_names,
)
from hrclog.state import PLANNED, ExecutionState, apply

Interval = tuple[str, str, int, int]
"""Agent, task, start and end of an execution."""


@st.composite
def scenarios(draw: st.DrawFn) -> Scenario:
    """Draw cells of 1-4 agents with synergies, stops, gaps, failures and both dispatch modes."""
    agents = tuple(f"a{n}" for n in range(draw(st.integers(1, 4))))
    tasks = tuple(Task(f"t{n}", agents) for n in range(draw(st.integers(1, 3))))
    counts = tuple(Count(task.name, draw(st.integers(1, 4))) for task in tasks)
    totals = [count.count for count in counts]
    rules = tuple(
        Precedence(f"t{n}", f"t{n + 1}", draw(st.sampled_from((PrecedenceKind.EACH, PrecedenceKind.ALL))))
        for n in range(len(tasks) - 1)
        if totals[n] >= totals[n + 1] and draw(st.booleans())
    )
    problem = Problem(agents, tasks, counts, rules)
    factor = st.floats(0.3, 5.0)
    times = st.builds(Lognormal, st.floats(0.01, 20.0), st.floats(0.0, 1.0))
    chance = st.sampled_from((0.0, 0.3))
    synergies = [
        # only the first agent may be stopped, so that nobody waits for ever
        Synergy(a, t, b, u, math.inf if a == "a0" and draw(st.integers(0, 5)) == 0 else draw(factor))
        for a, t in problem.agent_tasks()
        for b, u in problem.agent_tasks()
        if a != b and draw(st.booleans())
    ]
    return Scenario(
        name="drawn",
        problem=problem,
        works=tuple(Work(a, t, draw(times), draw(chance)) for a, t in problem.agent_tasks()),
        synergies=tuple(synergies),
        gaps=tuple(Gap(agent, draw(times)) for agent in agents if draw(st.booleans())),
        failures=Failures(draw(st.integers(1, 3)), draw(st.sampled_from((SKIP, ABORT)))),
        safety=Safety(agents[: draw(st.integers(1, len(agents)))], "zone"),
        dispatch_mode=draw(st.sampled_from((SEQUENTIAL, DispatchMode.TIMED))),
    )


any_run = pytest.mark.parametrize("name", scenario_names())


def executions(run: Run) -> dict[str, Interval]:
    """Return the interval of every execution that started."""
    starts = {event.execution_id: event for event in run.events if isinstance(event, TaskStarted)}
    ends = {event.execution_id: event for event in run.events if isinstance(event, TaskEnded)}
    return {key: (s.agent, s.task, s.time_ns, ends[key].time_ns) for key, s in starts.items()}


def work_done(scenario: Scenario, own: Interval, others: list[Interval]) -> float:
    """Return the integral of the product of 1/s over an execution, in seconds; the plain way."""
    factors = {(s.agent, s.task, s.other_agent, s.other_task): s.factor for s in scenario.synergies}
    agent, task, start, end = own
    cuts = sorted({start, end, *(cut for _, _, *span in others for cut in span if start < cut < end)})
    total = 0.0
    for left, right in pairwise(cuts):
        during = [other for other in others if other[0] != agent and other[2] <= left and right <= other[3]]
        total += (right - left) / 1e9 / math.prod(factors.get((agent, task, *o[:2]), 1.0) for o in during)
    return total


def check_work(scenario: Scenario, run: Run) -> None:
    """Assert that every execution did the work that the truth says."""
    intervals = executions(run)
    truth = {row.execution_id: row for row in run.truth.executions}
    assert set(truth) == set(intervals)
    for key, own in intervals.items():
        assert work_done(scenario, own, list(intervals.values())) == pytest.approx(truth[key].work_s, abs=1e-6)


def check_legal(run: Run) -> None:
    """Assert that the state machine allows every event, that all executions end, and that time and seq only grow."""
    states: dict[str, ExecutionState] = defaultdict(lambda: PLANNED)
    for event in run.events:
        if isinstance(event, TaskFact):
            states[event.execution_id], problem = apply(states[event.execution_id], event)
            assert problem is None
    assert all(state.end_ns is not None for state in states.values())
    assert [event.seq for event in run.events] == list(range(len(run.events)))
    assert all(before.time_ns <= after.time_ns for before, after in pairwise(run.events))
    assert isinstance(run.events[0], RunStarted)
    assert isinstance(run.events[-1], RunEnded)
    assert {event.run_id for event in run.events} == {run.truth.run_id}


def plan_items(run: Run) -> dict[str, dict[str, object]]:
    """Return the items of the run's plan by id."""
    started = run.events[0]
    assert isinstance(started, RunStarted)
    return {item["item_id"]: item for item in started.plan["items"]}


def check_plan_kept(scenario: Scenario, run: Run) -> None:
    """Assert domains, one task at a time, the order of each agent, and precedences; and that no item is forgotten."""
    items = plan_items(run)
    ended: dict[str, str] = {}
    active: dict[str, str] = {}
    order: dict[str, list[str]] = defaultdict(list)
    for event in run.events:
        if isinstance(event, TaskStarted):
            item = items[event.item_id]
            assert (event.agent, event.task) == (item["agent"], item["task"])
            assert event.agent in scenario.problem.task(event.task).agents
            assert event.agent not in active
            active[event.agent] = event.execution_id
            assert all(ended.get(other) == Outcome.SUCCEEDED for other in item.get("after", []))  # type: ignore[attr-defined]  # JSON
            order[event.agent] += [event.item_id] * (event.item_id not in order[event.agent])
        elif isinstance(event, TaskEnded):
            active.pop(event.agent, None)
            ended[event.item_id] = event.outcome
    last = run.events[-1]
    assert isinstance(last, RunEnded)
    if scenario.failures.on_failure == SKIP or last.outcome == Outcome.SUCCEEDED:
        assert set(ended) == set(items)
    assert (last.outcome == Outcome.SUCCEEDED) == (
        set(ended) == set(items) and set(ended.values()) == {Outcome.SUCCEEDED}
    )
    for agent, done in order.items():
        assert done == [item_id for item_id, item in items.items() if item["agent"] == agent and item_id in done]


def check_attempts(scenario: Scenario, run: Run) -> None:
    """Assert that attempts of an item count from 1, have ids of their own, and are repeated only after a failure."""
    attempts: dict[str, list[TaskEnded]] = defaultdict(list)
    for event in run.events:
        if isinstance(event, TaskEnded) and event.outcome != Outcome.SKIPPED:
            attempts[event.item_id].append(event)
    for ends in attempts.values():
        assert [end.attempt for end in ends] == list(range(1, len(ends) + 1))
        assert len(ends) <= scenario.failures.max_attempts
        assert len({end.execution_id for end in ends}) == len(ends)
        assert all(end.outcome == Outcome.FAILED for end in ends[:-1])


def check_safety(scenario: Scenario, run: Run) -> None:
    """Assert that the state logged is the rate at work, at every instant, and that pauses are full stops."""
    intervals = list(executions(run).values())
    factors = {(s.agent, s.task, s.other_agent, s.other_task): s.factor for s in scenario.synergies}
    for agent in scenario.safety.agents:
        changes = [e for e in run.events if isinstance(e, SafetyStateChanged) and e.agent == agent]
        assert changes[0].time_ns == run.events[0].time_ns
        scales = {change.time_ns: change.speed_scale for change in changes}
        scale: float | None = None
        for instant in sorted({cut for _, _, *span in intervals for cut in span} | set(scales)):
            scale = scales.get(instant, scale)
            now = [i for i in intervals if i[2] <= instant < i[3]]
            rate = math.prod(
                1 / factors.get((*own[:2], *o[:2]), 1.0) for own in now if own[0] == agent for o in now if o[0] != agent
            )
            assert scale == pytest.approx(min(rate, 1.0))
    pauses = [e for e in run.events if isinstance(e, TaskPaused | TaskResumed)]
    stops = [e for e in run.events if isinstance(e, SafetyStateChanged) and e.speed_scale == 0.0]
    assert {(e.agent, e.time_ns) for e in pauses if isinstance(e, TaskPaused)} == {(e.agent, e.time_ns) for e in stops}
    assert all(e.mode == "stopped" for e in stops)


def check_all(scenario: Scenario, run: Run) -> None:
    """Assert every law."""
    check_legal(run)
    check_work(scenario, run)
    check_plan_kept(scenario, run)
    check_attempts(scenario, run)
    check_safety(scenario, run)


@settings(max_examples=150)
@given(scenarios(), st.integers(0, 2**40), st.integers(0, 3))
def test_every_law_holds_in_any_cell(scenario: Scenario, seed: int, index: int) -> None:
    check_all(scenario, simulate_run(scenario, seed, index))


@pytest.mark.slow
@any_run
def test_every_law_holds_in_the_scenarios_that_come_along(name: str) -> None:
    scenario = load_scenario(name)
    for index in range(20):
        check_all(scenario, simulate_run(scenario, 7, index))


@any_run
def test_events_go_to_the_wire_and_back_unchanged(name: str) -> None:
    def wire(event: Event) -> Event:
        return from_row(to_row(event))

    run = simulate_run(load_scenario(name), 1, 0)
    assert tuple(map(wire, run.events)) == run.events


def test_the_cell_is_an_executor() -> None:
    cell = DiscreteCell(load_scenario("paper"), EventQueue(0), {})
    assert isinstance(cell, Executor)
    assert cell.agents == ("human", "robot")


def test_an_unknown_execution_is_cancelled_without_a_word() -> None:
    said: list[Event] = []
    cell = DiscreteCell(load_scenario("paper"), EventQueue(0), {})
    cell.connect(said.append)
    cell.cancel("nobody", "no reason")
    assert said == []


def test_planned_instants_and_gaps_are_on_the_recorders_clock() -> None:
    run = simulate_run(load_scenario("paper"), 1, 0)
    items = plan_items(run)
    start_ns = run.events[0].time_ns
    dispatched = {e.execution_id: e.time_ns for e in run.events if isinstance(e, TaskDispatched)}
    for event in run.events:
        if isinstance(event, TaskStarted):
            planned_s = items[event.item_id]["planned_start_s"]
            assert isinstance(planned_s, float)
            assert event.planned_start_ns == start_ns + round(planned_s * 1e9)
            assert 0.1e9 < event.time_ns - dispatched[event.execution_id] < 5e9


def test_timed_dispatch_never_starts_ahead_of_the_plan() -> None:
    scenario = load_scenario("machine-tending")
    dispatches = [
        e for index in range(10) for e in simulate_run(scenario, 1, index).events if isinstance(e, TaskDispatched)
    ]
    assert dispatches
    assert all(e.planned_start_ns is not None and e.time_ns >= e.planned_start_ns for e in dispatches)


def test_targets_are_taken_once_and_a_retry_keeps_its_own() -> None:
    scenario = load_scenario("failures")
    for index in range(20):
        ends = [e for e in simulate_run(scenario, 1, index).events if isinstance(e, TaskEnded) and e.target]
        chosen = {(e.item_id, e.target) for e in ends}
        assert len(chosen) == len({item for item, _ in chosen}) == len({target for _, target in chosen})
        assert all(e.target in scenario.problem.task(e.task).targets for e in ends)


@pytest.mark.slow
def test_failures_are_as_frequent_as_they_should_be_and_partial() -> None:
    scenario = load_scenario("failures")
    runs = [simulate_run(scenario, 1, index) for index in range(200)]
    rows = [row for run in runs for row in run.truth.executions if (row.agent, row.task) == ("robot", "pick_blue_box")]
    failed = [row for row in rows if row.outcome == Outcome.FAILED]
    assert len(failed) / len(rows) == pytest.approx(0.15, abs=0.05)
    mean_s = sum(row.work_s for row in failed) / len(failed)
    assert mean_s == pytest.approx(scenario.durations_s["robot", "pick_blue_box"] / 2, rel=0.2)
    assert {row.attempt for row in rows} >= {1, 2}


def test_a_task_that_fails_for_good_skips_what_needs_it_and_the_run_goes_on() -> None:
    base = load_scenario("failures")
    hopeless = tuple(
        Work(w.agent, w.task, w.time, 1.0 if w.task == "pick_orange_box" else 0.0, "grasp lost") for w in base.works
    )
    scenario = Scenario("hopeless", base.problem, hopeless, base.synergies, base.gaps, Failures(3, SKIP))
    run = simulate_run(scenario, 1, 0)
    check_all(scenario, run)
    ends = [e for e in run.events if isinstance(e, TaskEnded)]
    assert sum(e.task == "pick_orange_box" and e.outcome == Outcome.FAILED for e in ends) == 4 * 3
    skipped = [e for e in ends if e.outcome == Outcome.SKIPPED]
    assert {e.task for e in skipped} == {"place_orange_box"}
    assert len(skipped) == 4
    assert all(e.reason.endswith("(failed)") for e in skipped)
    last = run.events[-1]
    assert isinstance(last, RunEnded)
    assert (last.outcome, last.reason) == (Outcome.FAILED, "8 of 24 items did not succeed")


def test_an_abort_cancels_what_runs_and_ends_the_run() -> None:
    base = load_scenario("paper")
    hopeless = tuple(Work(w.agent, w.task, w.time, float(w.agent == "robot"), "grasp lost") for w in base.works)
    scenario = Scenario("abort", base.problem, hopeless, base.synergies, base.gaps, Failures(2, ABORT))
    run = simulate_run(scenario, 1, 0)
    check_all(scenario, run)
    ends = [e for e in run.events if isinstance(e, TaskEnded)]
    assert [e.outcome for e in ends if e.agent == "robot"] == [Outcome.FAILED] * 2
    assert ends[-1].outcome == Outcome.CANCELED
    assert ends[-1].time_ns == run.events[-1].time_ns
    last = run.events[-1]
    assert isinstance(last, RunEnded)
    assert last.outcome == Outcome.FAILED
    assert last.reason.endswith("failed 2 times")


def test_an_abort_cancels_what_was_dispatched_and_has_not_begun() -> None:
    base = load_scenario("paper")
    hopeless = tuple(Work(w.agent, w.task, w.time, float(w.agent == "robot"), "grasp lost") for w in base.works)
    slow = (Gap("human", Lognormal(1000.0, 0.0)),)
    scenario = Scenario("slow", base.problem, hopeless, base.synergies, slow, Failures(1, ABORT))
    run = simulate_run(scenario, 1, 0)
    check_all(scenario, run)
    human = [e for e in run.events if isinstance(e, TaskFact) and e.agent == "human"]
    assert [e.kind for e in human] == ["task_dispatched", "task_ended"]
    assert isinstance(human[1], TaskEnded)
    assert human[1].outcome == Outcome.CANCELED
    assert human[1].reason.endswith("failed 1 times")


def test_a_full_stop_is_logged_as_a_pause_and_takes_no_work() -> None:
    scenario = load_scenario("machine-tending")
    runs = [simulate_run(scenario, 1, index) for index in range(20)]
    assert sum(isinstance(event, TaskPaused) for run in runs for event in run.events) > 5


def test_what_is_cancelled_has_gone_the_part_of_its_path_that_it_has_worked() -> None:
    base = load_scenario("paper")
    fixed = tuple(
        replace(w, time=Lognormal(10.0, 0.0), path_length=3.0, failure_probability=float(w.agent == "robot"))
        if w.agent == "human"
        else replace(w, time=Lognormal(4.0, 0.0), failure_probability=1.0)
        for w in base.works
    )
    run = simulate_run(Scenario("abort", base.problem, fixed, (), (), Failures(1, ABORT)), 1, 0)
    [cancelled] = [e for e in run.events if isinstance(e, TaskEnded) and e.outcome == Outcome.CANCELED]
    [started] = [e for e in run.events if isinstance(e, TaskStarted) and e.execution_id == cancelled.execution_id]
    worked_s = (cancelled.time_ns - started.time_ns) / 1e9
    assert 0.0 < worked_s < 4.0
    assert cancelled.path_length == pytest.approx(3.0 * worked_s / 10.0)
