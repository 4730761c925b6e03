"""Call executors so that one that blocks holds up nobody else: in real time, outside the thread of the clock."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from queue import SimpleQueue
from typing import Final

from hrclog.errors import LogWriteError
from hrclog.recorders.clock import Clock
from hrclog.recorders.executors.protocol import Command, Executor, is_prompt

_LONGEST_PATIENCE_S: Final = 0.5

OnError = Callable[[BaseException], None]
"""Takes what a call raised, in the thread of the clock."""


class Call:
    """The calls of an executor for one execution, and which of them have returned."""

    def __init__(self) -> None:
        self.begun = False
        self.revoked = False
        self.returned = threading.Event()
        self.cancel_returned = threading.Event()
        self.cancel_returned.set()
        self._lock = threading.Lock()

    def begin(self) -> bool:
        """Return whether `start` is to be called: not where it was cancelled before."""
        with self._lock:
            self.begun = not self.revoked
            return self.begun

    def revoke(self) -> bool:
        """See to it that `start` is not called any more; return whether that was in time."""
        with self._lock:
            self.revoked = not self.begun
            return self.revoked

    def open_text(self) -> str:
        """Return which calls have not returned, "" for none."""
        if not self.returned.is_set():
            return "its `start` has not returned" if self.begun else "its `start` before has not returned"
        return "" if self.cancel_returned.is_set() else "its `cancel` has not returned"


class Caller:
    """Calls `start` and `cancel` of executors.

    In simulated time, and for executors that are prompt (`is_prompt`), calls are made at once. In real time all others
    are called in threads: the `start` calls for one agent one after the other in the agent's own, each `cancel` in
    another. Nobody waits for a thread; one that hangs ends with the process.

    Args:
        clock: on whose thread errors are told.
        grace_s: how long an executor may take to answer a cancel. For some of it, half a second at most, a cancel waits
            for the `start` of the same execution to return, before it is made all the same.
    """

    def __init__(self, clock: Clock, grace_s: float) -> None:
        self._clock = clock
        self._patience_s = min(grace_s / 2, _LONGEST_PATIENCE_S)
        self._starts: dict[str, SimpleQueue[Callable[[], None] | None]] = {}  # by agent

    def start(self, executor: Executor, command: Command, call: Call, on_error: OnError) -> None:
        """Call `start`."""
        action = partial(executor.start, command)
        if self._is_at_once(executor):
            call.begin()
            try:
                _call_at_once(action, on_error)
            finally:
                call.returned.set()
            return
        if command.agent not in self._starts:
            self._starts[command.agent] = SimpleQueue()
            _in_thread(f"start {command.agent}", partial(_work, self._starts[command.agent]))
        self._starts[command.agent].put(partial(self._start_apart, call, action, on_error))

    def cancel(self, executor: Executor, action: Callable[[], None], call: Call, on_error: OnError) -> None:
        """Call `cancel`, an action; where `start` has yet to be called, see to it that it is not."""
        if self._is_at_once(executor):
            _call_at_once(action, on_error)
        elif not call.revoke():
            call.cancel_returned.clear()
            _in_thread("cancel", partial(self._cancel_apart, call, action, on_error))

    def close(self) -> None:
        """Let the threads end; those that hang are left."""
        for queue in self._starts.values():
            queue.put(None)

    def _is_at_once(self, executor: Executor) -> bool:
        return not self._clock.real_time or is_prompt(executor)

    def _start_apart(self, call: Call, action: Callable[[], None], on_error: OnError) -> None:
        if call.begin():
            self._call_apart(action, on_error)
        call.returned.set()

    def _cancel_apart(self, call: Call, action: Callable[[], None], on_error: OnError) -> None:
        call.returned.wait(self._patience_s)
        self._call_apart(action, on_error)
        call.cancel_returned.set()

    def _call_apart(self, action: Callable[[], None], on_error: OnError) -> None:
        try:
            action()
        except BaseException as error:  # noqa: BLE001 - also SystemExit: it would end the thread without a word
            self._clock.submit(partial(on_error, error))


def _call_at_once(action: Callable[[], None], on_error: OnError) -> None:
    try:
        action()
    except LogWriteError:  # of the log itself
        raise
    except Exception as error:  # noqa: BLE001 - an executor is foreign code: its failure is the attempt's
        on_error(error)


def _work(queue: SimpleQueue[Callable[[], None] | None]) -> None:
    while (action := queue.get()) is not None:
        action()


def _in_thread(name: str, action: Callable[[], None]) -> None:
    threading.Thread(target=action, name=name, daemon=True).start()
