"""A plan carried out in real time, recorded as it happens."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from hrclog.events import Event
from hrclog.recorders.clock import Action
from hrclog.recorders.dispatch.dispatcher import Dispatcher
from hrclog.recorders.dispatch.real_time import RealTimeLoop
from hrclog.recorders.dispatch.run_setup import RunSetup
from hrclog.recorders.executors.protocol import Emit, Executor
from hrclog.recorders.recorder import Recorder


def run_live(
    path: str | Path,
    setup: RunSetup,
    executors: Mapping[str, Executor],
    loop: RealTimeLoop,
    *,
    run: str = "",
    on_event: Emit = lambda _: None,
    on_start: Action = lambda: None,
    on_ready: Callable[[Dispatcher], None] = lambda _: None,
) -> tuple[str, str]:
    """Carry a plan out, record everything, and return the outcome of the run and why.

    An interrupt (Ctrl-C, SIGTERM) cancels what runs and ends the run as canceled.

    Args:
        path: the log to be, `NAME.mcap`.
        setup: what the run is made of; it is checked before anything is written. Another plan is asked for in the
            loop's thread: nothing is handed out meanwhile.
        executors: by agent.
        loop: the clock that the executors were made with.
        run: name of the run; default the file's.
        on_event: told of every event once it is safe.
        on_start: called when the run has begun, before the first command.
        on_ready: given the dispatcher before it begins, to tell it of facts (`arrive`) and to `abort` it.

    Raises:
        ScenarioError: the plan does not solve the problem, or cannot be carried out in this mode.
        LogExistsError: a log or journal is there already.
        LogWriteError: the log cannot be written.
    """
    setup.check()
    with Recorder(path, run, clock_ns=lambda: loop.now_ns, **setup.facts()) as recorder:

        def write(event: Event) -> None:
            on_event(recorder.record(event))

        dispatcher = Dispatcher(setup, executors, loop, run_id=recorder.run_id, emit=write)
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
    previous_handlers = {number: signal.signal(number, lambda *_: action()) for number in numbers}
    try:
        yield
    finally:
        for number, handler in previous_handlers.items():
            signal.signal(number, handler)
