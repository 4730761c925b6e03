"""A plan carried out in real time, recorded as it happens."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from hrclog._version import __version__
from hrclog.events import Event
from hrclog.planning.dispatch_mode import DispatchMode, schedule_of
from hrclog.planning.plan import Plan, check_plan
from hrclog.planning.problem import Problem
from hrclog.planning.run_state import Replan
from hrclog.recorders.clock import Action
from hrclog.recorders.dispatch.dispatcher import Dispatcher
from hrclog.recorders.dispatch.policy import DispatchPolicy
from hrclog.recorders.dispatch.real_time import RealTimeLoop
from hrclog.recorders.executors.protocol import Emit, Executor
from hrclog.recorders.recorder import Recorder


def run_live(
    path: str | Path,
    plan: Plan,
    problem: Problem,
    executors: Mapping[str, Executor],
    loop: RealTimeLoop,
    policy: DispatchPolicy | None = None,
    *,
    run: str = "",
    seed: int | None = None,
    on_event: Emit = lambda _: None,
    on_start: Action = lambda: None,
    on_ready: Callable[[Dispatcher], None] = lambda _: None,
    replan: Replan | None = None,
) -> tuple[str, str]:
    """Carry a plan out, record everything, and return the outcome of the run and why.

    An interrupt (Ctrl-C, SIGTERM) cancels what runs and ends the run as canceled.

    Args:
        path: the log to be, `NAME.mcap`.
        plan: what to do.
        problem: the tasks there are; the plan is checked against it before anything is written.
        executors: by agent.
        loop: the clock that the executors were made with.
        policy: mode, retries, limits; default all defaults.
        run: name of the run; default the file's.
        seed: of whatever is random in the executors.
        on_event: told of every event once it is safe.
        on_start: called when the run has begun, before the first command.
        on_ready: given the dispatcher before it begins, to tell it of facts (`arrive`) and to `abort` it.
        replan: asked for another plan when the policy says so, in the loop's thread: nothing is handed out meanwhile.

    Raises:
        ScenarioError: the plan does not solve the problem, or cannot be carried out in this mode.
        LogExistsError: a log or journal is there already.
        LogWriteError: the log cannot be written.
    """
    policy = policy or DispatchPolicy()
    check_plan(problem, plan)
    schedule_of(plan, DispatchMode(policy.mode), problem)
    facts = {"plan": plan.to_json(), "task_properties": problem.to_json()["tasks"], "seed": seed}
    with Recorder(
        path,
        run,
        agents=problem.agents,
        dispatch_mode=str(policy.mode),
        software={"hrclog": __version__},
        clock_ns=lambda: loop.now_ns,
        **facts,
    ) as recorder:

        def write(event: Event) -> None:
            on_event(recorder.record(event))

        dispatcher = Dispatcher(
            plan, problem, executors, loop, policy, run_id=recorder.run_id, emit=write, replan=replan
        )
        on_start()
        on_ready(dispatcher)
        with _on_interrupt(partial(dispatcher.abort, "interrupted")):
            dispatcher.run()
        recorder.close(*dispatcher.verdict())
    return dispatcher.verdict()


@contextmanager
def _on_interrupt(action: Action) -> Iterator[None]:
    """Call an action on SIGINT and SIGTERM, where that is possible: in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, lambda *_: action()) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
