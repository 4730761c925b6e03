"""What `hrclog run` prints of runs: items, makespan against what the plan promised, and what went wrong."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from hrclog.analyzers.projections.mean_interval import mean_interval
from hrclog.cli.common import EXIT_DATA_LOST, EXIT_FINE
from hrclog.cli.run_plan import Done
from hrclog.events import TaskEnded, TaskFact, TaskStarted
from hrclog.planning.plan import Plan
from hrclog.units import NS_PER_S
from hrclog.wording import counted, share

INTERRUPTED: Final = 130
"""Exit code of a run that somebody ended."""

_SUCCEEDED: Final = "succeeded"


def exit_code(done: Done) -> int:
    """Return the exit code for a run."""
    if done.outcome == _SUCCEEDED:
        return EXIT_FINE
    return INTERRUPTED if done.outcome == "canceled" else EXIT_DATA_LOST


def run_text(done: Done) -> list[str]:
    """Return the printed lines for a single run."""
    outcomes = list(_outcomes(done).values())
    succeeded = share(outcomes.count(_SUCCEEDED), len(outcomes), "item")
    return [
        f"{done.followed.name}: {succeeded} succeeded, log in {done.path}",
        f"makespan {_beside_plan(_makespan_text(done), done.plan, done.mode)}",
        f"Look at it: hrclog view {done.path}",
    ]


def run_json(done: Done) -> dict[str, Any]:
    """Return the JSON output for a single run."""
    ends, outcomes = _last_ends(done), _outcomes(done)
    items = {
        item.item_id: {
            "agent": item.agent,
            "task": item.task,
            "outcome": outcomes[item.item_id] or None,
            "reason": ends[item.item_id].reason if item.item_id in ends else "",
            "attempts": ends[item.item_id].attempt if item.item_id in ends else 0,
        }
        for item in done.followed.items
    }
    return {
        "path": str(done.path),
        "outcome": done.outcome,
        "reason": done.reason,
        "makespan_s": makespan_s(done),
        **_expected_json(done.plan),
        "items": items,
    }


def plan_text(plan: Plan, runs: Sequence[Done]) -> str:
    """Return the line of a plan that was executed several times, or among others."""
    mean, low, high, count = _mean_makespan(runs)
    failed = f", {len(runs) - count} of {len(runs)} did not succeed" if count < len(runs) else ""
    head = f"{plan.name}: {counted(len(runs), 'run')}{failed}"
    if mean is None:
        return head
    interval = "" if low is None else f" [{low:.1f}, {high:.1f}]"
    return f"{head}, mean makespan {_beside_plan(f'{mean:.1f} s{interval}', plan, runs[0].mode)}"


def plan_json(plan: Plan, runs: Sequence[Done]) -> dict[str, Any]:
    """Return the JSON output for a plan that was executed several times, or among others."""
    mean, low, high, count = _mean_makespan(runs)
    return {
        "plan": plan.name,
        "mean_makespan_s": mean,
        "mean_low_s": low,
        "mean_high_s": high,
        "n_succeeded": count,
        **_expected_json(plan),
        "runs": [
            {
                "path": str(done.path),
                "outcome": done.outcome,
                "reason": done.reason,
                "makespan_s": makespan_s(done),
            }
            for done in runs
        ],
    }


def troubles(done: Done) -> Iterator[str]:
    """Yield a line for each item that did not succeed, and one for the run."""
    ends, outcomes = _last_ends(done), _outcomes(done)
    for item in done.followed.items:
        if outcomes[item.item_id] != _SUCCEEDED:
            reason = f": {ends[item.item_id].reason}" if item.item_id in ends and ends[item.item_id].reason else ""
            yield f"{item.item_id} ({item.task}) {outcomes[item.item_id] or 'not begun'}{reason}"
    if done.outcome != _SUCCEEDED:
        yield f"the run {done.outcome}: {done.reason}"


def makespan_s(done: Done) -> float | None:
    """Return the time from the first start of an item to the last end in seconds; None where nothing was begun."""
    task_events = [event for event in done.events if isinstance(event, TaskFact) and not event.parent_execution_id]
    starts = {event.execution_id: event.time_ns for event in task_events if isinstance(event, TaskStarted)}
    ends = [event.time_ns for event in task_events if isinstance(event, TaskEnded) and event.execution_id in starts]
    return (max(ends) - min(starts.values())) / NS_PER_S if ends else None


def _makespan_text(done: Done) -> str:
    took_s = makespan_s(done)
    return "n/a" if took_s is None else f"{took_s:.1f} s"


def _beside_plan(makespan: str, plan: Plan, mode: str) -> str:
    """Return a makespan next to the expected or planned one."""
    expected, planned_s = plan.expected, _planned_s(plan)
    if expected is not None:
        spread = f"[{expected.run_low_s:.1f}, {expected.run_high_s:.1f}]"
        drawn = f"90 % of {expected.worlds} single runs drawn"
        other = "" if expected.mode in ("", mode) else f" in mode {expected.mode}"
        return f"{makespan}; expected {expected.mean_s:.1f} {spread} ({drawn}{other})"
    return makespan if planned_s is None else f"{makespan}; planned {planned_s:.1f} (undisturbed)"


def _expected_json(plan: Plan) -> dict[str, Any]:
    return {"expected": plan.expected.to_json() if plan.expected else None, "planned_s": _planned_s(plan)}


def _planned_s(plan: Plan) -> float | None:
    """Return the planned time from the first start to the last end in seconds."""
    starts = [item.planned_start_s for item in plan.items if item.planned_start_s is not None]
    ends = [item.planned_end_s for item in plan.items if item.planned_end_s is not None]
    return max(ends) - min(starts) if starts and ends else None


def _mean_makespan(runs: Sequence[Done]) -> tuple[float | None, float | None, float | None, int]:
    """Return the mean makespan of the runs that succeeded, its 95 % interval, and how many they are."""
    took_s = [makespan_s(done) for done in runs if done.outcome == _SUCCEEDED]
    known_s = [seconds for seconds in took_s if seconds is not None]
    if not known_s:
        return None, None, None, 0
    return (*mean_interval(np.array(known_s)), len(known_s))


def _outcomes(done: Done) -> dict[str, str]:
    ends = _last_ends(done)
    return {item.item_id: ends[item.item_id].outcome if item.item_id in ends else "" for item in done.followed.items}


def _last_ends(done: Done) -> dict[str, TaskEnded]:
    """Return how each item ended in its last attempt."""
    return {event.item_id: event for event in done.events if isinstance(event, TaskEnded)}
