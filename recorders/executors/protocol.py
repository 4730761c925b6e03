"""The interface between a dispatcher and an executor: simulator, operator page, ROS node or replay."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

from hrclog.events import CommandRejected, Event, Role

Emit = Callable[[Event], None]
"""Takes an event the moment it happens. May be called from any thread, and from within `start` and `cancel`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """One attempt at one item, to be carried out by one agent; planned instants in ns on the recorder's clock."""

    run_id: str
    command_id: str
    execution_id: str
    item_id: str
    agent: str
    task: str
    task_type: str = ""
    role: str = Role.PRIMARY
    attempt: int = 1
    parent_execution_id: str = ""
    planned_start_ns: int | None = None
    planned_end_ns: int | None = None
    parameters: Mapping[str, Any] = field(default_factory=dict)


def rejection(command: Command, *, time_ns: int, reason: str) -> CommandRejected:
    """Return the event that says a command is refused."""
    return CommandRejected(
        time_ns=time_ns,
        run_id=command.run_id,
        command_id=command.command_id,
        execution_id=command.execution_id,
        agent=command.agent,
        task=command.task,
        reason=reason,
    )


def is_prompt(executor: Executor) -> bool:
    """Return whether an executor says that its methods never block and belong in the thread of its clock.

    What a class says holds for its own methods: a class derived from it that has others says it anew.
    """
    if getattr(executor, "prompt", False) is not True:
        return False
    classes = type(executor).__mro__

    def depth(name: str) -> int:
        return next((i for i, owner in enumerate(classes) if name in vars(owner)), -1)

    return depth("prompt") <= min(depth("start"), depth("cancel"))


@runtime_checkable
class Executor(Protocol):
    """Carries out the tasks of its agents and emits what happens.

    A command is answered by `command_rejected`, or by `task_started`, any number of pauses and resumptions, and one
    `task_ended`; one that is cancelled before its start by `task_ended` alone. Every event carries the command's ids
    (`hrclog.events.event_on`). Facts that belong to no command (safety states, heartbeats) are emitted in the same
    way. The dispatcher keeps events that break these rules as annotations.

    In real time `start` and `cancel` are called in threads, so that an executor that blocks holds up nobody else: the
    `start` calls for one agent one after the other, those for different agents and cancels at any time. An executor
    that never blocks and wants all calls in the thread of its clock says so by `prompt = True` in its class.
    """

    @property
    def agents(self) -> tuple[str, ...]:
        """The agents it acts for."""
        ...

    def connect(self, emit: Emit) -> None:
        """Send all events to `emit` from now on; called once, before the first command."""
        ...

    def start(self, command: Command) -> None:
        """Begin a command; returns soon."""
        ...

    def cancel(self, execution_id: str, reason: str) -> None:
        """Ask for the end of an execution as `canceled`; one that has ended already is left alone."""
        ...
