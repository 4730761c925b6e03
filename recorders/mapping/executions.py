"""Executions that are told by states, which may be repeated as often as a source likes."""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from typing import Any, TypeVar

from hrclog.events import Event, TaskEnded, TaskFact, TaskPaused, TaskResumed, TaskStarted, event_on
from hrclog.ids import derived_id
from hrclog.recorders.mapping.facts import Fact, Instant

SOURCE = "bag"
"""First part of the ids that are derived from what a recording holds."""

_Kind = TypeVar("_Kind", bound=TaskFact)


@dataclass(slots=True)
class _Open:
    started: TaskStarted
    paused: bool = False


class Executions:
    """The open executions of a source, by keys of its own.

    Args:
        origin: names the source in ids: kind of meaning and topic.
    """

    def __init__(self, *origin: str) -> None:
        self._origin = origin
        self._open: dict[Hashable, _Open] = {}

    def is_open(self, key: Hashable) -> bool:
        """Return whether an execution runs."""
        return key in self._open

    def open_keys(self) -> list[Hashable]:
        """Return the keys of all that run."""
        return list(self._open)

    def start(self, key: Hashable, agent: str, task: str, at: Instant, **facts: Any) -> Iterator[Fact]:  # noqa: ANN401 - fields of TaskStarted
        """Begin an execution, unless it runs already.

        Args:
            key: names it until it ends.
            agent: who.
            task: what.
            at: when.
            facts: further fields of `TaskStarted`.
        """
        if key in self._open:
            return
        execution_id = derived_id(SOURCE, *self._origin, agent, task, str(key), str(at.ns))
        started = TaskStarted(time_ns=at.ns, agent=agent, task=task, execution_id=execution_id, **facts)
        self._open[key] = _Open(started)
        yield Fact(started, at.clock)

    def end(self, key: Hashable, at: Instant, outcome: str, **facts: Any) -> Iterator[Fact]:  # noqa: ANN401 - fields of TaskEnded
        """End an execution that runs.

        Args:
            key: that it began with.
            at: when.
            outcome: of the vocabulary, "" where the source tells none.
            facts: further fields of `TaskEnded`.
        """
        execution = self._open.pop(key, None)
        if execution is not None:
            yield _fact(TaskEnded, execution, at, outcome=outcome, **facts)

    def pause(self, key: Hashable, at: Instant, **facts: Any) -> Iterator[Fact]:  # noqa: ANN401 - fields of TaskPaused
        """Halt an execution that runs and is not halted."""
        execution = self._open.get(key)
        if execution is not None and not execution.paused:
            execution.paused = True
            yield _fact(TaskPaused, execution, at, **facts)

    def resume(self, key: Hashable, at: Instant) -> Iterator[Fact]:
        """Let an execution go on that is halted."""
        execution = self._open.get(key)
        if execution is not None and execution.paused:
            execution.paused = False
            yield _fact(TaskResumed, execution, at)


def _fact(kind: type[_Kind], execution: _Open, at: Instant, **facts: Any) -> Fact:  # noqa: ANN401 - fields of `kind`
    event: Event = event_on(kind, execution.started, time_ns=at.ns, **facts)
    return Fact(event, at.clock)
