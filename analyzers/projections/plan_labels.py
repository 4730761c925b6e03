"""Which plan each run carried out, and what made it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import polars as pl

from hrclog.analyzers.projections.schemas import PLAN_LABELS
from hrclog.event_rows import readable_details
from hrclog.recipe_names import planner_and_session

CHANGED: Final = ", changed"
"""Ends the label of a run that came to follow another plan on the way."""

_SHORTEST: Final = 4  # characters of a digest
_LONGEST: Final = 64
_PLANNER_FIELDS: Final = ("planner", "method")


@dataclass(frozen=True, slots=True)
class _Plan:
    """What a log says of a plan: a digest that equal plans share, and a name, "" where it has none."""

    digest: str
    name: str


def plan_labels(events: pl.DataFrame) -> pl.DataFrame:
    """Name the plan and the planner of each run, as its first `run_started` tells them.

    Two plans in which each agent has the same tasks in the same order are one, whatever they are called. A label is the
    plan's name, the first by alphabet if it has several, and part of a digest where that is needed to tell plans apart.

    The planner is `planner` (or `method`) of the event or of its plan, else what the name of an imported recipe says.

    Args:
        events: an events frame.

    Returns:
        A frame of schema `PLAN_LABELS`.
    """
    started = events.filter(pl.col("kind") == "run_started").sort("run_id", "seq").unique("run_id", keep="first")
    facts = {run: readable_details(details) for run, details in started.select("run_id", "details").iter_rows()}
    plans = {run: _plan(facts[run].get("plan")) for run in facts}
    label_of = _labels(plan for plan in plans.values() if plan)
    changed = set(events.filter(pl.col("kind") == "plan_changed")["run_id"])
    rows = []
    for run in events["run_id"].unique().sort():
        plan = plans.get(run)
        label = label_of[plan.digest] if plan else ""
        rows.append((run, label + (CHANGED if label and run in changed else ""), _planner(facts.get(run, {}))))
    return pl.DataFrame(rows, schema=PLAN_LABELS, orient="row")


def _planner(facts: Mapping[str, Any]) -> str:
    plan = facts.get("plan")
    for source in (facts, plan if isinstance(plan, dict) else {}):
        for field in _PLANNER_FIELDS:
            if name := _text(source.get(field)):
                return name
    recipe = planner_and_session(_text(facts.get("name")))
    return recipe[0] if recipe else ""


def _plan(value: Any) -> _Plan | None:  # noqa: ANN401 - any JSON value
    """Return what a value says of a plan, None if nothing; a text is a name."""
    if not value:
        return None
    if isinstance(value, str):
        return _Plan(_digest(["name", value]), value)
    fields = value if isinstance(value, dict) else {"items": value}
    name = _text(fields.get("name"))
    orders = _orders(fields.get("items"))
    if orders:
        return _Plan(_digest(["orders", orders]), name)
    return _Plan(_digest(["name", name] if name else ["value", value]), name)


def _orders(items: Any) -> dict[str, list[str]] | None:  # noqa: ANN401 - any JSON value
    """Return the tasks of each agent in its order, None if an item has no agent or task."""
    orders: dict[str, list[str]] = {}
    for item in items if isinstance(items, list) else ():
        if not isinstance(item, dict) or not _text(item.get("agent")) or not _text(item.get("task")):
            return None
        orders.setdefault(item["agent"], []).append(item["task"])
    return orders


def _labels(plans: Iterable[_Plan]) -> dict[str, str]:
    """Return a label per digest, no two alike."""
    names: dict[str, str] = {}
    for plan in plans:
        names[plan.digest] = min(filter(None, (plan.name, names.get(plan.digest, ""))), default="")
    of_name: dict[str, int] = {}
    for name in names.values():
        of_name[name] = of_name.get(name, 0) + 1
    for length in range(_SHORTEST, _LONGEST + 1):
        labels = {
            digest: name if name and of_name[name] == 1 else f"{name or 'plan'} {digest[:length]}"
            for digest, name in names.items()
        }
        if len(set(labels.values())) == len(labels):
            break
    return labels


def _digest(value: Any) -> str:  # noqa: ANN401 - any JSON value
    text = json.dumps(value, sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def _text(value: Any) -> str:  # noqa: ANN401 - any JSON value
    return value if isinstance(value, str) else ""
