"""Executors that block in real time: the others go on, limits work, and the log says who hung."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from dispatching import line, problem_of, steps_of

from hrclog.event_rows import from_row
from hrclog.events import AnnotationAdded, Event, Outcome, RunEnded, TaskEnded, TaskPaused, TaskResumed, TaskStarted
from hrclog.events import event_on as on
from hrclog.log.reader import read_events
from hrclog.planning.plan import Plan, PlanItem
from hrclog.planning.problem import Task
from hrclog.recorders.dispatch.dispatcher import Dispatcher
from hrclog.recorders.dispatch.limits import LEAST_S, limits_of
from hrclog.recorders.dispatch.live_run import run_live
from hrclog.recorders.dispatch.policy import DispatchPolicy
from hrclog.recorders.dispatch.real_time import RealTimeLoop
from hrclog.recorders.dispatch.run_setup import RunSetup
from hrclog.recorders.executors.callables import CallableExecutor
from hrclog.recorders.executors.protocol import Command, Emit, Executor, is_prompt
from hrclog.recorders.executors.scripted import ScriptedExecutor, ScriptStep

SHORT = DispatchPolicy(timeout_s=0.3, grace_s=0.2)
PATIENT = DispatchPolicy(timeout_s=30.0)
HELD_S = 30.0

Act = Callable[[Command, Emit], None]


class Held:
    """An executor that does what a test wants in `start` and in `cancel`."""

    def __init__(self, start: Act, cancel: Callable[[], None] = lambda: None) -> None:
        self.agents = ("a",)
        self.canceled = threading.Event()
        self._start, self._cancel = start, cancel

    def connect(self, emit: Emit) -> None:
        """Say everything to `emit`."""
        self._emit = emit

    def start(self, command: Command) -> None:
        """Do what the test wants."""
        self._start(command, self._emit)

    def cancel(self, execution_id: str, reason: str) -> None:  # noqa: ARG002 - the protocol's form
        """Note that it was asked to, and do what the test wants."""
        self.canceled.set()
        self._cancel()


def held(free: threading.Event) -> None:
    free.wait(HELD_S)


@pytest.fixture
def free() -> Iterator[threading.Event]:
    """Yield what an executor waits for until the test is over."""
    event = threading.Event()
    yield event
    event.set()


def carried_out(plan: Plan, a: Executor, policy: DispatchPolicy, loop: RealTimeLoop) -> tuple[Dispatcher, list[Event]]:
    """Carry a plan out in real time; agent a as given, the others by scripts of 10 ms."""
    events: list[Event] = []
    quick = ScriptStep(agent="", task="", duration_s=0.01)
    others = ScriptedExecutor(steps_of(plan, {item.item_id: quick for item in plan.items}), loop)
    executors = {**dict.fromkeys(plan.agents(), others), "a": a}
    setup = RunSetup(plan=plan, problem=problem_of(plan), policy=policy)
    dispatcher = Dispatcher(setup, executors, loop, run_id="run", emit=events.append)
    dispatcher.run()
    return dispatcher, events


def ends(events: list[Event]) -> dict[str, TaskEnded]:
    return {event.item_id: event for event in events if isinstance(event, TaskEnded)}


def finish(command: Command, emit: Emit) -> None:
    now_ns = time.time_ns()
    emit(on(TaskStarted, command, time_ns=now_ns))
    emit(on(TaskEnded, command, time_ns=now_ns, outcome=Outcome.SUCCEEDED))


def test_a_start_that_blocks_stops_nobody_else_and_is_named(free: threading.Event, tmp_path: Path) -> None:
    plan, loop = line("a-1", "a-2", "b-1", "b-2", "b-3"), RealTimeLoop()
    quick = ScriptStep(agent="", task="", duration_s=0.01)
    b = ScriptedExecutor(steps_of(plan, {item.item_id: quick for item in plan.items}), loop)
    setup = RunSetup(plan=plan, problem=problem_of(plan), policy=SHORT)
    executor = Held(lambda *_: held(free))
    began = time.monotonic()
    verdict = run_live(tmp_path / "run.mcap", setup, {"a": executor, "b": b}, loop)
    assert time.monotonic() - began < HELD_S / 3
    hung = "executor of 'a' does not answer (its `start` has not returned)"
    assert verdict == (Outcome.FAILED, f"2 of 5 items did not succeed; {hung}")
    events = [from_row(row) for row in read_events(tmp_path / "run.mcap").iter_rows(named=True)]
    last = ends(events)
    assert last["a-1"].outcome == Outcome.TIMED_OUT
    assert last["a-1"].reason == (
        "did not start within 0.3 s; the executor did not answer the cancel within 0.2 s; its `start` has not returned"
    )
    assert (last["a-2"].outcome, last["a-2"].reason) == (Outcome.SKIPPED, hung)
    assert {last[item].outcome for item in ("b-1", "b-2", "b-3")} == {Outcome.SUCCEEDED}
    assert max(last[item].time_ns for item in ("b-1", "b-2", "b-3")) < last["a-1"].time_ns
    assert isinstance(events[-1], RunEnded)
    assert hung in events[-1].reason
    assert executor.canceled.is_set()


def test_a_start_that_hangs_without_a_word_is_given_up_without_any_limit_of_its_own(free: threading.Event) -> None:
    policy = DispatchPolicy(call_timeout_s=0.05, grace_s=0.05)
    dispatcher, events = carried_out(line("a-1"), Held(lambda *_: held(free)), policy, RealTimeLoop())
    assert dispatcher.outcomes == {"a-1": Outcome.TIMED_OUT}
    assert ends(events)["a-1"].reason.startswith("did not start within 0.05 s; ")


def test_a_cancel_can_free_a_start_that_blocks(free: threading.Event) -> None:
    def work(command: Command, emit: Emit) -> None:
        emit(on(TaskStarted, command, time_ns=time.time_ns()))
        free.wait(HELD_S)
        emit(on(TaskEnded, command, time_ns=time.time_ns(), outcome=Outcome.CANCELED))

    slow = DispatchPolicy(timeout_s=0.1, grace_s=HELD_S)
    dispatcher, events = carried_out(line("a-1"), Held(work, free.set), slow, RealTimeLoop())
    assert [(e.outcome, e.reason) for e in ends(events).values()] == [(Outcome.TIMED_OUT, "took longer than 0.1 s")]
    assert dispatcher.verdict() == (Outcome.FAILED, "1 of 1 items did not succeed")


def test_a_start_that_does_the_whole_work_before_it_returns_is_fine() -> None:
    def work(command: Command, emit: Emit) -> None:
        finish(command, emit)
        time.sleep(0.02)  # the next command waits for this

    dispatcher, _ = carried_out(line("a-1", "a-2", "b-1"), Held(work), PATIENT, RealTimeLoop())
    assert set(dispatcher.outcomes.values()) == {Outcome.SUCCEEDED}


def test_a_cancel_that_blocks_stops_nobody_else_and_is_named(free: threading.Event) -> None:
    def begin(command: Command, emit: Emit) -> None:
        emit(on(TaskStarted, command, time_ns=time.time_ns()))

    executor = Held(begin, lambda: held(free))
    began = time.monotonic()
    dispatcher, events = carried_out(line("a-1", "b-1", "b-2"), executor, SHORT, RealTimeLoop())
    assert time.monotonic() - began < HELD_S / 3
    assert ends(events)["a-1"].reason.endswith("; its `cancel` has not returned")
    assert dispatcher.verdict()[1].endswith("executor of 'a' does not answer (its `cancel` has not returned)")
    assert dispatcher.outcomes["b-2"] == Outcome.SUCCEEDED


def test_a_command_that_waits_behind_a_start_that_hangs_is_never_begun(free: threading.Event) -> None:
    begun: list[str] = []

    def work(command: Command, emit: Emit) -> None:
        begun.append(command.item_id)
        finish(command, emit)
        free.wait(HELD_S)

    dispatcher, events = carried_out(line("a-1", "a-2"), Held(work), SHORT, RealTimeLoop())
    assert dispatcher.outcomes == {"a-1": Outcome.SUCCEEDED, "a-2": Outcome.TIMED_OUT}
    assert ends(events)["a-2"].reason.endswith("its `start` before has not returned")
    free.set()
    deadline = time.monotonic() + 5.0
    while any(thread.name == "start a" for thread in threading.enumerate()) and time.monotonic() < deadline:
        time.sleep(0.005)
    assert begun == ["a-1"]


@pytest.mark.parametrize("error", [ValueError("no grip"), SystemExit(3)])
def test_a_start_that_raises_in_its_thread_fails_the_attempt(error: BaseException) -> None:
    def work(command: Command, emit: Emit) -> None:
        if command.attempt == 1:
            raise error
        finish(command, emit)

    policy = DispatchPolicy(max_attempts=2, timeout_s=HELD_S)
    dispatcher, events = carried_out(line("a-1"), Held(work), policy, RealTimeLoop())
    assert [(e.outcome, e.attempt) for e in events if isinstance(e, TaskEnded)] == [("failed", 1), ("succeeded", 2)]
    assert dispatcher.verdict() == (Outcome.SUCCEEDED, "")


def test_answers_said_twice_and_too_late_are_kept_as_annotations() -> None:
    """The end of the first item comes again while the second runs, and again after the run, when nobody listens."""
    commands: list[Command] = []
    emits: list[Emit] = []

    def work(command: Command, emit: Emit) -> None:
        commands.append(command)
        emits.append(emit)
        for earlier in commands[:-1]:
            emit(on(TaskEnded, earlier, time_ns=time.time_ns(), outcome=Outcome.SUCCEEDED))
        finish(command, emit)
        finish(command, emit)

    loop = RealTimeLoop()
    dispatcher, events = carried_out(line("a-1", "a-2"), Held(work), PATIENT, loop)
    assert dispatcher.outcomes == {"a-1": Outcome.SUCCEEDED, "a-2": Outcome.SUCCEEDED}
    assert sum(isinstance(event, AnnotationAdded) for event in events) >= 3
    n_events = len(events)
    finish(commands[0], emits[0])
    loop.run(iter([False, False, False, True]).__next__)
    assert len(events) == n_events


def test_an_executor_says_for_its_own_methods_only_that_they_never_block() -> None:
    class Slow(ScriptedExecutor):
        def start(self, command: Command) -> None:
            super().start(command)

    loop = RealTimeLoop()
    assert is_prompt(ScriptedExecutor([], loop))
    assert not is_prompt(Slow([], loop))
    assert not is_prompt(CallableExecutor({}, ["a"], loop))


def command_of(planned_s: float | None) -> Command:
    planned = (None, None) if planned_s is None else (10**9, 10**9 + round(planned_s * 1e9))
    return Command(
        run_id="r",
        command_id="c",
        execution_id="e",
        item_id="i",
        agent="a",
        task="t",
        planned_start_ns=planned[0],
        planned_end_ns=planned[1],
    )


@pytest.mark.parametrize(
    ("planned_s", "declared", "policy", "item_s", "expected"),
    [
        (4.0, {}, DispatchPolicy(), None, 40.0),
        (4.0, {"a": 9.0}, DispatchPolicy(), None, 40.0),
        (None, {"a": 9.0}, DispatchPolicy(), None, 90.0),
        (None, {"b": 9.0}, DispatchPolicy(), None, None),
        (0.01, {}, DispatchPolicy(), None, LEAST_S),
        (4.0, {}, DispatchPolicy(timeout_factor=3.0), None, 12.0),
        (4.0, {}, DispatchPolicy(timeout_factor=None), None, None),
        (4.0, {}, DispatchPolicy(timeout_s=5.0), None, 5.0),
        (4.0, {}, DispatchPolicy(timeout_s=5.0), 6.0, 6.0),
    ],
)
def test_a_limit_is_what_is_asked_for_else_a_multiple_of_what_is_expected(
    planned_s: float | None,
    declared: dict[str, float],
    policy: DispatchPolicy,
    item_s: float | None,
    expected: float | None,
) -> None:
    task = Task("t", ("a", "b"), expected_s=declared)
    limits = limits_of(command_of(planned_s), item_s, policy, task, real_time=True)
    assert (limits.start_s, limits.work_s) == (expected, expected)
    asked_s = policy.timeout_s if item_s is None else item_s
    simulated = limits_of(command_of(planned_s), item_s, policy, task, real_time=False)
    assert (simulated.start_s, simulated.work_s, simulated.call_s) == (asked_s, asked_s, None)


def test_pauses_do_not_count_in_a_limit_by_what_is_expected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hrclog.recorders.dispatch.limits.LEAST_S", 0.3)
    plan = Plan("p", (PlanItem("1", "a", "t", (), 0.0, 0.01), PlanItem("2", "a", "u", (), 0.01, 0.02)))

    def work(command: Command, emit: Emit) -> None:
        emit(on(TaskStarted, command, time_ns=time.time_ns()))
        if command.task == "t":
            emit(on(TaskPaused, command, time_ns=time.time_ns(), cause="safety"))
            time.sleep(0.7)
            emit(on(TaskResumed, command, time_ns=time.time_ns()))
            emit(on(TaskEnded, command, time_ns=time.time_ns(), outcome=Outcome.SUCCEEDED))

    dispatcher, events = carried_out(plan, Held(work), DispatchPolicy(grace_s=0.0), RealTimeLoop())
    assert dispatcher.outcomes == {"1": Outcome.SUCCEEDED, "2": Outcome.TIMED_OUT}
    assert ends(events)["2"].reason.startswith("took longer than 0.3 s")


LOOK = """
import sys
from hrclog.event_rows import from_row
from hrclog.log.reader import read_events
from hrclog.planning.run_state import run_state
state = run_state([from_row(row) for row in read_events(sys.argv[1]).iter_rows(named=True)])
print(dict(state.outcomes), sorted(state.running))
"""


def test_another_process_reads_the_progress_of_a_run_as_it_goes(tmp_path: Path) -> None:
    plan, loop = line("a-1", "a-2", "a-3"), RealTimeLoop()
    log, seen = tmp_path / "run.mcap", list[str]()

    def look(_: Command) -> None:
        command = [sys.executable, "-c", LOOK, f"{log}.partial"]
        seen.append(subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip())

    executor = CallableExecutor({"1": lambda _: None, "2": look, "3": lambda _: None}, ["a"], loop)
    setup = RunSetup(plan=plan, problem=problem_of(plan))
    assert run_live(log, setup, {"a": executor}, loop) == (Outcome.SUCCEEDED, "")
    assert seen == ["{'a-1': 'succeeded'} ['a']"]
