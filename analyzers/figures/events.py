"""What the flat events of a run add to its picture: pauses, safety states, and a readable log."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import polars as pl

from hrclog.analyzers.figures.gantt import Bar, Lane
from hrclog.analyzers.figures.palette import FAILED, FULL_SPEED, REDUCED, Color
from hrclog.analyzers.figures.text import printable, shorten

MAX_LINES: Final = 20_000

_LEVELS: Final = {
    "task_paused": "WARN",
    "command_rejected": "WARN",
    "safety_state_changed": "WARN",
    "plan_changed": "WARN",
    "annotation_added": "WARN",
    "heartbeat": "DEBUG",
}
_BAD: Final = {"failed": "ERROR", "timed_out": "ERROR", "canceled": "WARN", "skipped": "WARN"}
_LINE: Final = ("kind", "agent", "task", "outcome", "reason", "cause", "mode", "zone", "speed_scale")


@dataclass(frozen=True, slots=True)
class EventLines:
    """A log: instants in ns since the first event, texts and levels (INFO, WARN, ERROR, DEBUG)."""

    times_ns: tuple[int, ...]
    texts: tuple[str, ...]
    levels: tuple[str, ...]
    captions: tuple[str, ...] = ()


def event_lines(events: pl.DataFrame, origin_ns: int, max_lines: int = MAX_LINES) -> EventLines:
    """Return one line per event of a run, at most `max_lines`."""
    rows = events.select("time_ns", *_LINE).head(max_lines).rows()
    left_out = f"The log lists the first {max_lines:,} of {events.height:,} events."
    return EventLines(
        tuple(row[0] - origin_ns for row in rows),
        tuple(_text(*row[1:]) for row in rows),
        tuple(_BAD.get(row[4], _LEVELS.get(row[1], "INFO")) for row in rows),
        (left_out,) if events.height > max_lines else (),
    )


def pauses(events: pl.DataFrame, end_ns: int) -> dict[str, list[tuple[int, int, str]]]:
    """Return execution id -> pauses (start_ns, end_ns, cause) in order. A pause without an end lasts until `end_ns`."""
    pauses_by_execution: dict[str, list[tuple[int, int, str]]] = {}
    open_pauses: dict[str, tuple[int, str]] = {}
    turns = events.filter(pl.col("kind").is_in(("task_paused", "task_resumed", "task_ended")))
    for execution, kind, time_ns, cause in turns.select("execution_id", "kind", "time_ns", "cause").rows():
        if kind == "task_paused":
            open_pauses.setdefault(execution, (time_ns, cause))
        elif execution in open_pauses:
            start, cause_text = open_pauses.pop(execution)
            pauses_by_execution.setdefault(execution, []).append((start, time_ns, cause_text))
    for execution, (start, cause_text) in open_pauses.items():
        pauses_by_execution.setdefault(execution, []).append((start, end_ns, cause_text))
    return pauses_by_execution


def safety_lanes(events: pl.DataFrame, origin_ns: int, end_ns: int) -> list[Lane]:
    """Return a lane per agent that has safety states. Each state lasts until the next one, the last until `end_ns`."""
    rows = events.filter(pl.col("kind") == "safety_state_changed")
    lanes = []
    for (agent,), agent_rows in rows.group_by("agent", maintain_order=True):
        times = agent_rows["time_ns"].to_list()
        states = agent_rows.select("mode", "zone", "speed_scale").rows()
        bars = [
            Bar(start - origin_ns, end - origin_ns, _safety_label(mode, zone, scale), _safety_color(mode, scale))
            for start, end, (mode, zone, scale) in zip(times, [*times[1:], max(end_ns, times[-1])], states, strict=True)
        ]
        lanes.append(Lane(str(agent), "safety", 0, tuple(bars)))
    return lanes


def _safety_label(mode: str, zone: str, scale: float | None) -> str:
    parts = [mode.replace("_", " "), f"{scale:.0%} speed" if scale is not None else "", f"zone {zone}" if zone else ""]
    return shorten(", ".join(part for part in parts if part) or "unknown", 48)


def _safety_color(mode: str, scale: float | None) -> Color:
    if scale is None:
        return FAILED if "stop" in mode else REDUCED
    return FAILED if scale <= 0.1 else REDUCED if scale < 1 else FULL_SPEED


def _text(
    kind: str, agent: str, task: str, outcome: str, reason: str, cause: str, mode: str, zone: str, scale: float | None
) -> str:
    subject = " ".join(part for part in (agent, task) if part)
    details = [
        outcome,
        cause,
        mode,
        f"zone {zone}" if zone else "",
        f"speed {scale:g}" if scale is not None else "",
        reason,
    ]
    detail_text = ", ".join(part for part in details if part)
    return printable(
        f"{kind.replace('_', ' ')}{': ' if subject else ''}{subject}{f' ({detail_text})' if detail_text else ''}"
    )
