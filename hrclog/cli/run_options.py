"""What the options of `hrclog run` say of each run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """The options by name; None where the scenario decides."""

    scenario: str | None
    engine: str
    safety: str | None
    signals_hz: float | None
    agents: tuple[str, ...]
    mode: str | None
    seed: int
    timeout_s: float | None
    no_timeout: bool
    max_attempts: int | None
    on_failure: str | None
    kb: str | None
    replan_on: tuple[str, ...]
    delay_s: float | None
    real_time: bool
    tags: Mapping[str, str]
