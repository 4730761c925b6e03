"""What the start of a run tells of what is to come: its agents, its plan, and whether a simulation makes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import polars as pl

from hrclog.event_rows import readable_details
from hrclog.events import PlanChanged, RunStarted


@dataclass(frozen=True, slots=True)
class PlannedItem:
    """An item of a plan; an id that the plan does not give is ""."""

    item_id: str
    agent: str
    task: str


@dataclass(frozen=True, slots=True)
class RunStart:
    """What a run declares of itself.

    Attributes:
        agents: those that it names.
        plan: the items of the plan that it followed last, in order; none where the log tells no items.
        plan_name: "" where the log tells none.
        is_simulated: whether it says that an engine of the simulator makes its executions.
    """

    agents: tuple[str, ...] = ()
    plan: tuple[PlannedItem, ...] = ()
    plan_name: str = ""
    is_simulated: bool = False


_KINDS: Final = (RunStarted.kind, PlanChanged.kind)


def run_starts(events: pl.DataFrame) -> dict[str, RunStart]:
    """Return by run what its start tells: the plan that it followed last, and the agents of all its segments.

    Args:
        events: an events frame.
    """
    told = events.filter(pl.col("kind").is_in(_KINDS)).sort("run_id", "seq", maintain_order=True)
    starts: dict[str, RunStart] = {}
    for run, kind, details in told.select("run_id", "kind", "details").iter_rows():
        facts = readable_details(details)
        if run not in starts:
            starts[run] = _start(facts)
            continue
        known = starts[run]
        agents = _agents(facts) if kind == RunStarted.kind else ()
        together = tuple(dict.fromkeys((*known.agents, *agents))) if known.agents else ()
        starts[run] = replace(known, agents=together, plan=_items(facts.get("plan")) or known.plan)
    return starts


def _start(facts: Mapping[str, Any]) -> RunStart:
    software, plan = facts.get("software"), facts.get("plan")
    return RunStart(
        agents=_agents(facts),
        plan=_items(plan),
        plan_name=_text(plan.get("name") if isinstance(plan, dict) else plan),
        is_simulated=isinstance(software, dict) and bool(_text(software.get("engine"))),
    )


def _agents(facts: Mapping[str, Any]) -> tuple[str, ...]:
    agents = facts.get("agents")
    return tuple(filter(None, map(_text, agents))) if isinstance(agents, list) else ()


def _items(plan: object) -> tuple[PlannedItem, ...]:
    """Return the items of a plan in any form that logs have, none if one of them names no agent or no task."""
    values = plan.get("items") if isinstance(plan, dict) else plan
    items = [
        PlannedItem(_text(value.get("item_id")), _text(value.get("agent")), _text(value.get("task")))
        for value in (values if isinstance(values, list) else ())
        if isinstance(value, dict)
    ]
    is_whole = (
        isinstance(values, list) and len(items) == len(values) and all(item.agent and item.task for item in items)
    )
    return tuple(items) if is_whole else ()


def _text(value: object) -> str:
    return value if isinstance(value, str) else ""
