"""What a dispatcher and its executors ask of time, simulated or real."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

Action = Callable[[], None]


class Clock(Protocol):
    """The instant it is, and what is going to happen; all actions happen one after the other, on one thread.

    `hrclog.sim.event_queue.EventQueue` jumps from action to action, `RealTimeLoop` waits for them.
    """

    @property
    def now_ns(self) -> int:
        """The instant, ns since the epoch."""
        ...

    def schedule(self, time_ns: int, action: Action, priority: int = 0) -> None:
        """Let an action happen at an instant; at the same instant the smaller priority first."""
        ...

    def submit(self, action: Action) -> None:
        """Let an action happen as soon as may be: at once in simulated time, from any thread in real time."""
        ...

    def run(self, until: Callable[[], bool]) -> None:
        """Let things happen until `until` is true; in simulated time no longer than something is left to happen."""
        ...
