"""How a dispatcher goes about a plan: mode, retries and patience."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from enum import StrEnum

from hrclog.errors import DispatchError
from hrclog.planning.dispatch_mode import DispatchMode


class OnFailure(StrEnum):
    """What becomes of a run when an item has failed for good.

    SKIP: what depends on it is skipped, and the rest goes on. ABORT: what runs is cancelled, and the run ends.
    """

    SKIP = "skip"
    ABORT = "abort"


class ReplanOn(StrEnum):
    """What another plan is asked for.

    FAILURE: an item has failed for good. DELAY: an item starts, or is still running, too long after its planned time.
    """

    FAILURE = "failure"
    DELAY = "delay"


_REAL_TIME = ("timeout_factor", "call_timeout_s")
_REPLANNING = ("replan_on", "delay_s", "max_replans")


@dataclass(frozen=True, slots=True, kw_only=True)
class DispatchPolicy:
    """How items are handed out, and what happens when one goes wrong.

    Args:
        mode: how items are handed out.
        max_attempts: how often an item is tried; failed and timed out attempts are tried again, rejected ones are not.
        on_failure: what follows when no attempt is left.
        timeout_s: how long an attempt may take from its start, pauses included; a `timeout_s` of its item wins. None:
            in real time as `timeout_factor` says, in simulated time no limit.
        timeout_factor: in real time, where neither item nor policy has a limit and an expected duration is known, how
            many times that an attempt may take, pauses not counted; at least `limits.LEAST_S`. None for no limit.
        call_timeout_s: in real time, how long an executor's `start` may take without a word from it; None for ever.
        start_timeout_s: how long it may take from being dispatched to its start; None: as long as `timeout_s`.
        grace_s: how long an executor may take to answer a cancel; after that it gets nothing more for that agent.
        max_wait_s: how long to wait for facts when nothing else is left to do; None for ever (in simulated time, until
            nothing is left to happen).
        replan_on: when another plan is asked for, where there is somebody to ask; a failure before `on_failure`.
        delay_s: how much later than planned an item may start, and end, before another plan is asked for.
        max_replans: how often the plan may change in a run, so that work which always fails does not come back for
            ever.

    Raises:
        DispatchError: a number is out of range, or a word unknown.
    """

    mode: str = DispatchMode.SEQUENTIAL
    max_attempts: int = 1
    on_failure: str = OnFailure.SKIP
    timeout_s: float | None = None
    start_timeout_s: float | None = None
    grace_s: float = 2.0
    max_wait_s: float | None = None
    replan_on: tuple[str, ...] = ()
    delay_s: float = 5.0
    max_replans: int = 100
    timeout_factor: float | None = 10.0
    call_timeout_s: float | None = 30.0

    def __post_init__(self) -> None:
        _check_word("mode", self.mode, tuple(DispatchMode))
        _check_word("on_failure", self.on_failure, tuple(OnFailure))
        if self.max_attempts < 1:
            raise DispatchError(f"max_attempts: found {self.max_attempts}, expected at least 1")
        if self.max_replans < 0:
            raise DispatchError(f"max_replans: found {self.max_replans}, expected at least 0")
        for word in self.replan_on:
            _check_word("replan_on", word, tuple(ReplanOn))
        for name in ("timeout_s", "start_timeout_s", "grace_s", "max_wait_s", "delay_s", *_REAL_TIME):
            value = getattr(self, name)
            least = 0.0 if name in ("grace_s", "max_wait_s", "delay_s") else math.ulp(0.0)
            if value is not None and not least <= value < math.inf:
                raise DispatchError(
                    f"{name}: found {value}, expected a finite number {'from' if not least else 'above'} 0"
                )

    def __repr__(self) -> str:
        """Return all fields that count in simulated time, those of replanning only where something is set.

        Ids of simulated runs are derived from this.
        """
        shown = (f.name for f in fields(self) if f.name not in _REAL_TIME)
        names = (name for name in shown if name not in _REPLANNING or self.replan_on)
        return f"DispatchPolicy({', '.join(f'{name}={getattr(self, name)!r}' for name in names)})"


def _check_word(name: str, value: str, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise DispatchError(f"{name}: found {value!r}, expected one of {', '.join(allowed)}")
