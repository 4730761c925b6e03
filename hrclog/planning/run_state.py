"""How a run that is under way stands: what is over, what is running, what is known; for whoever plans the rest."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from hrclog.errors import ScenarioError
from hrclog.events import (
    AnnotationAdded,
    Event,
    PlanChanged,
    RunStarted,
    TaskDispatched,
    TaskEnded,
    TaskFact,
    TaskStarted,
)
from hrclog.planning.plan import Plan, PlanItem, plan_of_value
from hrclog.units import NS_PER_S


@dataclass(frozen=True, slots=True)
class Running:
    """An item under way: which attempt it is, and the seconds since its start, None while it is only dispatched."""

    item_id: str
    since_s: float | None = None
    attempt: int = 1


@dataclass(frozen=True, slots=True)
class RunState:
    """A run at an instant; seconds count from its start.

    Attributes:
        now_s: the instant.
        plan: the plan that is followed.
        outcomes: final outcome by item id of all that is over, also of items that a former plan had.
        running: what is under way, by agent.
        facts: what has arrived.
    """

    now_s: float
    plan: Plan
    outcomes: Mapping[str, str]
    running: Mapping[str, Running]
    facts: frozenset[str] = frozenset()

    def left(self) -> tuple[PlanItem, ...]:
        """Return the items of the plan that are not over, those under way among them."""
        return tuple(item for item in self.plan.items if item.item_id not in self.outcomes)


Replan = Callable[[RunState, str], Plan | None]
"""Returns another plan, given how the run stands and why it is asked for; None to go on as before."""


def run_state(events: Iterable[Event], now_ns: int | None = None) -> RunState:
    """Return how a run stands after its events so far.

    An item that failed counts as over until its next attempt is dispatched.

    Args:
        events: of one run, in order of (time, seq).
        now_ns: the instant asked for; default that of the last event.

    Raises:
        ScenarioError: there is no plan among them, or one that cannot be read.
    """
    fold: Fold | None = None
    for event in events:
        if fold is not None:
            fold.take(event)
        elif isinstance(event, RunStarted) and event.plan is not None:
            fold = Fold(plan_of_value(event.plan, "plan of run_started"), event.time_ns)
    if fold is None:
        raise ScenarioError("the run has no plan: found no run_started with one; a run by `hrclog run` or `sim` has it")
    return fold.state(now_ns)


class Fold:
    """The state of a run, event by event.

    Args:
        plan: followed from the start.
        start_ns: when the run started.
    """

    def __init__(self, plan: Plan, start_ns: int) -> None:
        self._plan = plan
        self._start_ns = self._last_ns = start_ns
        self._outcomes: dict[str, str] = {}
        self._under_way: dict[str, tuple[TaskFact, int | None]] = {}  # by agent; with the instant of the start
        self._facts: set[str] = set()

    def take(self, event: Event) -> None:
        """Take in the next event of the run."""
        self._last_ns = max(self._last_ns, event.time_ns)
        match event:
            case RunStarted() | PlanChanged() if event.plan is not None:
                self._plan = plan_of_value(event.plan, f"plan of {event.kind}")
            case AnnotationAdded(details={"arrived": str() as fact}):
                self._facts.add(fact)
            case TaskFact() if event.item_id and not event.parent_execution_id:
                self._take_fact(event)

    def state(self, now_ns: int | None = None) -> RunState:
        """Return the state at an instant, default that of the last event."""
        now_ns = self._last_ns if now_ns is None else now_ns
        running = {
            agent: Running(fact.item_id, None if start_ns is None else (now_ns - start_ns) / NS_PER_S, fact.attempt)
            for agent, (fact, start_ns) in self._under_way.items()
        }
        now_s = (now_ns - self._start_ns) / NS_PER_S
        return RunState(now_s, self._plan, dict(self._outcomes), running, frozenset(self._facts))

    def _take_fact(self, event: TaskFact) -> None:
        if isinstance(event, TaskDispatched | TaskStarted):
            self._outcomes.pop(event.item_id, None)
            self._under_way[event.agent] = (event, event.time_ns if isinstance(event, TaskStarted) else None)
        elif isinstance(event, TaskEnded):
            self._outcomes[event.item_id] = event.outcome
            if event.agent in self._under_way and self._under_way[event.agent][0].item_id == event.item_id:
                del self._under_way[event.agent]
