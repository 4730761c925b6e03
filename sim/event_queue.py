"""The core of a discrete-event simulation. Actions are ordered by (time, priority, sequence), so no ties remain."""

from __future__ import annotations

from collections.abc import Callable
from heapq import heappop, heappush

from hrclog.recorders.clock import Action


class EventQueue:
    """The scheduled actions and the simulated clock; a `Clock` for one thread.

    Args:
        now_ns: where the clock starts, in ns.
    """

    def __init__(self, now_ns: int) -> None:
        self.now_ns = now_ns
        self._heap: list[tuple[int, int, int, Action]] = []
        self._sequence = 0

    @property
    def real_time(self) -> bool:
        """It is not: time stands still while something runs."""
        return False

    def schedule(self, time_ns: int, action: Action, priority: int = 0) -> None:
        """Run an action at an instant. The smaller priority goes first, then the action scheduled first."""
        heappush(self._heap, (max(time_ns, self.now_ns), priority, self._sequence, action))
        self._sequence += 1

    def submit(self, action: Action) -> None:
        """Run an action now, before all others."""
        action()

    def run(self, until: Callable[[], bool] = lambda: False) -> None:
        """Run all actions, and those they schedule, until `until` is true or none is left."""
        while self._heap and not until():
            self.now_ns, _, _, action = heappop(self._heap)
            action()
