"""The core of a recorder, which handles every event: check, number, write, remember."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from hrclog.errors import IllegalEventError, LogReadError
from hrclog.events import CLOCK_SHIFT, AnnotationAdded, Event, Outcome, RunEnded, RunStarted, TaskFact
from hrclog.forks import renew_after_fork
from hrclog.log.files.system import exists
from hrclog.log.losses import Loss, remark
from hrclog.log.messages.encode import Message, Signal, event_message, run_metadata, signal_message
from hrclog.log.recover import recover
from hrclog.log.writing.journal import Journal, journal_path
from hrclog.log.writing.lanes import Lanes
from hrclog.log.writing.writer import RUN_METADATA
from hrclog.recorders.segments import Segment
from hrclog.recorders.task_handle import NOW, TaskHandle, instant
from hrclog.recorders.turns import Pressure, Turns
from hrclog.state import PLANNED, ExecutionState, Phase, apply
from hrclog.units import NS_PER_S

AnyEvent = TypeVar("AnyEvent", bound=Event)

_OPEN = (Phase.STARTED, Phase.PAUSED)
_JITTER_NS = 100_000_000  # by which a clock that threads or computers share may seem to go back


def steady_clock() -> Callable[[], int]:
    """Return a clock of ns since the epoch that never runs backwards, whatever is done to the system's clock."""
    offset = time.time_ns() - time.monotonic_ns()
    return lambda: offset + time.monotonic_ns()


def _finish(journal: Path, log: Path) -> None:
    """Turn a closed journal into its log; another process may be doing so already."""
    try:
        recover(journal, log, wait=True)
    except LogReadError:
        if exists(journal) or not exists(log):
            raise


