"""The order in which threads write into one log: who asks first is first, and events go before samples of signals.

A plain lock says nothing of the order: on a slow disk a thread that samples without a break takes it again and again,
and one that records an event may wait for many writes.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

_LONGEST_WAIT_S: Final = 5.0
"""How long a thread keeps to the order; one that died in its turn, or a signal handler, holds up nobody for longer."""
_LOOK_AGAIN_S: Final = 0.05


@dataclass(frozen=True, slots=True)
class Pressure:
    """How far the disk is behind those who record.

    Attributes:
        waiting: threads that wait for their turn to write.
        last_write_s: how long the last write took.
        longest_write_s: how long the longest one took.
    """

    waiting: int
    last_write_s: float
    longest_write_s: float


class _Ticket:
    """A thread's place in the order. The gate is for one who waits; it opens when it is time to look again."""

    __slots__ = ("depth", "gate")

    def __init__(self) -> None:
        self.depth = 1
        self.gate: threading.Lock | None = None


class Turns:
    """Gives turns: `with turns.events:` around the writing of an event, `with turns.samples:` around that of samples.

    It does not exclude, a lock within does. Within a turn, also in a signal handler, a thread has its turn at once.
    """

    def __init__(self) -> None:
        self._queues = deque[_Ticket](), deque[_Ticket]()
        tickets: dict[int, _Ticket] = {}
        self.events = Turn(tickets, self._queues, 0)
        self.samples = Turn(tickets, self._queues, 1)

    @property
    def waiting(self) -> int:
        """Return how many threads wait for their turn."""
        return max(sum(map(len, self._queues)) - 1, 0)


class Turn:
    """The turns of one kind.

    Args:
        tickets: by thread, of all kinds.
        queues: of all kinds, in their order.
        kind: which of them is its own.
    """

    def __init__(self, tickets: dict[int, _Ticket], queues: tuple[deque[_Ticket], ...], kind: int) -> None:
        self._tickets = tickets
        self._queues = queues
        self._queue = queues[kind]
        self._before = queues[:kind]

    def __enter__(self) -> None:
        thread, tickets = threading.get_ident(), self._tickets
        ticket = tickets.get(thread)
        if ticket is not None:
            ticket.depth += 1
        elif tickets:
            self._queue_up(thread)
        else:  # nobody else is there, the usual case
            tickets[thread] = ticket = _Ticket()
            self._queue.append(ticket)

    def __exit__(self, *_: object) -> None:
        thread = threading.get_ident()
        ticket = self._tickets.get(thread)
        if ticket is None:
            return
        ticket.depth -= 1
        if not ticket.depth:
            self._leave(thread, ticket)

    def _queue_up(self, thread: int) -> None:
        ticket = _Ticket()
        ticket.gate = threading.Lock()
        try:
            self._tickets[thread] = ticket
            self._queue.append(ticket)
            if not self._is_next(ticket):
                self._wait(ticket, ticket.gate)
        except BaseException:
            self._leave(thread, ticket)
            raise

    def _is_next(self, ticket: _Ticket) -> bool:
        return _first(self._queue) is ticket and not any(self._before)

    def _wait(self, ticket: _Ticket, gate: threading.Lock) -> None:
        until = time.monotonic() + _LONGEST_WAIT_S
        gate.acquire()
        while not self._is_next(ticket) and time.monotonic() < until:
            gate.acquire(timeout=_LOOK_AGAIN_S)

    def _leave(self, thread: int, ticket: _Ticket) -> None:
        """Give the turn to the next one, of whichever kind."""
        self._tickets.pop(thread, None)
        with suppress(ValueError):
            self._queue.remove(ticket)
        if self._tickets:
            following = next(filter(None, map(_first, self._queues)), None)
            if following is not None and following.gate is not None and following.gate.locked():
                with suppress(RuntimeError):  # somebody else has opened it
                    following.gate.release()


def _first(queue: deque[_Ticket]) -> _Ticket | None:
    try:
        return queue[0]
    except IndexError:
        return None
