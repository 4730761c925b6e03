"""A run in progress: fold in its events, and return what is new for drawing.

The cost of a look depends on what is new and open, not on how long the run has lasted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import polars as pl

from hrclog.analyzers.figures import RunFigures, run_figures
from hrclog.analyzers.figures.events import EventLines, safety_lanes
from hrclog.analyzers.figures.gantt import Gantt, Lane
from hrclog.analyzers.figures.table import DataTable
from hrclog.analyzers.live.cell import LiveCell
from hrclog.analyzers.live.executions import LiveExecutions
from hrclog.analyzers.live.lanes import LaneKey, LaneNews, LiveLanes
from hrclog.analyzers.live.lines import LiveLines
from hrclog.analyzers.projections.runs import runs
from hrclog.analyzers.projections.schemas import INTERVALS
from hrclog.events import UNKNOWN_OUTCOME
from hrclog.log.checks import usable
from hrclog.log.messages.message import EVENTS
from hrclog.log.messages.recorded_scene import RecordedScene
from hrclog.log.messages.signals import SIGNAL_COLUMNS

LISTED: Final = 100
"""The most executions in the table of a run in progress."""

_KINDS: Final = {"done": 0, "planned": 1, "safety": 2}
_NO_LINES: Final = EventLines((), (), ())
_A_LINE: Final = EventLines((0,), ("",), ("INFO",))
_NO_LANES: Final = Gantt((), 0, 0)
_TASK_ORDER: Final = ("start_ns", "agent", "task", "execution_id")


@dataclass(frozen=True, slots=True, eq=False)
class LivePart:
    """The new parts of a run, for drawing.

    Attributes:
        figures: new events and samples, and facts and table as they are now; without lanes.
        lanes: the changes in the lanes.
        rows: the new or changed rows of the table, placed at their start.
        outline: all lanes and lines, empty; it determines the layout.
        now_ns: the present instant, since the run's first event.
    """

    figures: RunFigures
    lanes: Mapping[LaneKey, LaneNews]
    rows: DataTable
    outline: RunFigures
    now_ns: int


class LiveRun:
    """One run, folded from its events as they arrive.

    `figures` is what was drawn last.

    Args:
        events: the first events, at least one; schema `EVENTS`, made usable.
    """

    def __init__(self, events: pl.DataFrame) -> None:
        self.run_id = str(events["run_id"][0])
        self.origin_ns = int(events["time_ns"].min())  # type: ignore[arg-type]  # an int64 column
        self.latest_ns = self.origin_ns
        self.has_ended = False
        self._was_alive = True
        self._last_seq = -1
        self._first = events.head(1).with_columns(time_ns=pl.lit(self.origin_ns, pl.Int64))
        self._run: dict[str, Any] = runs(events, INTERVALS.to_frame()).row(0, named=True)
        self._executions = LiveExecutions()
        self._lanes = LiveLanes(self.origin_ns)
        self._lines = LiveLines(self.origin_ns)
        self._cell = LiveCell(self.run_id)
        self._safety = EVENTS.to_frame()  # the last state of each agent
        self._listed: dict[str, dict[str, Any]] = {}
        self._events: list[pl.DataFrame] = []
        self._signals: list[pl.DataFrame] = []
        self.figures = run_figures(self._run, INTERVALS.to_frame(), self._first, SIGNAL_COLUMNS.to_frame())
        self.take(events)

    @property
    def name(self) -> str:
        """Return the run's name."""
        return self.figures.name

    def take(
        self, events: pl.DataFrame, signals: pl.DataFrame | None = None, scene: RecordedScene | None = None
    ) -> None:
        """Take in what is new.

        Args:
            events: schema `EVENTS`, in the order of writing.
            signals: columns `SIGNAL_COLUMNS`.
            scene: what was recorded of the cell.
        """
        if events.height:
            events = usable(events).with_columns(pl.col("time_ns").clip(self.origin_ns))
            self._events.append(events)
            self._last_seq = max(self._last_seq, _highest(events["seq"], -1))
            self.has_ended |= bool((events["kind"] == "run_ended").any())
        if signals is not None and signals.height:
            self._signals.append(signals)
            self._lines.sampled(signals)
            self._cell.sampled(signals)
            self.latest_ns = max(self.latest_ns, _highest(signals["time_ns"], 0))
        if scene is not None:
            self._cell.take(scene)
        self.latest_ns = max(self.latest_ns, _highest(events["time_ns"], 0))

    def take_log(self, events: pl.DataFrame, signals: pl.DataFrame, scene: RecordedScene) -> None:
        """Take in the parts of a log that belong to the run and were not taken in yet."""
        new = events.filter((pl.col("run_id") == self.run_id) & (pl.col("seq") > self._last_seq))
        run_signals = signals.filter(pl.col("run_id") == self.run_id)
        self.take(new.sort("seq"), self._lines.unseen(run_signals), self._cell.unseen(scene))

    def part(self, now_ns: int, *, alive: bool) -> LivePart:
        """Return what is new since the last call.

        Args:
            now_ns: until when open executions have lasted, ns since the epoch.
            alive: whether the run goes on. If not, open executions are shown as left open, up to now.
        """
        events = pl.concat([EVENTS.to_frame(), *self._events])
        signals = pl.concat([SIGNAL_COLUMNS.to_frame(), *self._signals])
        self._events, self._signals = [], []
        safety = pl.concat([self._safety, events.filter(pl.col("kind") == "safety_state_changed")])
        if events.height or signals.height or self._cell.has_news or alive != self._was_alive:
            executions = self._executions.take(events)
            self._lanes.take_executions(executions, self._executions.pauses(now_ns), now_ns, alive=alive)
            self._lanes.take_safety(safety_lanes(safety, self.origin_ns, now_ns))
            earlier_events = pl.concat([self._first, self._safety])
            rows = self._draw(executions, earlier_events, events, signals, now_ns, alive=alive)
        else:  # only time has passed
            rows = replace(self.figures.tasks, frame=self.figures.tasks.frame.head(0))
            self.figures = replace(self.figures, series=(), events=_NO_LINES, cell=None)
        self._was_alive = alive
        lines = self._lines.news(self.figures.series, safety, self._executions, now_ns, alive=alive)
        self._safety = safety.unique("agent", keep="last", maintain_order=True)
        figures = replace(self.figures, series=lines)
        return LivePart(figures, self._lanes.news(now_ns), rows, self._outline(now_ns), now_ns - self.origin_ns)

    def last_part(self, figures: RunFigures) -> LivePart:
        """Return what is still to be drawn, now that the whole run is known.

        Args:
            figures: of the whole run.
        """
        self._lanes.finish(figures.gantt.lanes)
        now_ns = max(self.latest_ns - self.origin_ns, figures.gantt.end_ns)
        last_figures = replace(figures, gantt=_NO_LANES, series=(), events=_NO_LINES, cell=None)
        lanes = self._lanes.news(now_ns)
        lines = {(line.group, line.name): line for line in (*self._lines.outline(), *figures.series)}
        outline = replace(figures, series=tuple(lines.values()), cell=self._cell.outline(None))
        return LivePart(last_figures, lanes, replace(figures.tasks, frame=figures.tasks.frame.head(0)), outline, now_ns)

    def _draw(
        self,
        executions: pl.DataFrame,
        earlier_events: pl.DataFrame,
        events: pl.DataFrame,
        signals: pl.DataFrame,
        now_ns: int,
        *,
        alive: bool,
    ) -> DataTable:
        """Draw what is new, and return the new rows of the table."""
        outcome = "running" if alive else "unfinished"
        is_running = (pl.col("outcome") == UNKNOWN_OUTCOME) & pl.col("end_ns").is_null()
        executions = executions.sort(_TASK_ORDER).with_columns(
            pl.when(is_running).then(pl.lit(outcome)).otherwise("outcome").alias("outcome")
        )
        samples = signals if signals.is_empty() else self._cell.samples(signals)
        scene = self._cell.scene() if events.height or signals.height or self._cell.has_news else None
        figures = run_figures(
            self._facts(now_ns, outcome), executions, pl.concat([earlier_events, events]), samples, scene
        )
        lines = figures.events
        new = slice(earlier_events.height, None)
        self.figures = replace(
            figures,
            gantt=_NO_LANES,
            events=EventLines(lines.times_ns[new], lines.texts[new], lines.levels[new]),
            tasks=self._table(executions["execution_id"].to_list(), figures.tasks.frame),
            captions=(),
        )
        return figures.tasks

    def _facts(self, now_ns: int, outcome: str) -> dict[str, Any]:
        executions = self._executions
        return self._run | {
            "agents": sorted({*self._run["agents"], *executions.agents()}),
            "end_ns": now_ns,
            "makespan_s": None if executions.first_ns is None else (now_ns - executions.first_ns) / 1e9,
            "n_executions": executions.n_started,
            "n_failed": executions.n_failed,
            "n_open": executions.open.height,
            "outcome": outcome,
        }

    def _table(self, names: list[str], rows: pl.DataFrame) -> DataTable:
        """Return the table of the latest executions, after an update with the new or changed rows."""
        for name, row in zip(names, rows.iter_rows(named=True), strict=True):
            self._listed[name] = row
        while len(self._listed) > LISTED:
            del self._listed[next(iter(self._listed))]
        frame = pl.DataFrame(list(reversed(self._listed.values())), schema=rows.schema, orient="row")
        n_started = self._executions.n_started
        caption = f"The last {LISTED} of {n_started:,}." if n_started > LISTED else ""
        return DataTable("tasks", "Executions, the last one first", frame, caption)

    def _outline(self, now_ns: int) -> RunFigures:
        keys = sorted(self._lanes.keys(), key=lambda key: (key[0], _KINDS[key[1]], key[2]))
        lanes = tuple(Lane(agent, kind, number, ()) for agent, kind, number in keys)
        return replace(
            self.figures,
            gantt=Gantt(lanes, 0, now_ns - self.origin_ns),
            series=self._lines.outline(),
            events=_A_LINE,
            cell=self._cell.outline(self.figures.cell),
        )


def _highest(numbers: pl.Series, least: int) -> int:
    highest = numbers.max()
    return least if highest is None else max(least, int(highest))  # type: ignore[arg-type]  # an int64 column
