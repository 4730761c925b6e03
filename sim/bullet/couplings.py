"""Count, tick by tick, how much tasks of different agents slow each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from hrclog.sim.bullet.stepped import TICK_S
from hrclog.sim.scenario import AgentTask
from hrclog.sim.truth import PairTruth


@dataclass(frozen=True, slots=True)
class Going:
    """An execution in a tick.

    `rate` is the work done per time; `caused` is the rate that the others asked for, before any lag in obeying.
    """

    key: AgentTask
    rate: float
    caused: float


class Couplings:
    """Overlap and progress of every ordered pair of tasks of different agents, tick by tick."""

    def __init__(self) -> None:
        self._sums: dict[tuple[AgentTask, AgentTask], list[float]] = {}

    def count(self, going: Mapping[str, Going]) -> None:
        """Take in a tick.

        Args:
            going: by agent, what it is at.
        """
        for agent, activity in going.items():
            for other_agent, other_activity in going.items():
                if agent != other_agent:
                    sums = self._sums.setdefault((activity.key, other_activity.key), [0.0, 0.0, 0.0])
                    sums[0] += 1.0
                    sums[1] += activity.rate
                    sums[2] += activity.caused

    def pairs(self) -> tuple[PairTruth, ...]:
        """Return the sums so far, in s, by name."""
        return tuple(
            PairTruth(*key, *other, *(round(value * TICK_S, 9) for value in sums))
            for (key, other), sums in sorted(self._sums.items())
        )
