"""Runs in real time: a loop that threads may call, a journal that survives, an interrupt that ends cleanly."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path

import pytest
from dispatching import line, problem_of, steps_of

from hrclog.errors import LogExistsError, ScenarioError
from hrclog.event_rows import from_row
from hrclog.events import Event, RunEnded, RunStarted, TaskEnded
from hrclog.log.reader import read_events
from hrclog.planning.plan import Plan, PlanItem
from hrclog.recorders.dispatch.live_run import run_live
from hrclog.recorders.dispatch.policy import DispatchPolicy
from hrclog.recorders.dispatch.real_time import RealTimeLoop
from hrclog.recorders.dispatch.run_setup import RunSetup
from hrclog.recorders.executors.scripted import Misbehaviour, ScriptedExecutor, ScriptStep


def test_many_threads_may_submit_and_schedule_while_the_loop_runs() -> None:
    loop, seen = RealTimeLoop(), list[int]()

    def ask(number: int) -> None:
        for count in range(50):
            loop.submit(lambda: seen.append(number))
            loop.schedule(loop.now_ns + 1000 * count, lambda: seen.append(number))

    threads = [threading.Thread(target=ask, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    loop.run(lambda: len(seen) == 400)
    for thread in threads:
        thread.join()
    assert sorted(seen) == sorted([0, 1, 2, 3] * 100)


def test_actions_run_in_the_thread_of_the_loop_and_not_before_their_time() -> None:
    loop, seen = RealTimeLoop(), list[tuple[int, int]]()
    due_ns = loop.now_ns + 30_000_000
    loop.schedule(due_ns, lambda: seen.append((threading.get_ident(), loop.now_ns)))
    loop.run(lambda: bool(seen))
    assert seen[0][0] == threading.get_ident()
    assert due_ns <= seen[0][1] < due_ns + 10**10  # a busy machine is no failure


def test_a_waiting_loop_wakes_at_once_when_a_thread_submits() -> None:
    loop, seen = RealTimeLoop(), list[float]()
    loop.schedule(loop.now_ns + 10**12, lambda: None)  # it never waits for this
    threading.Timer(0.05, lambda: loop.submit(lambda: seen.append(time.monotonic()))).start()
    begin = time.monotonic()
    loop.run(lambda: bool(seen))
    assert 0.04 < seen[0] - begin < 60.0


def test_an_action_that_fails_ends_the_loop_with_its_error() -> None:
    loop = RealTimeLoop()
    loop.submit(lambda: 1 // 0)
    with pytest.raises(ZeroDivisionError):
        loop.run(lambda: False)


def live(path: Path, plan: Plan, steps: list[ScriptStep], policy: DispatchPolicy | None = None) -> tuple[str, str]:
    """Carry a plan out by a script, in real time."""
    loop = RealTimeLoop()
    executor = ScriptedExecutor(steps, loop)
    return run_live(
        path,
        RunSetup(plan=plan, problem=problem_of(plan), policy=policy or DispatchPolicy()),
        dict.fromkeys(executor.agents, executor),
        loop,
    )


def quick(plan: Plan, **changes: ScriptStep) -> list[ScriptStep]:
    """Return steps of 10 ms."""
    short = ScriptStep(agent="", task="", duration_s=0.01)
    return steps_of(plan, {item.item_id: changes.get(item.item_id.replace("-", "_"), short) for item in plan.items})


def logged(path: Path) -> list[Event]:
    return [from_row(row) for row in read_events(path).iter_rows(named=True)]


def test_a_live_run_is_a_log_like_any_other(tmp_path: Path) -> None:
    plan = line("a-1", "b-1<a-1")
    outcome = live(tmp_path / "run.mcap", plan, quick(plan), DispatchPolicy(mode="synchronous"))
    assert outcome == ("succeeded", "")
    events = logged(tmp_path / "run.mcap")
    first, last = events[0], events[-1]
    assert isinstance(first, RunStarted)
    assert isinstance(last, RunEnded)
    assert (first.name, first.agents, first.dispatch_mode, first.plan) == (
        "run",
        ("a", "b"),
        "synchronous",
        plan.to_json(),
    )
    assert [event.kind for event in events[1:-1]] == ["task_dispatched", "task_started", "task_ended"] * 2
    assert last.outcome == "succeeded"


def test_a_silent_executor_does_not_hold_up_a_live_run(tmp_path: Path) -> None:
    plan = line("a-1", "a-2", "b-1")
    steps = quick(plan, a_1=ScriptStep(agent="", task="", misbehaviour=Misbehaviour.NEVER_ANSWERS))
    policy = DispatchPolicy(timeout_s=0.05, grace_s=0.05)
    reason = "2 of 3 items did not succeed; executor of 'a' does not answer"
    assert live(tmp_path / "run.mcap", plan, steps, policy) == ("failed", reason)
    ends = [event for event in logged(tmp_path / "run.mcap") if isinstance(event, TaskEnded)]
    assert {e.item_id: e.outcome for e in ends} == {"a-1": "timed_out", "a-2": "skipped", "b-1": "succeeded"}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_cancels_what_runs_and_closes_the_log(number: signal.Signals, tmp_path: Path) -> None:
    plan = line("a-1", "a-2")
    before = signal.getsignal(number)
    threading.Timer(0.1, lambda: os.kill(os.getpid(), number)).start()
    steps = quick(plan, a_1=ScriptStep(agent="", task="", duration_s=60.0))
    assert live(tmp_path / "run.mcap", plan, steps) == ("canceled", "interrupted")
    assert signal.getsignal(number) == before
    (end,) = [event for event in logged(tmp_path / "run.mcap") if isinstance(event, TaskEnded)]
    assert (end.item_id, end.outcome, end.reason) == ("a-1", "canceled", "interrupted")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.mcap"]


def test_facts_and_aborts_may_come_from_other_threads(tmp_path: Path) -> None:
    plan = Plan("p", (PlanItem("1", "a", "t", needs=("part",)), PlanItem("2", "a", "u")))
    loop = RealTimeLoop()
    steps = [ScriptStep(agent="a", task="t", duration_s=0.01), ScriptStep(agent="a", task="u", duration_s=60.0)]
    executor = ScriptedExecutor(steps, loop)
    outcome = run_live(
        tmp_path / "run.mcap",
        RunSetup(plan=plan, problem=problem_of(plan)),
        {"a": executor},
        loop,
        on_ready=lambda dispatcher: (
            threading.Timer(0.05, dispatcher.arrive, ["part"]).start(),
            threading.Timer(0.2, dispatcher.abort, ["enough"]).start(),
        )[0],
    )
    assert outcome == ("canceled", "enough")
    ends = [event for event in logged(tmp_path / "run.mcap") if isinstance(event, TaskEnded)]
    assert [(e.item_id, e.outcome) for e in ends] == [("1", "succeeded"), ("2", "canceled")]


def test_nothing_is_written_for_a_plan_that_cannot_be_carried_out(tmp_path: Path) -> None:
    plan = line("a-1", "b-1")
    loop = RealTimeLoop()
    circle = Plan("p", (PlanItem("1", "a", "1", ("2",)), PlanItem("2", "b", "1", ("1",))))
    with pytest.raises(ScenarioError, match="in a circle"):
        run_live(tmp_path / "run.mcap", RunSetup(plan=circle, problem=problem_of(plan)), {}, loop)
    with pytest.raises(ScenarioError, match="'1' is done 1 time, expected 2"):
        run_live(tmp_path / "run.mcap", RunSetup(plan=line("a-1"), problem=problem_of(plan)), {}, loop)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "run.mcap").write_text("mine")
    with pytest.raises(LogExistsError):
        run_live(tmp_path / "run.mcap", RunSetup(plan=plan, problem=problem_of(plan)), {}, loop)
