"""The executions of a run in progress, folded from its events as they arrive.

Events of ended executions are forgotten, because an ended execution does not change.
"""

from __future__ import annotations

from typing import Final

import polars as pl

from hrclog.analyzers.figures.events import pauses
from hrclog.analyzers.figures.series import Series, overlaps_so_far
from hrclog.analyzers.projections.intervals import rebuild, top_level
from hrclog.analyzers.projections.schemas import INTERVALS
from hrclog.events import TASK_KINDS, Outcome
from hrclog.log.messages.message import EVENTS

_SPAN: Final = ("agent", "start_ns", "until_ns")
_FAILED: Final = (Outcome.FAILED.value, Outcome.TIMED_OUT.value)


class LiveExecutions:
    """The executions of one run; instants are ns since the epoch."""

    def __init__(self) -> None:
        self.n_failed = 0
        self.first_ns: int | None = None
        self.open = INTERVALS.to_frame()
        self._events = EVENTS.to_frame()  # of executions that had not ended before
        self._ended: set[str] = set()
        self._spans = INTERVALS.to_frame().select(_SPAN)  # of executions that have
        self._n_ended = 0

    @property
    def n_started(self) -> int:
        """Return how many executions have started, without those that are steps of another."""
        return self._n_ended + self.open.filter(top_level()).height

    def agents(self) -> set[str]:
        """Return the agents that have started an execution."""
        return {*self._spans["agent"].unique(), *self.open["agent"]}

    def take(self, events: pl.DataFrame) -> pl.DataFrame:
        """Take in further events, schema `EVENTS`.

        Returns:
            Schema `INTERVALS`: the open executions, and those that have just ended.
        """
        self._events = pl.concat([self._events, events.filter(pl.col("kind").is_in(TASK_KINDS))])
        is_over = pl.Series([name in self._ended for name in self._events["execution_id"]], dtype=pl.Boolean)
        self._events = self._events.filter(~is_over)
        executions, _ = rebuild(self._events)
        has_ended = pl.col("end_ns").is_not_null()
        ended, self.open = executions.filter(has_ended), executions.filter(~has_ended)
        self._ended.update(self._events.filter(pl.col("kind") == "task_ended")["execution_id"])
        self._spans = pl.concat([self._spans, ended.select(_SPAN)])
        top_executions = ended.filter(top_level())
        self._n_ended += top_executions.height
        if self.first_ns is None and executions.height:
            self.first_ns = int(executions["start_ns"].min())  # type: ignore[arg-type]  # an int64 column
        self.n_failed += int(top_executions["outcome"].is_in(_FAILED).sum())
        return executions

    def pauses(self, until_ns: int) -> dict[str, list[tuple[int, int, str]]]:
        """Return execution id -> pauses (start_ns, end_ns, cause) of the executions that `take` returned last."""
        return pauses(self._events, until_ns)

    def overlaps(self, origin_ns: int, until_ns: int) -> list[Series]:
        """Return the seconds that each pair of agents has worked at the same time; open executions last until now."""
        until = pl.max_horizontal("start_ns", pl.lit(until_ns, pl.Int64)).alias("until_ns")
        return overlaps_so_far(pl.concat([self._spans, self.open.select("agent", "start_ns", until)]), origin_ns)[0]
