"""Lanes of bars over the time of a run: what each agent did, what was planned, and its safety states."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import polars as pl

from hrclog.analyzers.figures.lanes import lane_numbers
from hrclog.analyzers.figures.palette import FAILED, MUTED, OPEN, PAUSED, Color, blend, task_colors
from hrclog.analyzers.figures.text import shorten
from hrclog.wording import counted

MAX_LANES: Final = 48
LABEL_WIDTH: Final = 40
_ROUNDING_NS: Final = 1_000_000

LaneKind = Literal["done", "planned", "safety"]

_COLUMNS: Final = (
    "agent",
    "task",
    "execution_id",
    "attempt",
    "start_ns",
    "end_ns",
    "until_ns",
    "outcome",
    "reason",
    "planned_start_ns",
    "planned_end_ns",
)
_MARKS: Final = {"failed": "✗ ", "timed_out": "✗ ", "canceled": "- ", "skipped": "- "}


@dataclass(frozen=True, slots=True)
class Bar:
    """A half-open span [start_ns, end_ns) since the first event of the run, with a label and a colour."""

    start_ns: int
    end_ns: int
    label: str
    color: Color


@dataclass(frozen=True, slots=True)
class Lane:
    """Bars of one agent that do not overlap; `number` is above 0 if the agent does several things at once."""

    agent: str
    kind: LaneKind
    number: int
    bars: tuple[Bar, ...]


@dataclass(frozen=True, slots=True)
class Gantt:
    """The lanes of one run, agents in order, from `start_ns` to `end_ns`; tasks with their colours, sorted by name."""

    lanes: tuple[Lane, ...]
    start_ns: int
    end_ns: int
    tasks: tuple[tuple[str, Color], ...] = ()


def execution_lanes(
    intervals: pl.DataFrame,
    pauses: dict[str, list[tuple[int, int, str]]],
    origin_ns: int,
    tasks: Collection[str] = (),
) -> list[Lane]:
    """Return the lanes of executions and plans. Failures, pauses, retries and open ends differ in label and colour.

    Args:
        intervals: the executions of one run, schema `INTERVALS`.
        pauses: execution id -> (start_ns, end_ns, cause), see `events.pauses`.
        origin_ns: becomes 0.
        tasks: further tasks that get colours, so that several runs share the same colours.
    """
    rows = intervals.select(_COLUMNS).rows(named=True)
    rows.sort(key=lambda row: (row["agent"], row["start_ns"], -row["until_ns"]))  # a sequence goes before its steps
    colors = task_colors([*(row["task"] for row in rows), *tasks])
    lanes: list[Lane] = []
    for agent in dict.fromkeys(row["agent"] for row in rows):
        agent_rows = [row for row in rows if row["agent"] == agent]
        bars = [_execution_bars(row, colors, pauses.get(row["execution_id"], ()), origin_ns) for row in agent_rows]
        lanes += _lanes(agent, "done", [(row["start_ns"], row["until_ns"]) for row in agent_rows], bars)
        lanes += _planned_lanes(agent, agent_rows, colors, origin_ns)
    return lanes


def limited(lanes: Sequence[Lane], max_lanes: int = MAX_LANES) -> tuple[tuple[Lane, ...], tuple[str, ...]]:
    """Return at most `max_lanes` lanes, and captions about what is not visible."""
    captions = []
    if len(lanes) > max_lanes:
        captions.append(f"The first {max_lanes} of {len(lanes)} lanes are drawn.")
    drawn_lanes = tuple(lanes[:max_lanes])
    instants = sum(bar.start_ns >= bar.end_ns for lane in drawn_lanes for bar in lane.bars)
    if instants:
        which = counted(instants, "execution without length is", "executions without length are")
        captions.append(f"{which} listed in the tables, with no bar to see.")
    return drawn_lanes, tuple(captions)


def legend(intervals: pl.DataFrame, tasks: Collection[str] = ()) -> tuple[tuple[str, Color], ...]:
    """Return the tasks of a run with the colours of their bars, sorted by name; `tasks` as for `execution_lanes`."""
    run_tasks = set(intervals["task"])
    colors = task_colors([*run_tasks, *tasks])
    return tuple((shorten(task, LABEL_WIDTH), color) for task, color in colors.items() if task in run_tasks)


def state_changes(lane: Lane) -> tuple[list[int], list[str]]:
    """Return (instants, states) of a lane: its label at each start, "" at each end.

    An end comes before a start at the same instant, else two equal neighbours would look like one bar. Bars without
    length are left out.
    """
    instants: list[int] = []
    states: list[str] = []
    for bar in lane.bars:
        if bar.end_ns > bar.start_ns:
            instants += (bar.start_ns, bar.end_ns)
            states += (bar.label, "")
    return instants, states


def _execution_bars(
    row: dict[str, Any], colors: dict[str, Color], pauses: Iterable[tuple[int, int, str]], origin_ns: int
) -> list[Bar]:
    name = shorten(row["task"], LABEL_WIDTH)
    mark, ending, color = _MARKS.get(row["outcome"], ""), "", colors[row["task"]]
    retry = f"#{row['attempt']} " if (row["attempt"] or 0) > 1 else ""
    if row["outcome"] in ("failed", "timed_out"):
        color, ending = FAILED, f" {row['outcome'].replace('_', ' ')}"
    elif mark:
        color, ending = blend(color, MUTED, 0.7), f" {row['outcome']}"
    elif row["end_ns"] is None:
        color, ending = blend(color, OPEN, 0.5), " still open"
    label = f"{mark}{retry}{name}{ending}"
    bars, at = [], row["start_ns"]
    for paused, resumed, cause in pauses:
        start, end = max(paused, at), min(resumed, row["until_ns"])
        if start < end:
            bars.append(Bar(at - origin_ns, start - origin_ns, label, color))
            bars.append(
                Bar(start - origin_ns, end - origin_ns, f"|| {name} paused{f': {cause}' if cause else ''}", PAUSED)
            )
            at = end
    bars.append(Bar(at - origin_ns, row["until_ns"] - origin_ns, label, color))
    return [bar for bar in bars if bar.start_ns < bar.end_ns] or bars[:1]


def _planned_lanes(agent: str, rows: Sequence[dict[str, Any]], colors: dict[str, Color], origin_ns: int) -> list[Lane]:
    planned = {  # every attempt repeats the plan of its item
        (row["planned_start_ns"], row["planned_end_ns"], row["task"])
        for row in rows
        if row["planned_start_ns"] is not None and row["planned_end_ns"] is not None
    }
    spans = _clip_rounding(sorted(span for span in planned if span[0] <= span[1]))
    bars = [
        [Bar(start - origin_ns, end - origin_ns, shorten(task, LABEL_WIDTH), blend(colors[task], MUTED, 0.55))]
        for start, end, task in spans
    ]
    return _lanes(agent, "planned", [span[:2] for span in spans], bars)


def _clip_rounding(spans: list[tuple[int, int, str]]) -> list[tuple[int, int, str]]:
    """Return the spans without overlaps caused by rounding alone, so that they share a lane."""
    starts = [span[0] for span in spans[1:]]
    return [
        (start, following if 0 <= end - following <= _ROUNDING_NS and following >= start else end, task)
        for (start, end, task), following in zip(spans, [*starts, spans[-1][1]] if spans else (), strict=True)
    ]


def _lanes(agent: str, kind: LaneKind, spans: Sequence[tuple[int, int]], bars: Sequence[Sequence[Bar]]) -> list[Lane]:
    rows: dict[int, list[Bar]] = {}
    for number, group in zip(lane_numbers(spans), bars, strict=True):
        rows.setdefault(number, []).extend(group)
    return [Lane(agent, kind, number, tuple(rows[number])) for number in sorted(rows)]
