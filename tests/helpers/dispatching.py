"""Plans carried out in simulated time by scripted agents."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from hrclog.events import AnnotationAdded, Event, TaskDispatched, TaskEnded, TaskFact
from hrclog.planning.plan import Plan, PlanItem
from hrclog.planning.problem import Count, Precedence, Problem, Task
from hrclog.planning.run_state import Replan
from hrclog.recorders.dispatch.dispatcher import Dispatcher
from hrclog.recorders.dispatch.policy import DispatchPolicy
from hrclog.recorders.dispatch.run_setup import RunSetup
from hrclog.recorders.executors.protocol import Executor
from hrclog.recorders.executors.scripted import ScriptedExecutor, ScriptStep
from hrclog.sim.event_queue import EventQueue

START_NS = 1_000_000_000_000


@dataclass(frozen=True)
class Played:
    """What came of a plan."""

    events: tuple[Event, ...]
    dispatcher: Dispatcher

    def story(self) -> list[tuple[object, ...]]:
        """Return second, kind, item and, where it has one, outcome or reason of every event."""
        return [
            (
                round((e.time_ns - START_NS) / 1e9, 3),
                e.kind,
                *_item(e),
                *([e.outcome] if isinstance(e, TaskEnded) else []),
            )
            for e in self.events
        ]

    def ends(self) -> list[TaskEnded]:
        """Return every end, in order."""
        return [event for event in self.events if isinstance(event, TaskEnded)]

    def dispatched_s(self) -> dict[str, float]:
        """Return when each item was first handed out, in seconds from the start."""
        first: dict[str, float] = {}
        for event in self.events:
            if isinstance(event, TaskDispatched):
                first.setdefault(event.item_id, (event.time_ns - START_NS) / 1e9)
        return first

    def notes(self) -> list[AnnotationAdded]:
        """Return every annotation, in order."""
        return [event for event in self.events if isinstance(event, AnnotationAdded)]


def problem_of(
    plan: Plan, precedences: Iterable[Precedence] = (), resources: Mapping[str, tuple[str, ...]] | None = None
) -> Problem:
    """Return a problem that a plan solves; `resources` are those of tasks by name."""
    used = resources or {}
    tasks: dict[str, list[str]] = {}
    for item in plan.items:
        tasks.setdefault(item.task, []).append(item.agent)
    return Problem(
        plan.agents(),
        tuple(
            Task(name, tuple(dict.fromkeys(agents)), f"type of {name}", resources=used.get(name, ()))
            for name, agents in tasks.items()
        ),
        tuple(
            Count(name, agents.count(agent), agent) for name, agents in tasks.items() for agent in dict.fromkeys(agents)
        ),
        tuple(precedences),
    )


def steps_of(plan: Plan, changes: Mapping[str, ScriptStep] | None = None) -> list[ScriptStep]:
    """Return a step for each item: a second of work, or what `changes` says by item; tasks must be items' own."""
    return [
        replace((changes or {}).get(item.item_id, ScriptStep(agent="", task="")), agent=item.agent, task=item.task)
        for item in plan.items
    ]


def play(
    plan: Plan,
    steps: Iterable[ScriptStep] | None = None,
    policy: DispatchPolicy | None = None,
    problem: Problem | None = None,
    executors: Mapping[str, Executor] | None = None,
    queue: EventQueue | None = None,
    replan: Replan | None = None,
    events: list[Event] | None = None,
) -> Played:
    """Carry a plan out in simulated time; each agent by a script of its own; what happens goes to `events`."""
    queue = queue or EventQueue(START_NS)
    events = [] if events is None else events
    script = steps_of(plan) if steps is None else list(steps)
    scripted = {
        agent: ScriptedExecutor([step for step in script if step.agent == agent], queue) for agent in plan.agents()
    }
    ids = itertools.count()
    dispatcher = Dispatcher(
        RunSetup(plan=plan, problem=problem or problem_of(plan), policy=policy or DispatchPolicy(), replan=replan),
        {**scripted, **(executors or {})},
        queue,
        run_id="run",
        emit=lambda event: events.append(replace(event, run_id="run", seq=len(events))),
        new_id=lambda: f"id{next(ids)}",
    )
    dispatcher.run()
    return Played(tuple(events), dispatcher)


def line(*items: str, **fields: object) -> Plan:
    """Return a plan of items `agent-task` or `agent-task<other,other`, each named by what stands before the `<`."""
    made = []
    for text in items:
        name, _, after = text.partition("<")
        agent, _, task = name.partition("-")
        made.append(PlanItem(name, agent, task, tuple(filter(None, after.split(",")))))
    return Plan("line", tuple(made), **fields)  # type: ignore[arg-type] - arrivals, if any


def _item(event: Event) -> tuple[str, ...]:
    return (event.item_id,) if isinstance(event, TaskFact) else ()
