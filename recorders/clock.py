"""The clock that a dispatcher and its executors use, simulated or real."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

Action = Callable[[], None]


class Clock(Protocol):
    """The current instant and the scheduled actions. All actions run one after the other, on one thread.

    `hrclog.sim.event_queue.EventQueue` jumps from action to action, `RealTimeLoop` waits for them.
    """

    @property
    def now_ns(self) -> int:
        """The instant, ns since the epoch."""
        ...

    @property
    def real_time(self) -> bool:
        """Whether time goes on by itself, also while somebody blocks."""
        ...

    def schedule(self, time_ns: int, action: Action, priority: int = 0) -> None:
        """Run an action at an instant. At the same instant the smaller priority goes first."""
        ...

    def submit(self, action: Action) -> None:
        """Run an action as soon as possible: at once in simulated time, from any thread in real time."""
        ...

    def run(self, until: Callable[[], bool]) -> None:
        """Run actions until `until` is true. In simulated time this also ends when no action is left."""
        ...
