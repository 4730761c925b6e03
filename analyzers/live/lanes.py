"""The lanes of a run in progress, as changes since the last call.

An open execution has a beginning and no end, and a viewer draws it up to the end of the timeline, which is now. A
planned bar is sent only when its time has come, because a future bar would move the end of the timeline.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from heapq import heappop, heappush
from itertools import count
from typing import Any, Final

import polars as pl

from hrclog.analyzers.figures.gantt import Bar, Lane, LaneKind, execution_lanes, state_changes
from hrclog.analyzers.figures.palette import Color
from hrclog.analyzers.projections.schemas import INTERVALS

LaneKey = tuple[str, LaneKind, int]
"""Agent, kind and number of a lane."""

_ROUNDING_NS: Final = 1_000_000
_FOREVER: Final = 2**63 - 1
_SLICE: Final = 500
_ANCHOR: Final = {name: "" if kind == pl.String else 0 for name, kind in INTERVALS.items()}


@dataclass(slots=True)
class LaneNews:
    """What is new in a lane: states from instants on (ns since the run's first event), and all colours by state."""

    times_ns: list[int] = field(default_factory=list)
    states: list[str] = field(default_factory=list)
    colors: Mapping[str, Color] = field(default_factory=dict)


@dataclass(slots=True)
class _PlacedExecution:
    """The lane number of an execution, and the instants at which its states were sent."""

    number: int
    said: tuple[int, ...] = ()


class LiveLanes:
    """The lanes of one run.

    Args:
        origin_ns: becomes 0.
    """

    def __init__(self, origin_ns: int) -> None:
        self._origin_ns = origin_ns
        self._tasks: set[str] = set()
        self._open: dict[str, _PlacedExecution] = {}
        self._free_ns: dict[tuple[str, LaneKind], list[int]] = {}  # from when each lane of an agent is free
        self._colors: dict[LaneKey, dict[str, Color]] = {}
        self._planned: set[tuple[str, int, int, str]] = set()
        self._later: list[tuple[int, int, LaneKey, str, Color | None]] = []
        self._numbers = count()
        self._states: dict[LaneKey, dict[int, str]] = {}
        self._news: dict[LaneKey, LaneNews] = {}

    def keys(self) -> list[LaneKey]:
        """Return the lanes that there are."""
        return list(self._colors)

    def take_executions(
        self, executions: pl.DataFrame, pauses: Mapping[str, list[tuple[int, int, str]]], now_ns: int, *, alive: bool
    ) -> None:
        """Take in executions that began, changed or ended, and what was planned for them.

        Args:
            executions: schema `INTERVALS`.
            pauses: execution id -> (start_ns, end_ns, cause).
            now_ns: until when open executions have lasted.
            alive: whether open executions go on. If not, they are shown as still open, and end at `now_ns`.
        """
        self._tasks.update(executions["task"])
        is_open = pl.col("end_ns").is_null()
        until_ns = pl.max_horizontal(pl.lit(now_ns, pl.Int64), "start_ns")
        shown = executions.with_columns(
            # in the colours of success, until the outcome is known
            pl.when(is_open & alive).then(pl.lit("succeeded")).otherwise("outcome").alias("outcome"),
            pl.when(is_open & alive).then(until_ns).otherwise("end_ns").alias("end_ns"),
            pl.when(is_open).then(until_ns).otherwise("until_ns").alias("until_ns"),
        ).sort("agent", "start_ns", "until_ns", descending=[False, False, True])
        open_ones = set(executions.filter(is_open & alive)["execution_id"])
        for rows in shown.iter_slices(_SLICE):
            lanes = self._lanes_by_execution(rows, pauses)
            for row in rows.select("execution_id", "agent", "start_ns", "until_ns", "end_ns").iter_rows(named=True):
                self._place_execution(
                    row, lanes.get((row["execution_id"], "done"), ()), goes_on=row["execution_id"] in open_ones
                )
                for bar in lanes.get((row["execution_id"], "planned"), ()):
                    self._add_plan(row["agent"], bar)

    def take_safety(self, lanes: Iterable[Lane]) -> None:
        """Take in the safety states from the last known one on. Each holds until the next."""
        for lane in lanes:
            key: LaneKey = (lane.agent, lane.kind, lane.number)
            for bar in lane.bars:
                if self._states.get(key, {}).get(bar.start_ns) != bar.label:
                    self._add_state(key, bar.start_ns, bar.label, bar.color)

    def news(self, now_ns: int) -> dict[LaneKey, LaneNews]:
        """Return the changes up to an instant by lane, and forget them."""
        while self._later and self._later[0][0] <= now_ns - self._origin_ns:
            time_ns, _, key, state, color = heappop(self._later)
            self._add_state(key, time_ns, state, color)
        lane_news, self._news = self._news, {}
        for key, news in lane_news.items():
            news.colors = self._colors[key]
        return lane_news

    def finish(self, lanes: Iterable[Lane]) -> None:
        """Take in the final lanes. Differences are changes, and lanes that are not among them become empty."""
        lanes_by_key: dict[LaneKey, Lane] = {(lane.agent, lane.kind, lane.number): lane for lane in lanes}
        self._later.clear()
        for key in {**self._states, **lanes_by_key}:
            lane = lanes_by_key.get(key)
            states = dict(zip(*state_changes(lane), strict=True)) if lane is not None else {}
            colors = {bar.label: bar.color for bar in lane.bars} if lane is not None else {}
            self._colors.setdefault(key, {}).update(colors)
            self._correct(key, states, tuple(self._states.get(key, ())), colors)

    def _lanes_by_execution(
        self, rows: pl.DataFrame, pauses: Mapping[str, list[tuple[int, int, str]]]
    ) -> dict[tuple[str, LaneKind], tuple[Bar, ...]]:
        """Return the bars of each execution, drawn as if it were a separate agent."""
        # a row of every task, so that each keeps its colour
        anchors = pl.DataFrame([_ANCHOR | {"task": task} for task in sorted(self._tasks)], INTERVALS, orient="row")
        alone = pl.concat([rows.with_columns(pl.col("execution_id").alias("agent")), anchors])
        lanes = execution_lanes(alone, dict(pauses), self._origin_ns)
        return {(lane.agent, lane.kind): lane.bars for lane in lanes}

    def _place_execution(self, row: Mapping[str, Any], bars: Iterable[Bar], *, goes_on: bool) -> None:
        name, start_ns = row["execution_id"], row["start_ns"] - self._origin_ns
        until_ns = row["until_ns"] - self._origin_ns
        placed = self._open.get(name) or _PlacedExecution(self._free_lane(row["agent"], "done", start_ns))
        key: LaneKey = (row["agent"], "done", placed.number)
        self._free_ns[row["agent"], "done"][placed.number] = _FOREVER if goes_on else until_ns
        states = {bar.start_ns: bar.label for bar in bars if goes_on or bar.end_ns > bar.start_ns or placed.said}
        if states and not goes_on:
            states[until_ns] = ""
        self._correct(key, states, placed.said, {bar.label: bar.color for bar in bars})
        placed.said = tuple(states)
        if row["end_ns"] is None or goes_on:
            self._open[name] = placed
        else:
            self._open.pop(name, None)

    def _add_plan(self, agent: str, bar: Bar) -> None:
        if (agent, bar.start_ns, bar.end_ns, bar.label) in self._planned:  # every attempt repeats it
            return
        self._planned.add((agent, bar.start_ns, bar.end_ns, bar.label))
        number = self._free_lane(agent, "planned", bar.start_ns + _ROUNDING_NS)
        lanes = self._free_ns[agent, "planned"]
        start_ns = bar.start_ns if lanes[number] == -_FOREVER else max(bar.start_ns, lanes[number])
        lanes[number] = bar.end_ns
        if start_ns < bar.end_ns:
            key: LaneKey = (agent, "planned", number)
            heappush(self._later, (start_ns, next(self._numbers), key, bar.label, bar.color))
            heappush(self._later, (bar.end_ns, next(self._numbers), key, "", None))

    def _free_lane(self, agent: str, kind: LaneKind, start_ns: int) -> int:
        lanes = self._free_ns.setdefault((agent, kind), [])
        number = next((number for number, free_ns in enumerate(lanes) if free_ns <= start_ns), len(lanes))
        if number == len(lanes):
            lanes.append(-_FOREVER)
        return number

    def _correct(
        self, key: LaneKey, states: Mapping[int, str], old_times_ns: Iterable[int], colors: Mapping[str, Color]
    ) -> None:
        """Add new states, and correct the states that were sent at other instants."""
        old_states = self._states.get(key, {})
        starts = sorted(states)
        changes = {time_ns: state for time_ns, state in states.items() if old_states.get(time_ns) != state}
        for time_ns in old_times_ns:
            before = bisect_right(starts, time_ns)
            correct_state = states[starts[before - 1]] if before else ""
            if old_states[time_ns] != correct_state:
                changes[time_ns] = correct_state
        for time_ns, state in sorted(changes.items()):
            self._add_state(key, time_ns, state, colors.get(state))

    def _add_state(self, key: LaneKey, time_ns: int, state: str, color: Color | None) -> None:
        colors = self._colors.setdefault(key, {})
        if color is not None:
            colors[state] = color
        self._states.setdefault(key, {})[time_ns] = state
        news = self._news.setdefault(key, LaneNews())
        news.times_ns.append(time_ns)
        news.states.append(state)
