"""The interface of simulated cells, and the list of engines."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol

from hrclog.errors import ScenarioError
from hrclog.plugins import imported
from hrclog.recorders.clock import Clock
from hrclog.recorders.executors.protocol import Executor
from hrclog.sim.truth import ExecutionTruth, PairTruth

if TYPE_CHECKING:
    from hrclog.log.messages.encode import Signal
    from hrclog.sim.scenario import Scenario


@dataclass(frozen=True, slots=True)
class EngineRecord:
    """A way to simulate a cell.

    Attributes:
        name: by which it is chosen.
        summary: what it simulates.
        make: dotted path `module:NAME` of what makes a cell of scenario, clock, seed and number of the run.
    """

    name: str
    summary: str
    make: str


ENGINE_RECORDS: Final = (
    EngineRecord("events", "discrete events with given synergies", "hrclog.sim.discrete:discrete_cell"),
    EngineRecord("bullet", "a robot and a human that move, in PyBullet", "hrclog.sim.bullet.engine:BulletCell"),
)
"""The usual one first."""

ENGINES: Final = tuple(record.name for record in ENGINE_RECORDS)
"""Their names."""


class Engine(Protocol):
    """A cell in simulated time.

    Its events need neither `run_id` nor `seq`. What it wants to do at an instant it schedules with its clock.
    """

    @property
    def name(self) -> str:
        """What the log says made the run."""
        ...

    @property
    def executors(self) -> Mapping[str, Executor]:
        """Who carries out the tasks, by agent."""
        ...

    @property
    def truth(self) -> Sequence[ExecutionTruth]:
        """The truth about the executions that have ended, in order of their ends."""
        ...

    @property
    def pairs(self) -> Sequence[PairTruth]:
        """What tasks did to each other, where the cell can only tell afterwards."""
        ...

    @property
    def contacts(self) -> int | None:
        """How often the moving robot touched the human; None where nobody looks."""
        ...

    @property
    def signals(self) -> Sequence[Signal]:
        """The samples taken so far, in order of time."""
        ...

    def watch(self) -> None:
        """Begin: say the first safety states; called once, at the start of the run, before the first command."""
        ...

    def stop(self) -> None:
        """End: called once, when the dispatcher has nothing left to do; nothing need be scheduled any more."""
        ...


def make_engine(name: str, scenario: Scenario, clock: Clock, seed: int, index: int) -> Engine:
    """Return a new cell for one run.

    Args:
        name: one of `ENGINES`.
        scenario: what the cell is like.
        clock: stands at the start of the run.
        seed: of the campaign.
        index: number of the run in the campaign.

    Raises:
        ScenarioError: there is no such engine, or it cannot carry out the scenario.
    """
    for record in ENGINE_RECORDS:
        if record.name == name:
            make: Callable[[Scenario, Clock, int, int], Engine] = imported("engine", record.make)
            return make(scenario, clock, seed, index)
    raise ScenarioError(f"engine {name!r}: unknown; the engines are {', '.join(ENGINES)}")