class EventRecorder:
    """Write the events of one run, in an order that the state machine allows; from any thread.

    Attributes:
        path: the log to be.
        run_id: of the run.
        losses: what of the run was found lost when it was resumed, in words.
        resumed_ns: the latest instant of the run before it was resumed, None for a new run.

    Args:
        segment: where to write, and what the run has come to before.
        started: the first event.
        fsync: each event also survives a crash of the operating system.
        clock_ns: the recorder's clock.

    Raises:
        InvalidEventError: the first event is not of the form the vocabulary asks for.
        LogExistsError: a journal is there already.
        LogWriteError: the log cannot be written.
    """

    def __init__(self, segment: Segment, started: RunStarted, *, fsync: bool, clock_ns: Callable[[], int]) -> None:
        self.path = segment.path
        self.run_id = segment.run_id
        self.losses = segment.told
        self.resumed_ns = segment.last_ns if segment.number > 1 else None
        self._clock_ns = clock_ns
        self._journal: Journal | None = None
        self._lock = threading.RLock()
        self._turns = Turns()
        self._last_write_s = self._longest_write_s = 0.0
        renew_after_fork(self)
        self._seq = segment.next_seq
        self._states: dict[str, ExecutionState] = dict(segment.states)
        self._facts: dict[str, TaskFact] = dict(segment.facts)
        self._ended = False
        self._lanes = Lanes()
        self._open_ids = {key: None for key, state in self._states.items() if state.phase in _OPEN}
        self._last_ns: dict[str, int] = {key: self._states[key].start_ns or 0 for key in self._open_ids}
        self._floor_ns = segment.last_ns
        self._shift_ns = max(segment.last_ns - clock_ns(), 0) if segment.number > 1 else 0
        self._untold_ns = 0  # of the shift
        self._pid = os.getpid()
        for handle in self.open_executions():
            self._lanes.begin(handle.fact)
        if self._shift_ns:
            started = replace(started, details={**started.details, CLOCK_SHIFT: self._shift_ns})
        self._open(started, segment.losses, Journal(journal_path(self.path), fsync=fsync))

    def record(self, event: AnyEvent) -> AnyEvent:
        """Record any event; its run_id and seq are set here. Returns the event as it was written.

        Raises:
            InvalidEventError: a field is not of the form the vocabulary asks for.
            IllegalEventError: the state machine does not allow it, or the recorder is closed; nothing was written.
            LogWriteError: the disk did not take it.
        """
        with self._turns.events, self._lock:
            journal = self._open_journal()
            if self._ended:
                raise IllegalEventError(f"{self.path}: found {event.kind} after run_ended, expected nothing more")
            now = self._now()
            if self._untold_ns and CLOCK_SHIFT not in event.details:
                self._tell_put_back()
            time_ns = now if event.time_ns == NOW else event.time_ns
            numbered = replace(event, run_id=self.run_id, seq=self._seq, time_ns=time_ns)
            state = self._next_state(numbered)
            message = event_message(numbered, now)
            size = journal.size
            try:
                self._append(journal, message, *self._lanes.after(numbered, now))
            finally:
                if journal.size > size:  # true also where an interrupt strikes just after the write
                    self._remember(numbered, state)
            return numbered

    def pressure(self) -> Pressure:
        """Return how far the disk is behind; it waits for nothing. A busy caller may drop samples by it."""
        return Pressure(self._turns.waiting, self._last_write_s, self._longest_write_s)

    def handle(self, execution: TaskHandle | str) -> TaskHandle:
        """Return the handle of an execution by its id.

        Raises:
            IllegalEventError: no execution of this run has that id.
        """
        if isinstance(execution, TaskHandle):
            return execution
        with self._turns.events, self._lock:
            if execution not in self._facts:
                problem = f"{self.path}: found execution {execution!r}"
                raise IllegalEventError(f"{problem}, expected one that was started here")
            return TaskHandle(self, self._facts[execution])

    def now_ns(self) -> int:
        """Return the recorder's clock."""
        with self._turns.events, self._lock:
            return self._now()

    def state(self, execution_id: str) -> ExecutionState:
        """Return the state of an execution; planned if it is not known."""
        with self._turns.events, self._lock:
            return self._states.get(execution_id, PLANNED)

    def open_executions(self) -> list[TaskHandle]:
        """Return the executions that have begun and not ended, in order of their start."""
        with self._turns.events, self._lock:
            return [TaskHandle(self, self._facts[execution_id]) for execution_id in self._open_ids]

    def close(self, outcome: str = Outcome.SUCCEEDED, reason: str = "", *, time_ns: int | None = None) -> None:
        """End the run and finish the log; tasks still open stay open. Closing twice does nothing.

        A process that was forked from the recorder's closes nothing: the run is not its own.

        Args:
            outcome: of the run.
            reason: why.
            time_ns: when the run ended; default now.

        Raises:
            LogWriteError: the finished log could not be written; the journal holds everything, see `hrclog recover`.
        """
        with self._turns.events, self._lock:
            if self._journal is None or os.getpid() != self._pid:
                return
            if not self._ended:
                self.record(RunEnded(time_ns=instant(time_ns), outcome=str(outcome), reason=reason))
            journal, self._journal = self._journal, None
            journal.close()
            _finish(journal.path, self.path)

    def renew_after_fork(self) -> None:
        """Let go of the journal, and wait for no thread left behind, in a process forked from the recorder's."""
        self._lock = threading.RLock()
        self._turns = Turns()
        if self._journal is not None:
            self._journal.close()  # else its lock would outlive the process that records

    def _open(self, started: RunStarted, losses: Iterable[Loss], journal: Journal) -> None:
        """Write the first events, or leave no journal behind."""
        self._journal = journal
        try:
            journal.metadata(RUN_METADATA, run_metadata(self.record(started)))
            for loss in losses:
                self.record(replace(remark(loss), time_ns=NOW))
        except BaseException:
            self._journal = None
            journal.close()
            with suppress(OSError):
                journal.path.unlink()
            raise

    def _sample(self, *signals: Signal) -> None:
        """Write samples of signals: all of them, or none."""
        with self._turns.samples, self._lock:
            now = self._now()
            messages = [
                signal_message(replace(signal, time_ns=now) if signal.time_ns == NOW else signal, now)
                for signal in signals
            ]
            self._append(self._open_journal(), *messages)

    def _append(self, journal: Journal, *messages: Message) -> None:
        """Append messages, and note how long the disk took."""
        began = time.perf_counter()
        journal.append(*messages)
        self._last_write_s = time.perf_counter() - began
        self._longest_write_s = max(self._longest_write_s, self._last_write_s)

    def _remember(self, event: Event, state: ExecutionState | None) -> None:
        """Remember what was written."""
        self._seq = event.seq + 1
        self._ended = isinstance(event, RunEnded)
        if isinstance(event, TaskFact) and state is not None:
            self._states[event.execution_id] = state
            self._facts.setdefault(event.execution_id, event)
            if state.phase in _OPEN:
                self._open_ids[event.execution_id] = None
                self._last_ns[event.execution_id] = event.time_ns
            else:
                self._open_ids.pop(event.execution_id, None)
                self._last_ns.pop(event.execution_id, None)

    def _next_state(self, event: Event) -> ExecutionState | None:
        if not isinstance(event, TaskFact):
            return None
        state, problem = apply(self._states.get(event.execution_id, PLANNED), event)
        if problem and problem not in ("missing_identity", "invalid_outcome"):  # those two have clearer errors below
            raise IllegalEventError(
                f"{self.path}: {event.kind} of {event.agent!r}, {event.task!r} is not allowed ({problem}); "
                f"the execution is {self.state(event.execution_id).phase}"
            )
        last_ns = self._last_ns.get(event.execution_id, event.time_ns)
        if event.time_ns < last_ns:
            raise IllegalEventError(
                f"{self.path}: {event.kind} of {event.agent!r}, {event.task!r} at {event.time_ns} ns comes before what "
                f"happened to it at {last_ns} ns; expected a later instant"
            )
        return state

    def _now(self) -> int:
        """Return the clock's instant, never before an earlier result or what the run held before.

        Where the clock was put back, instants go on from the last one at the clock's pace.
        """
        now = self._clock_ns() + self._shift_ns
        behind_ns = self._floor_ns - now
        if behind_ns > _JITTER_NS:
            self._shift_ns += behind_ns
            self._untold_ns += behind_ns
        self._floor_ns = max(now, self._floor_ns)
        return self._floor_ns

    def _tell_put_back(self) -> None:
        """Record that the clock was put back since the last event."""
        shift_ns, self._untold_ns = self._untold_ns, 0
        reason = f"the recorder's clock was put back by {shift_ns / NS_PER_S:g} s; later times are shifted by that"
        self.record(AnnotationAdded(time_ns=NOW, reason=reason, details={CLOCK_SHIFT: shift_ns}))

    def _open_journal(self) -> Journal:
        if os.getpid() != self._pid:
            raise IllegalEventError(
                f"{self.path}: the recorder belongs to process {self._pid}; record another run here"
            )
        if self._journal is None:
            raise IllegalEventError(f"{self.path}: the recorder is closed; continue the run with resume=True")
        return self._journal

    def _end_if_open(self, handle: TaskHandle, outcome: str, reason: str) -> None:
        with self._turns.events, self._lock:
            if handle.phase is not Phase.ENDED:
                handle.end(outcome, reason)
