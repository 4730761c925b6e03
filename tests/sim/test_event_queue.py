"""The core: actions in order of time, priority and sequence."""

from __future__ import annotations

from functools import partial

from hypothesis import given
from hypothesis import strategies as st

from hrclog.sim.event_queue import EventQueue


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 2))))
def test_actions_happen_by_time_then_priority_then_as_scheduled(wishes: list[tuple[int, int]]) -> None:
    queue = EventQueue(0)
    seen: list[tuple[int, int, int]] = []
    for number, (time_ns, priority) in enumerate(wishes):
        queue.schedule(time_ns, partial(seen.append, (time_ns, priority, number)), priority)
    queue.run()
    assert seen == sorted(seen)
    assert len(seen) == len(wishes)


def test_the_clock_stands_at_the_instant_of_the_action_and_never_goes_back() -> None:
    queue = EventQueue(10)
    seen: list[int] = []
    queue.schedule(30, lambda: queue.schedule(5, lambda: seen.append(queue.now_ns)))
    queue.schedule(20, lambda: seen.append(queue.now_ns))
    queue.run()
    assert seen == [20, 30]
