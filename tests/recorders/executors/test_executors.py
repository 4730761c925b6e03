"""Executors by file and by function: scripts, replays, callables."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from dispatching import START_NS, Played, line, play, problem_of, steps_of
from hypothesis import given, settings
from hypothesis import strategies as st

from hrclog.errors import DispatchError, ScenarioError
from hrclog.events import Event, Outcome, TaskDispatched, TaskEnded, TaskFact, TaskPaused, TaskResumed, TaskStarted
from hrclog.log.writing.writer import write_log
from hrclog.planning.plan import Plan
from hrclog.recorders.dispatch.dispatcher import Dispatcher
from hrclog.recorders.dispatch.policy import DispatchPolicy
from hrclog.recorders.dispatch.real_time import RealTimeLoop
from hrclog.recorders.dispatch.run_setup import RunSetup
from hrclog.recorders.executors.callables import CallableExecutor, Function
from hrclog.recorders.executors.protocol import Command, Executor
from hrclog.recorders.executors.replay import ReplayExecutor, read_recorded
from hrclog.recorders.executors.scripted import Misbehaviour, ScriptedExecutor, ScriptStep, read_script
from hrclog.sim.event_queue import EventQueue
from hrclog.sim.run import plan_of, simulate_run
from hrclog.sim.scenario import load_scenario


def test_all_of_them_are_executors() -> None:
    queue = EventQueue(0)
    made: list[Executor] = [
        ScriptedExecutor([ScriptStep(agent="a", task="t")], queue),
        ReplayExecutor(play(line("a-1")).events, queue),
        CallableExecutor({}, ["a"], queue),
    ]
    assert all(isinstance(executor, Executor) and executor.agents == ("a",) for executor in made)


def replayed(plan: Plan, events: tuple[Event, ...], policy: DispatchPolicy | None = None) -> Played:
    """Play a plan with the executions of a log."""
    queue = EventQueue(START_NS)
    executor = ReplayExecutor(events, queue)
    return play(plan, [], policy, executors=dict.fromkeys(executor.agents, executor), queue=queue)


def facts_of(played: Played) -> list[tuple[object, ...]]:
    """Return all that a run says of its executions but their ids."""
    return [(e.time_ns, e.kind, e.item_id, e.attempt) for e in played.events if isinstance(e, TaskFact)]


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.floats(0.0, 9.0), st.floats(0.0, 9.0), st.sampled_from(Outcome)), min_size=3, max_size=3))
def test_a_replay_of_a_run_is_the_run(chances: list[tuple[float, float, Outcome]]) -> None:
    plan, policy = line("a-1", "b-1<a-1", "a-2"), DispatchPolicy(max_attempts=2)
    steps = [
        ScriptStep(agent=item.agent, task=item.task, delay_s=delay, duration_s=duration, outcome=outcome)
        for item, (delay, duration, outcome) in zip(plan.items, chances, strict=True)
    ]
    first = play(plan, steps, policy)
    again = replayed(plan, first.events, policy)
    assert facts_of(again) == facts_of(first)
    assert [(e.outcome, e.reason) for e in again.ends()] == [(e.outcome, e.reason) for e in first.ends()]


def test_a_replayed_simulation_has_its_pauses_paths_and_targets() -> None:
    scenario = load_scenario("machine-tending")
    runs = (simulate_run(scenario, 1, index) for index in range(20))
    run = next(run for run in runs if any(isinstance(event, TaskPaused) for event in run.events))
    queue = EventQueue(run.events[0].time_ns)
    executor = ReplayExecutor(run.events, queue)
    plan = plan_of(scenario, 1, int(run.truth.name[-4:]))
    policy = DispatchPolicy(mode="timed", max_attempts=scenario.failures.max_attempts)
    played = play(plan, [], policy, scenario.problem, dict.fromkeys(executor.agents, executor), queue)

    def told(events: tuple[Event, ...]) -> list[object]:
        kinds = (TaskStarted, TaskPaused, TaskResumed, TaskEnded)
        return [
            (e.time_ns, e.kind, e.item_id, getattr(e, "path_length", None), getattr(e, "target", ""))
            for e in events
            if isinstance(e, kinds)
        ]

    assert told(played.events) == told(run.events)


def test_a_replay_without_a_further_execution_fails() -> None:
    played = replayed(line("a-1", "a-1x"), play(line("a-1")).events)
    assert [(e.outcome, e.reason) for e in played.ends()] == [
        ("succeeded", ""),
        ("failed", "the log has no further execution of 'a', '1x'"),
    ]


def test_what_was_skipped_in_the_log_was_never_done() -> None:
    steps = [ScriptStep(agent="a", task="1", outcome="failed"), ScriptStep(agent="a", task="2")]
    first = play(line("a-1", "a-2<a-1"), steps)
    assert first.dispatcher.outcomes["a-2"] == "skipped"
    again = replayed(line("a-1", "a-2"), first.events)
    assert again.ends()[-1].reason == "the log has no further execution of 'a', '2'"


def test_an_execution_that_is_open_in_the_log_fails_at_the_logs_end() -> None:
    events = play(line("a-1", "b-1")).events
    cut = tuple(e for e in events if not (isinstance(e, TaskEnded) and e.agent == "a"))
    played = replayed(line("a-1", "b-1"), cut)
    (end,) = [e for e in played.ends() if e.agent == "a"]
    assert (end.time_ns, end.outcome, end.reason) == (START_NS + 10**9, "failed", "the log does not say how it ended")


def test_a_replay_begins_with_the_start_where_nobody_dispatched() -> None:
    events = tuple(e for e in play(line("a-1")).events if not isinstance(e, TaskDispatched))
    assert facts_of(replayed(line("a-1"), events)) == facts_of(play(line("a-1")))


def test_a_replay_can_be_cancelled() -> None:
    played = replayed(line("a-1"), play(line("a-1")).events, DispatchPolicy(timeout_s=0.25))
    assert played.story()[-1] == (0.25, "task_ended", "a-1", "timed_out")


def test_a_replay_of_the_wrong_log_is_refused(tmp_path: Path) -> None:
    events = play(line("a-1")).events
    with pytest.raises(DispatchError, match="the log has no execution of 'b', only of a; choose another log"):
        ReplayExecutor(events, EventQueue(0), ["b"])
    with pytest.raises(DispatchError, match="found 2 runs, expected one"):
        ReplayExecutor([*events, replace(events[0], run_id="other")], EventQueue(0))
    write_log(tmp_path / "x.mcap", simulate_run(load_scenario("paper"), 1, 0).events)
    assert len(read_recorded(tmp_path / "x.mcap")) > 90


def test_a_script_goes_step_by_step_and_stays_at_its_last() -> None:
    plan = line("a-1", "a-2", "a-3")
    plan = replace(plan, items=tuple(replace(item, task="t") for item in plan.items))
    steps = [ScriptStep(agent="a", task="t", duration_s=s, delay_s=0.5) for s in (1.0, 2.0)]
    assert play(plan, steps).dispatched_s() == {"a-1": 0.0, "a-2": 1.5, "a-3": 4.0}


def test_a_command_that_the_script_does_not_know_is_rejected() -> None:
    (end,) = play(line("a-1"), [ScriptStep(agent="a", task="2")]).ends()
    assert end.reason == "the script has no step of 'a', '1'"


def test_a_script_comes_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "script.json"
    path.write_text('{"steps": [{"agent": "a", "task": "t", "delay_s": 1, "outcome": "failed", "reason": "why"}]}')
    assert read_script(path) == [ScriptStep(agent="a", task="t", delay_s=1.0, outcome="failed", reason="why")]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{}", "'steps' is missing"),
        ('{"steps": []}', "found no steps, expected at least one"),
        ('{"steps": [], "schema_version": 9}', "at most 1"),
        ('{"steps": [{"agent": "a"}]}', r"steps\[0\]: 'task' is missing"),
        (
            '{"steps": [{"agent": "a", "task": "t", "outcome": "done"}]}',
            "outcome: found 'done', expected one of succeeded",
        ),
        (
            '{"steps": [{"agent": "a", "task": "t", "misbehaviour": "sulks"}]}',
            "found 'sulks', expected one of rejects, raises",
        ),
        ('{"steps": [{"agent": "a", "task": "t", "duration_s": -1}]}', "expected a number from 0"),
    ],
)
def test_a_bad_script_is_named_with_the_place(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "script.json"
    path.write_text(text)
    with pytest.raises(ScenarioError, match=message) as caught:
        read_script(path)
    assert str(path) in str(caught.value)


def call(
    functions: dict[str, Function],
    plan: Plan,
    policy: DispatchPolicy | None = None,
    stop: Callable[[Command], object] = lambda _: None,
) -> tuple[Dispatcher, list[Event]]:
    """Carry a plan out by functions, in real time."""
    loop, events = RealTimeLoop(), list[Event]()
    executor = CallableExecutor(functions, plan.agents(), loop, stop)
    executors = dict.fromkeys(plan.agents(), executor)
    policy = policy or DispatchPolicy()
    dispatcher = Dispatcher(
        RunSetup(plan=plan, problem=problem_of(plan), policy=policy), executors, loop, run_id="run", emit=events.append
    )
    dispatcher.run()
    return dispatcher, events


def test_a_function_that_returns_has_succeeded_and_one_that_raises_has_failed() -> None:
    def fail(command: Command) -> None:
        raise ValueError(command.item_id)

    dispatcher, events = call({"1": lambda _: time.sleep(0.02), "2": fail}, line("a-1", "a-2", "a-3"))
    assert dispatcher.outcomes == {"a-1": "succeeded", "a-2": "failed", "a-3": "failed"}
    ends = [e for e in events if isinstance(e, TaskEnded)]
    assert [e.reason for e in ends] == ["", "ValueError: a-2", "no function for task '3'"]
    starts = [e for e in events if isinstance(e, TaskStarted)]
    assert ends[0].time_ns - starts[0].time_ns >= 20_000_000


def test_functions_of_two_agents_run_side_by_side() -> None:
    barrier = threading.Barrier(2, timeout=5.0)
    dispatcher, _ = call({"1": lambda _: barrier.wait()}, line("a-1", "b-1"))
    assert dispatcher.verdict() == (Outcome.SUCCEEDED, "")


def test_a_function_that_can_be_stopped_answers_a_cancel() -> None:
    stopped = threading.Event()

    def work(_: Command) -> None:
        if stopped.wait(5.0):
            raise RuntimeError("stopped")

    dispatcher, events = call({"1": work}, line("a-1"), DispatchPolicy(timeout_s=0.05), lambda _: stopped.set())
    assert dispatcher.outcomes == {"a-1": "timed_out"}
    assert [e.reason for e in events if isinstance(e, TaskEnded)] == ["took longer than 0.05 s"]


def test_a_function_that_cannot_be_stopped_loses_its_agent() -> None:
    free = threading.Event()
    policy = DispatchPolicy(timeout_s=0.05, grace_s=0.05)
    dispatcher, _ = call({"1": lambda _: free.wait(5.0)}, line("a-1", "a-2"), policy)
    free.set()
    assert dispatcher.outcomes == {"a-1": "timed_out", "a-2": "skipped"}


def test_a_misbehaving_script_is_the_same_in_real_time() -> None:
    plan = line("a-1", "b-1")
    quick = [
        replace(s, duration_s=0.01)
        for s in steps_of(plan, {"a-1": ScriptStep(agent="", task="", misbehaviour=Misbehaviour.ENDS_TWICE)})
    ]
    loop, events = RealTimeLoop(), list[Event]()
    executor = ScriptedExecutor(quick, loop)
    executors = dict.fromkeys(executor.agents, executor)
    dispatcher = Dispatcher(
        RunSetup(plan=plan, problem=problem_of(plan)), executors, loop, run_id="run", emit=events.append
    )
    dispatcher.run()
    assert set(dispatcher.outcomes.values()) == {"succeeded"}
