"""What ends up in the log when an executor breaks its promises, and how the run goes on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from dispatching import START_NS, Played, line, play, problem_of, steps_of

from hrclog.errors import IllegalEventError, InvalidEventError, LogWriteError
from hrclog.event_rows import check_row, to_row
from hrclog.events import (
    AnnotationAdded,
    ClockSynced,
    CommandRejected,
    Event,
    Heartbeat,
    Outcome,
    RunEnded,
    SafetyStateChanged,
    TaskDispatched,
    TaskEnded,
    TaskFact,
    TaskPaused,
    TaskStarted,
    event_on,
)
from hrclog.log.messages.message import encode_row
from hrclog.planning.plan import Arrival, Plan, PlanItem
from hrclog.recorders.dispatch.dispatcher import Dispatcher
from hrclog.recorders.dispatch.policy import DispatchPolicy, OnFailure
from hrclog.recorders.dispatch.run_setup import RunSetup
from hrclog.recorders.executors.protocol import Command, Emit, Executor
from hrclog.recorders.executors.scripted import Misbehaviour, ScriptStep
from hrclog.sim.event_queue import EventQueue

TRY_TWICE = DispatchPolicy(max_attempts=2)


def step(misbehaviour: str = "", **fields: object) -> ScriptStep:
    """Return a step for any item."""
    return ScriptStep(agent="", task="", misbehaviour=misbehaviour, **fields)  # type: ignore[arg-type] - fields of a step


class Talker:
    """An executor that answers a command with whatever a test wants it to say."""

    def __init__(self, answer: Callable[[Command, Emit], None], queue: EventQueue) -> None:
        self.agents = ("a",)
        self._answer = answer
        self._queue = queue
        self.canceled: list[str] = []

    def connect(self, emit: Emit) -> None:
        """Say everything to `emit`."""
        self._emit = emit

    def start(self, command: Command) -> None:
        """Answer a second later."""
        self._queue.schedule(self._queue.now_ns + 10**9, lambda: self._answer(command, self._emit))

    def cancel(self, execution_id: str, reason: str) -> None:  # noqa: ARG002 - the protocol's form
        """Note that it was asked to, and do nothing."""
        self.canceled.append(execution_id)


def talk(
    answer: Callable[[Command, Emit], None], policy: DispatchPolicy | None = None, plan: Plan | None = None
) -> Played:
    """Play a plan, by default of one item, whose agent 'a' is a talker; a second after a command it answers."""
    queue = EventQueue(START_NS)
    return play(plan or line("a-1"), [], policy, executors={"a": Talker(answer, queue)}, queue=queue)


def on(kind: type[TaskFact], command: Command, at_s: float = 1.0, **facts: object) -> TaskFact:
    """Return an event on a command."""
    return event_on(kind, command, time_ns=START_NS + round(at_s * 1e9), **facts)


def test_a_command_that_is_rejected_fails_and_is_not_tried_again() -> None:
    plan = line("a-1", "a-2<a-1", "a-3")
    played = play(plan, steps_of(plan, {"a-1": step(Misbehaviour.REJECTS, reason="gripper off")}), TRY_TWICE)
    assert played.story()[:5] == [
        (0.0, "task_dispatched", "a-1"),
        (0.0, "command_rejected"),
        (0.0, "task_ended", "a-1", "failed"),
        (0.0, "task_ended", "a-2", "skipped"),
        (0.0, "task_dispatched", "a-3"),
    ]
    rejected, ended = played.events[1:3]
    assert isinstance(rejected, CommandRejected)
    assert isinstance(ended, TaskEnded)
    assert rejected.reason == ended.reason == "gripper off"
    assert (rejected.execution_id, rejected.command_id) == (ended.execution_id, ended.command_id)
    assert played.dispatcher.verdict() == (Outcome.FAILED, "2 of 3 items did not succeed")


@pytest.mark.parametrize(
    ("plan", "known", "reason"),
    [
        (line("a-1", "a-fly"), line("a-1"), "task 'fly' is unknown, the tasks are 1"),
        (line("a-1", "b-1"), line("a-1"), "'b' cannot do '1', only a can"),
    ],
)
def test_what_the_task_properties_do_not_know_is_refused(plan: Plan, known: Plan, reason: str) -> None:
    played = play(plan, problem=problem_of(known))
    assert [e.reason for e in played.events if isinstance(e, CommandRejected)] == [reason]
    assert {(e.outcome, e.reason) for e in played.ends()} == {("failed", reason), ("succeeded", "")}


def test_an_agent_without_an_executor_is_refused_its_commands() -> None:
    plan, events = line("a-1", "a-2<a-1"), list[Event]()
    dispatcher = Dispatcher(
        RunSetup(plan=plan, problem=problem_of(plan), policy=TRY_TWICE),
        {},
        EventQueue(0),
        run_id="run",
        emit=events.append,
    )
    dispatcher.run()
    assert [e.kind for e in events] == ["task_dispatched", "command_rejected", "task_ended", "task_ended"]
    assert dispatcher.outcomes == {"a-1": "failed", "a-2": "skipped"}
    assert {e.reason for e in events if isinstance(e, CommandRejected)} == {"no executor acts for 'a', only for nobody"}


def test_an_executor_that_raises_fails_the_attempt_and_it_is_tried_again() -> None:
    plan = line("a-1")
    steps = [replace(step(Misbehaviour.RAISES), agent="a", task="1"), ScriptStep(agent="a", task="1")]
    played = play(plan, steps, TRY_TWICE)
    assert [(e.outcome, e.attempt, e.reason) for e in played.ends()] == [
        ("failed", 1, "executor: RuntimeError: the script says so"),
        ("succeeded", 2, ""),
    ]
    assert len({e.execution_id for e in played.ends()}) == 2


def test_a_slow_attempt_is_cancelled_timed_out_and_tried_again() -> None:
    plan = line("a-1", "a-2")
    steps = [ScriptStep(agent="a", task="1", duration_s=d) for d in (9.0, 2.0)] + steps_of(line("a-2"))
    played = play(plan, steps, replace(TRY_TWICE, timeout_s=3.0))
    assert played.story()[:6] == [
        (0.0, "task_dispatched", "a-1"),
        (0.0, "task_started", "a-1"),
        (3.0, "task_ended", "a-1", "timed_out"),
        (3.0, "task_dispatched", "a-1"),
        (3.0, "task_started", "a-1"),
        (5.0, "task_ended", "a-1", "succeeded"),
    ]
    assert played.ends()[0].reason == "took longer than 3 s"


def test_an_attempt_that_takes_just_its_limit_is_in_time() -> None:
    assert play(line("a-1"), policy=DispatchPolicy(timeout_s=1.0)).dispatcher.outcomes == {"a-1": "succeeded"}


def test_the_limit_of_an_item_wins() -> None:
    plan = Plan(
        "p", (PlanItem("1", "a", "t", timeout_s=9.0), PlanItem("2", "a", "t", timeout_s=2.0), PlanItem("3", "a", "t"))
    )
    steps = [ScriptStep(agent="a", task="t", duration_s=5.0)]
    outcomes = play(plan, steps, DispatchPolicy(timeout_s=3.0)).dispatcher.outcomes
    assert outcomes == {"1": "succeeded", "2": "timed_out", "3": "timed_out"}


@pytest.mark.parametrize(("start_timeout_s", "limit"), [(0.5, 0.5), (None, 3.0)])
def test_an_attempt_that_does_not_start_in_time_is_timed_out(start_timeout_s: float | None, limit: float) -> None:
    plan = line("a-1")
    policy = DispatchPolicy(timeout_s=3.0, start_timeout_s=start_timeout_s)
    played = play(plan, steps_of(plan, {"a-1": step(Misbehaviour.NEVER_STARTS)}), policy)
    assert played.story() == [(0.0, "task_dispatched", "a-1"), (limit, "task_ended", "a-1", "timed_out")]
    assert played.ends()[0].reason == f"did not start within {limit:g} s"


def test_an_executor_that_does_not_answer_a_cancel_gets_nothing_more_for_that_agent() -> None:
    plan = line("a-1", "b-1", "a-2", "b-2<a-2", "b-3")
    steps = steps_of(plan, {"a-1": step(Misbehaviour.NEVER_ANSWERS)})
    played = play(plan, steps, replace(TRY_TWICE, timeout_s=3.0, grace_s=0.5))
    assert [(e.item_id, e.outcome, e.time_ns - START_NS) for e in played.ends() if e.agent == "a"] == [
        ("a-1", "timed_out", 3_500_000_000),
        ("a-2", "skipped", 3_500_000_000),
    ]
    reasons = [e.reason for e in played.ends() if e.agent == "a"]
    silence = "took longer than 3 s; the executor did not answer the cancel within 0.5 s"
    assert reasons == [silence, "executor of 'a' does not answer"]
    assert played.dispatcher.outcomes["b-2"] == "skipped"
    assert played.dispatcher.outcomes["b-3"] == "succeeded"


def test_work_that_is_done_in_spite_of_a_cancel_is_done() -> None:
    def answer(command: Command, emit: Emit) -> None:
        emit(on(TaskStarted, command))
        emit(on(TaskEnded, command))

    played = talk(answer, DispatchPolicy(start_timeout_s=0.9))
    assert [(e.outcome, e.reason) for e in played.ends()] == [("succeeded", "")]


def test_an_abort_cancels_what_runs_and_leaves_the_rest_out() -> None:
    plan = line("a-1", "b-1", "a-2")
    steps = steps_of(plan, {"a-1": step(outcome="failed"), "b-1": step(duration_s=9.0)})
    played = play(plan, steps, DispatchPolicy(on_failure=OnFailure.ABORT))
    assert [(e.item_id, e.outcome, e.reason) for e in played.ends()] == [
        ("a-1", "failed", ""),
        ("b-1", "canceled", "a-1 (1) failed 1 times"),
    ]
    assert played.dispatcher.verdict() == (Outcome.FAILED, "a-1 (1) failed 1 times")


def test_an_attempt_that_an_abort_forestalls_leaves_its_item_failed() -> None:
    plan = line("a-1", "b-1")
    raising = {"b-1": step(Misbehaviour.RAISES), "a-1": step(Misbehaviour.REJECTS)}
    played = play(plan, steps_of(plan, raising), replace(TRY_TWICE, on_failure=OnFailure.ABORT))
    assert played.dispatcher.outcomes == {"a-1": "failed", "b-1": "failed"}
    assert [e.attempt for e in played.ends()] == [1, 1]


def test_an_abort_does_not_wait_for_ever_for_a_silent_executor() -> None:
    plan = line("a-1", "b-1")
    steps = steps_of(plan, {"a-1": step(outcome="failed"), "b-1": step(Misbehaviour.NEVER_ANSWERS)})
    played = play(plan, steps, DispatchPolicy(on_failure=OnFailure.ABORT, grace_s=2.0))
    last = played.ends()[-1]
    assert (last.item_id, last.outcome, last.time_ns) == ("b-1", "timed_out", START_NS + 3_000_000_000)


def test_an_execution_is_asked_to_end_only_once() -> None:
    queue, plan = EventQueue(START_NS), line("a-1", "b-1")
    silent = Talker(lambda *_: None, queue)
    steps = steps_of(line("b-1"), {"b-1": step(outcome="failed", duration_s=2.0)})
    policy = DispatchPolicy(on_failure=OnFailure.ABORT, start_timeout_s=1.0, grace_s=5.0)
    played = play(plan, steps, policy, executors={"a": silent}, queue=queue)
    assert len(silent.canceled) == 1
    (end,) = [end for end in played.ends() if end.agent == "a"]
    assert end.reason == "did not start within 1 s; the executor did not answer the cancel within 5 s"


def test_a_run_that_an_operator_ends_is_canceled() -> None:
    plan, queue, events = line("a-1", "a-2"), EventQueue(START_NS), list[Event]()
    dispatcher = Dispatcher(
        RunSetup(plan=plan, problem=problem_of(plan), policy=DispatchPolicy(grace_s=2.0)),
        {"a": Talker(lambda command, emit: emit(on(TaskStarted, command)), queue)},
        queue,
        run_id="run",
        emit=events.append,
    )
    queue.schedule(START_NS + 5 * 10**9, lambda: dispatcher.abort("the operator says so"))
    queue.schedule(START_NS + 6 * 10**9, lambda: dispatcher.abort("again"))
    dispatcher.run()
    assert dispatcher.verdict() == (Outcome.CANCELED, "the operator says so")


def test_a_fact_that_never_comes_ends_the_run() -> None:
    plan = Plan(
        "p",
        (PlanItem("1", "a", "t", needs=("part", "door")), PlanItem("2", "a", "t"), PlanItem("3", "b", "t", ("1",))),
        (Arrival("door", 2.0),),
    )
    played = play(plan)
    assert {e.item_id: (e.outcome, e.reason) for e in played.ends()} == {
        "1": ("skipped", "needs part, which never arrived"),
        "2": ("skipped", "the plan cannot go on: it waits for 1"),
        "3": ("skipped", "the plan cannot go on: it waits for 1"),
    }
    assert played.dispatcher.verdict() == (Outcome.FAILED, "3 of 3 items did not succeed")
    assert played.dispatcher.stuck == ()


def test_facts_are_waited_for_as_long_as_the_policy_says() -> None:
    plan = Plan("p", (PlanItem("1", "a", "t", needs=("part",)),))

    def ticking(wait_s: float | None) -> Played:
        queue = EventQueue(START_NS)

        def tick() -> None:  # a cell whose clock never runs dry
            if queue.now_ns < START_NS + 60 * 10**9:
                queue.schedule(queue.now_ns + 10**9, tick)

        tick()
        return play(plan, policy=DispatchPolicy(max_wait_s=wait_s), queue=queue)

    assert [ticking(s).ends()[0].time_ns - START_NS for s in (0.0, 4.0, None)] == [0, 4 * 10**9, 60 * 10**9]


def test_every_fact_that_comes_begins_the_waiting_anew() -> None:
    plan = Plan("p", (PlanItem("1", "a", "t", needs=("part", "door")),))
    queue, events = EventQueue(START_NS), list[Event]()
    policy = DispatchPolicy(max_wait_s=3.0)
    dispatcher = Dispatcher(
        RunSetup(plan=plan, problem=problem_of(plan), policy=policy), {}, queue, run_id="run", emit=events.append
    )
    queue.schedule(START_NS + 2 * 10**9, lambda: dispatcher.arrive("part"))
    queue.schedule(START_NS + 9 * 10**9, lambda: dispatcher.arrive("door"))
    dispatcher.run()
    (end,) = [event for event in events if isinstance(event, TaskEnded)]
    assert (end.time_ns, end.reason) == (START_NS + 5 * 10**9, "needs door, which never arrived")


def test_a_deaf_executor_is_deaf_before_its_start_too() -> None:
    plan = line("a-1", "a-2")
    steps = steps_of(plan, {"a-1": step(Misbehaviour.NEVER_ANSWERS, delay_s=5.0)})
    played = play(plan, steps, DispatchPolicy(start_timeout_s=1.0, grace_s=0.5))
    assert played.dispatcher.outcomes == {"a-1": "timed_out", "a-2": "skipped"}


def test_executions_that_cannot_go_on_are_cancelled_when_nothing_is_left_to_happen() -> None:
    plan = line("a-1", "a-2", "b-1")
    played = play(
        plan, steps_of(plan, {"a-1": step(Misbehaviour.NEVER_ANSWERS), "b-1": step(Misbehaviour.NEVER_STARTS)})
    )
    assert [item.item_id for item in played.dispatcher.stuck] == ["a-1", "a-2", "b-1"]
    assert played.dispatcher.outcomes == {"a-1": "timed_out", "a-2": "skipped", "b-1": "canceled"}


def test_an_end_that_is_said_twice_is_noted_and_changes_nothing() -> None:
    plan = line("a-1", "a-2")
    played = play(plan, steps_of(plan, {"a-1": step(Misbehaviour.ENDS_TWICE)}))
    assert [e.item_id for e in played.ends()] == ["a-1", "a-2"]
    (note,) = played.notes()
    assert note.reason == "executor of 'a' said task_ended, not taken: event_after_end (ended)"
    assert note.execution_id == ""
    said = note.details["not_taken"]
    assert (said["kind"], said["item_id"], said["outcome"]) == ("task_ended", "a-1", "succeeded")
    assert said["execution_id"] == played.ends()[0].execution_id


def test_an_end_without_a_start_fails_and_is_noted() -> None:
    plan = line("a-1")
    played = play(plan, steps_of(plan, {"a-1": step(Misbehaviour.ENDS_UNSTARTED)}))
    (note,) = played.notes()
    assert "end_without_start (dispatched)" in note.reason
    (end,) = played.ends()
    assert end.outcome == "failed"
    assert end.reason == "the executor said 'succeeded', which is not possible (end_without_start)"


def test_an_unknown_execution_is_noted_and_the_true_one_runs_into_its_limit() -> None:
    plan = line("a-1")
    played = play(plan, steps_of(plan, {"a-1": step(Misbehaviour.WRONG_EXECUTION)}), DispatchPolicy(timeout_s=3.0))
    (note,) = played.notes()
    assert note.reason == "executor of 'a' said task_ended, not taken: execution 'not-id1' is unknown"
    assert played.dispatcher.outcomes == {"a-1": "timed_out"}


def test_late_feedback_of_a_lost_executor_is_noted() -> None:
    queue, plan = EventQueue(START_NS), line("a-1", "b-1")
    late = Talker(lambda command, emit: emit(on(TaskStarted, command)), queue)
    policy = DispatchPolicy(start_timeout_s=0.2, grace_s=0.1)
    played = play(plan, steps_of(line("b-1")), policy, executors={"a": late}, queue=queue)
    (note,) = played.notes()
    assert note.time_ns == START_NS + 10**9
    assert note.reason == "executor of 'a' said task_started, not taken: duplicate_start (ended)"
    assert played.dispatcher.outcomes == {"a-1": "timed_out", "b-1": "succeeded"}
    assert len(late.canceled) == 1


def test_nobody_speaks_for_anothers_execution() -> None:
    queue, plan = EventQueue(START_NS), line("a-1", "b-1")
    commands: list[Command] = []

    def end_all(command: Command, emit: Emit) -> None:
        for one in (*commands, command):
            emit(on(TaskStarted, one))
            emit(on(TaskEnded, one))

    first: Executor = Talker(lambda command, _: commands.append(command), queue)
    second: Executor = Talker(end_all, queue)
    played = play(plan, [], DispatchPolicy(timeout_s=5.0), executors={"a": first, "b": second}, queue=queue)
    assert {note.reason.partition("not taken: ")[2] for note in played.notes()} == {
        "execution 'id1' is another executor's"
    }
    assert played.dispatcher.outcomes == {"a-1": "timed_out", "b-1": "succeeded"}


ODD: list[tuple[str, Callable[[Command], object]]] = [
    ("a text", lambda _: "done"),
    ("nothing", lambda _: None),
    ("a run's end", lambda _: RunEnded(time_ns=START_NS)),
    ("an unhashable id", lambda c: replace(on(TaskStarted, c), execution_id=[])),  # type: ignore[arg-type] - the point
    ("an instant that is none", lambda c: replace(on(TaskStarted, c), time_ns="now")),  # type: ignore[arg-type] - the point
    ("a pause before the start", lambda c: on(TaskPaused, c)),
    ("a dispatch", lambda c: on(TaskDispatched, c)),
    ("another task", lambda c: replace(on(TaskStarted, c), task="other")),
    ("an end of another task", lambda c: replace(on(TaskEnded, c, outcome="failed"), task="other")),
    ("text that is none", lambda c: replace(on(TaskPaused, c), reason="\udcff")),
    ("a rejection of nothing", lambda _: CommandRejected(time_ns=START_NS, execution_id="?")),
]


@pytest.mark.parametrize("say", [say for _, say in ODD], ids=[name for name, _ in ODD])
def test_whatever_else_an_executor_says_is_noted_and_the_item_goes_on(say: Callable[[Command], object]) -> None:
    def answer(command: Command, emit: Emit) -> None:
        emit(say(command))  # type: ignore[arg-type] - the wrong values are the point
        emit(on(TaskStarted, command))
        emit(on(TaskEnded, command, 2.0))

    played = talk(answer)
    assert [note.reason.partition(":")[0] for note in played.notes()] == [played.notes()[0].reason.partition(":")[0]]
    assert "not taken" in played.notes()[0].reason
    assert all(check_row(to_row(note)) is None and encode_row(to_row(note)) for note in played.notes())
    assert played.dispatcher.outcomes == {"a-1": "succeeded"}


def test_an_outcome_that_is_no_word_of_the_vocabulary_ends_the_item_as_failed() -> None:
    def answer(command: Command, emit: Emit) -> None:
        emit(on(TaskStarted, command))
        emit(on(TaskEnded, command, outcome="done"))

    played = talk(answer)
    assert [(e.outcome, e.reason) for e in played.ends()] == [
        ("failed", "the executor said 'done', which is not possible (invalid_outcome)")
    ]


def test_safety_states_heartbeats_clocks_and_remarks_pass() -> None:
    passing = [
        SafetyStateChanged(time_ns=START_NS, agent="a", mode="reduced", speed_scale=0.5),
        Heartbeat(time_ns=START_NS, agent="a"),
        ClockSynced(time_ns=START_NS, agent="a", agent_time_ns=5),
        AnnotationAdded(time_ns=START_NS, reason="hello"),
    ]

    def answer(command: Command, emit: Emit) -> None:
        for event in passing:
            emit(event)
        emit(on(TaskStarted, command))
        emit(on(TaskEnded, command))

    assert [e.kind for e in talk(answer).events[1:5]] == [e.kind for e in passing]


def test_an_executor_need_not_know_item_attempt_or_type() -> None:
    def answer(command: Command, emit: Emit) -> None:
        bare = {"time_ns": START_NS, "agent": "a", "task": "1", "execution_id": command.execution_id}
        emit(TaskStarted(**bare))  # type: ignore[arg-type] - fields of an event
        emit(TaskEnded(**bare, outcome="failed"))  # type: ignore[arg-type] - fields of an event

    facts = [e for e in talk(answer, TRY_TWICE).events if isinstance(e, TaskFact)]
    assert [(e.item_id, e.attempt, e.task_type) for e in facts] == [("a-1", n, "type of 1") for n in (1, 1, 1, 2, 2, 2)]


def test_an_instant_before_what_has_happened_is_moved_there() -> None:
    def answer(command: Command, emit: Emit) -> None:
        emit(on(TaskStarted, command, 3.0))
        emit(on(TaskEnded, command, 2.0))

    assert [e.time_ns - START_NS for e in talk(answer).events] == [0, 3 * 10**9, 3 * 10**9]


@pytest.mark.parametrize("error", [InvalidEventError("odd"), IllegalEventError("odd")])
def test_an_end_that_the_log_refuses_ends_the_item_as_failed(error: Exception) -> None:
    events: list[Event] = []

    def write(event: Event) -> None:
        if isinstance(event, TaskEnded) and event.path_length == -1.0:
            raise error
        events.append(event)

    def answer(command: Command, emit: Emit) -> None:
        emit(on(TaskStarted, command))
        emit(on(TaskEnded, command, path_length=-1.0))

    queue, plan = EventQueue(START_NS), line("a-1")
    executors = {"a": Talker(answer, queue)}
    dispatcher = Dispatcher(RunSetup(plan=plan, problem=problem_of(plan)), executors, queue, run_id="run", emit=write)
    dispatcher.run()
    assert dispatcher.outcomes == {"a-1": "failed"}
    assert [e.kind for e in events] == ["task_dispatched", "task_started", "annotation_added", "task_ended"]


def test_a_log_that_cannot_be_written_ends_everything() -> None:
    def write(event: Event) -> None:
        if isinstance(event, TaskStarted):
            raise LogWriteError("x.mcap", "disk full", "make room")

    def answer(command: Command, emit: Emit) -> None:
        emit(on(TaskStarted, command))

    queue, plan = EventQueue(START_NS), line("a-1")
    executors = {"a": Talker(answer, queue)}
    dispatcher = Dispatcher(RunSetup(plan=plan, problem=problem_of(plan)), executors, queue, run_id="run", emit=write)
    with pytest.raises(LogWriteError, match="disk full"):
        dispatcher.run()


class Clumsy(Talker):
    """An executor that fails in `cancel`."""

    def cancel(self, execution_id: str, reason: str) -> None:  # noqa: ARG002 - the protocol's form
        """Fail."""
        raise OSError(reason)


def test_an_executor_that_fails_to_cancel_counts_as_silent() -> None:
    queue, plan = EventQueue(START_NS), line("a-1", "a-2")
    clumsy = Clumsy(lambda command, emit: emit(on(TaskStarted, command)), queue)
    played = play(plan, [], DispatchPolicy(timeout_s=2.0, grace_s=1.0), executors={"a": clumsy}, queue=queue)
    assert [note.reason for note in played.notes()] == [
        "executor of 'a' could not cancel: OSError: took longer than 2 s"
    ]
    assert played.dispatcher.outcomes == {"a-1": "timed_out", "a-2": "skipped"}


def test_one_that_raises_after_it_has_ended_does_no_harm() -> None:
    class Eager(Talker):
        def start(self, command: Command) -> None:
            self._emit(on(TaskStarted, command))
            self._emit(on(TaskEnded, command))
            raise ValueError

    queue, plan = EventQueue(START_NS), line("a-1")
    played = play(plan, [], executors={"a": Eager(lambda *_: None, queue)}, queue=queue)
    assert [note.reason for note in played.notes()] == ["executor of 'a', after its end: executor: ValueError"]
    assert played.dispatcher.outcomes == {"a-1": "succeeded"}
