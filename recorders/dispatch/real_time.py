"""Real time: scheduled actions run when the wall clock reaches them, actions of other threads run at once."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from heapq import heappop, heappush
from queue import Empty, SimpleQueue
from typing import Final

from hrclog.recorders.clock import Action
from hrclog.recorders.event_recorder import steady_clock

_AT_ONCE: Final = -1
_LONGEST_WAIT_S: Final = 1.0

_Entry = tuple[int, int, int, Action]


class RealTimeLoop:
    """A clock that never runs backwards, and a loop that carries out actions in the thread that calls `run`.

    All but `run` may be called from any thread, and from a signal handler.

    Args:
        clock_ns: ns since the epoch; default the system's, undisturbed by whoever sets it.
    """

    def __init__(self, clock_ns: Callable[[], int] | None = None) -> None:
        self._clock_ns = clock_ns or steady_clock()
        self._inbox: SimpleQueue[_Entry] = SimpleQueue()  # its put may interrupt itself, as a signal handler does
        self._heap: list[_Entry] = []
        self._number = itertools.count()

    @property
    def now_ns(self) -> int:
        """The instant, ns since the epoch."""
        return self._clock_ns()

    @property
    def real_time(self) -> bool:
        """It is."""
        return True

    def schedule(self, time_ns: int, action: Action, priority: int = 0) -> None:
        """Run an action at an instant. If that is past, run it at once, after all submitted actions."""
        self._inbox.put((max(time_ns, 0), priority, next(self._number), action))

    def submit(self, action: Action) -> None:
        """Run an action at once, before all scheduled actions."""
        self._inbox.put((_AT_ONCE, 0, next(self._number), action))

    def run(self, until: Callable[[], bool]) -> None:
        """Carry out actions in this thread until `until` is true; it is asked after each of them."""
        while not until():
            while not self._inbox.empty():
                heappush(self._heap, self._inbox.get())
            wait_s = self._wait_s()
            if wait_s <= 0.0:
                heappop(self._heap)[3]()
                continue
            try:
                heappush(self._heap, self._inbox.get(timeout=wait_s))
            except Empty:
                continue

    def _wait_s(self) -> float:
        if not self._heap:
            return _LONGEST_WAIT_S
        return min((self._heap[0][0] - self.now_ns) / 1e9, _LONGEST_WAIT_S)
