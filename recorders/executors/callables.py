"""An executor made of functions: the shortest way to connect a real robot."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from hrclog.events import Outcome, TaskEnded, TaskStarted, event_on
from hrclog.recorders.clock import Clock
from hrclog.recorders.executors.protocol import Command, Emit, rejection

Function = Callable[[Command], Any]
"""Does a task; it has succeeded when it returns, and failed when it raises."""


class CallableExecutor:
    """Call a function per command, each in a thread of its own, in real time.

    Args:
        functions: by task.
        agents: to act for.
        clock: a `RealTimeLoop`.
        stop: called with a command that is cancelled; it should make the function return or raise. Without it, and as
            long as the function goes on, a cancel is not answered.
    """

    def __init__(
        self,
        functions: Mapping[str, Function],
        agents: Iterable[str],
        clock: Clock,
        stop: Callable[[Command], Any] = lambda _: None,
    ) -> None:
        self._functions = functions
        self._agents = tuple(agents)
        self._clock = clock
        self._stop = stop
        self._emit: Emit = lambda _: None
        self._running: dict[str, Command] = {}
        self._cancel_reasons: dict[str, str] = {}  # why, by execution id

    @property
    def agents(self) -> tuple[str, ...]:
        """The agents it acts for."""
        return self._agents

    def connect(self, emit: Emit) -> None:
        """Send all events to `emit` from now on."""
        self._emit = emit

    def start(self, command: Command) -> None:
        """Call the function of the task, if there is one."""
        if command.task not in self._functions:
            reason = f"no function for task {command.task!r}"
            self._emit(rejection(command, time_ns=self._clock.now_ns, reason=reason))
            return
        self._running[command.execution_id] = command
        threading.Thread(target=self._run_function, args=(command,), name=command.task, daemon=True).start()

    def cancel(self, execution_id: str, reason: str) -> None:
        """Ask the function to end."""
        command = self._running.get(execution_id)
        if command is not None:
            self._cancel_reasons[execution_id] = reason
            self._stop(command)

    def _run_function(self, command: Command) -> None:
        planned = {"planned_start_ns": command.planned_start_ns, "planned_end_ns": command.planned_end_ns}
        self._emit(event_on(TaskStarted, command, time_ns=self._clock.now_ns, **planned))
        outcome, reason = Outcome.SUCCEEDED, ""
        try:
            self._functions[command.task](command)
        except BaseException as error:  # noqa: BLE001 - whatever a function raises is the reason of its failure
            outcome, reason = Outcome.FAILED, f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        self._running.pop(command.execution_id, None)
        if outcome is Outcome.FAILED and command.execution_id in self._cancel_reasons:
            outcome, reason = Outcome.CANCELED, self._cancel_reasons[command.execution_id]
        self._emit(event_on(TaskEnded, command, time_ns=self._clock.now_ns, outcome=outcome, reason=reason))
