"""How long an attempt may take: as its item or the policy says, else a multiple of what it is expected to take."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from hrclog.planning.problem import Task
from hrclog.recorders.dispatch.policy import DispatchPolicy
from hrclog.recorders.executors.protocol import Command
from hrclog.units import NS_PER_S

LEAST_S: Final = 10.0
"""The shortest limit that is worked out, however short the task."""


@dataclass(frozen=True, slots=True)
class Limits:
    """The limits of an attempt in seconds, None for none.

    Attributes:
        start_s: from its command to its start.
        work_s: from its start to its end.
        call_s: how long `start` of its executor may take without a word.
        expected: whether the limits come from an expected duration; then pauses do not count.
    """

    start_s: float | None
    work_s: float | None
    call_s: float | None
    expected: bool = False


def limits_of(
    command: Command, timeout_s: float | None, policy: DispatchPolicy, task: Task | None, *, real_time: bool
) -> Limits:
    """Return the limits of an attempt.

    Args:
        command: the attempt.
        timeout_s: what its item says.
        policy: what holds for all.
        task: what is to be done, if it is known.
        real_time: without it, only what the item and the policy say counts: a simulated run comes to an end by itself.
    """
    work_s = policy.timeout_s if timeout_s is None else timeout_s
    call_s = policy.call_timeout_s if real_time else None
    is_expected = work_s is None and real_time and policy.timeout_factor is not None
    if is_expected and policy.timeout_factor is not None:
        expected_s = _expected_s(command, task)
        work_s = None if expected_s is None else max(policy.timeout_factor * expected_s, LEAST_S)
    start_s = work_s if policy.start_timeout_s is None else policy.start_timeout_s
    return Limits(start_s, work_s, call_s, is_expected)


def _expected_s(command: Command, task: Task | None) -> float | None:
    """Return how long a task is expected to take: as planned, else as its problem declares."""
    if command.planned_start_ns is not None and command.planned_end_ns is not None:
        return (command.planned_end_ns - command.planned_start_ns) / NS_PER_S
    return None if task is None else task.expected_s.get(command.agent)
