"""What estimators learn from: per execution its duration and how long it spent beside which tasks of the others.

Rows belong to one run each and depend on nothing outside it. So runs can be computed anywhere, put together in any
order, withdrawn, or drawn with repetition, and what is estimated from them is the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from hrclog.analyzers.projections.crowded import without_crowded
from hrclog.analyzers.projections.intervals import is_learnt
from hrclog.analyzers.projections.joint_states import State, segments
from hrclog.analyzers.synergy.pairs import in_seconds, is_finished, overlapping_pairs
from hrclog.arrays import IntArray
from hrclog.errors import HrclogError

EXECUTIONS: Final = pl.Schema(
    {
        "run_id": pl.String(),
        "agent": pl.String(),
        "task": pl.String(),
        "execution_id": pl.String(),
        "duration_s": pl.Float64(),
        "finished": pl.Boolean(),  # it succeeded: the others are censored, they would have taken longer
        "state": pl.List(pl.Int64()),  # numbers of the joint states of the other agents it met
        "seconds": pl.List(pl.Float64()),  # spent in each of them
        "last_state": pl.Int64(),  # the one just before its end; null where it has no length
    }
)
"""One row per execution that counts, ordered by (run_id, agent, task, execution_id)."""

_SORT: Final = ("run_id", "agent", "task", "execution_id")
_PAIR_SORT: Final = ("run_id", "execution_id", "other_agent", "other_task", "other_execution_id")


@dataclass(frozen=True, slots=True)
class Observations:
    """Runs to learn from.

    Attributes:
        executions: schema `EXECUTIONS`.
        states: what the numbers in it stand for, sorted.
        meetings: the ordered pairs of executions that overlap, as `overlapping_pairs` returns them.
    """

    executions: pl.DataFrame
    states: tuple[State, ...]
    meetings: pl.DataFrame

    @property
    def pairs(self) -> pl.DataFrame:
        """Return the meetings of executions that succeeded, with whatever the other agent did meanwhile."""
        return self.meetings.filter("finished")

    @property
    def runs(self) -> list[str]:
        """Return the ids of the runs, sorted."""
        return self.executions["run_id"].unique().sort().to_list()

    def only(self, runs: Iterable[str]) -> Observations:
        """Return the observations of some of the runs."""
        kept = pl.col("run_id").is_in(list(runs))
        return Observations(self.executions.filter(kept), self.states, self.meetings.filter(kept))

    def without(self, runs: Iterable[str]) -> Observations:
        """Return the observations with some runs withdrawn."""
        kept = ~pl.col("run_id").is_in(list(runs))
        return Observations(self.executions.filter(kept), self.states, self.meetings.filter(kept))

    def drawn(self, runs: Sequence[str]) -> Observations:
        """Return the observations of these runs, one that is named twice as two runs."""
        names = pl.DataFrame({"run_id": list(runs)}, schema={"run_id": pl.String}).with_row_index("draw")
        return Observations(_draw_runs(self.executions, names), self.states, _draw_runs(self.meetings, names))


def observe(intervals: pl.DataFrame) -> Observations:
    """Collect what can be learnt from runs; crowded ones are left out.

    Args:
        intervals: a frame of schema `INTERVALS`.
    """
    intervals = without_crowded(intervals)
    rows = intervals.filter(is_learnt()).sort(_SORT)
    cut = segments(rows, intervals)
    lengths = (cut.end_ns - cut.start_ns) / 1e9
    state_seconds = (
        pl.DataFrame({"row": cut.row, "state": cut.state, "seconds": lengths})
        .group_by("row", "state")
        .agg(pl.col("seconds").sort().sum())
        .sort("row", "state")
        .group_by("row", maintain_order=True)
        .agg("state", "seconds")
    )
    last = pl.DataFrame({"row": cut.row, "last_state": cut.state}).group_by("row").agg(pl.col("last_state").last())
    executions = (
        rows.with_columns(
            in_seconds(pl.col("until_ns") - pl.col("start_ns")).alias("duration_s"), is_finished().alias("finished")
        )
        .with_row_index("row")
        .with_columns(pl.col("row").cast(pl.Int64))
        .join(state_seconds, on="row", how="left", maintain_order="left")
        .join(last, on="row", how="left", maintain_order="left")
        .select(EXECUTIONS.names())
        .cast(EXECUTIONS)
    )
    return Observations(executions, cut.states, overlapping_pairs(intervals).sort(_PAIR_SORT))


def merge(parts: Sequence[Observations]) -> Observations:
    """Put runs together; the result does not depend on the order of the parts.

    Raises:
        HrclogError: two parts hold the same run.
    """
    if not parts:
        raise HrclogError("there are no observations to put together, expected at least one part")
    runs = [run for part in parts for run in part.runs]
    if len(set(runs)) < len(runs):
        twice = sorted({run for run in runs if runs.count(run) > 1})
        raise HrclogError(f"run {twice[0]!r} is in two parts, expected each run once; withdraw it from one of them")
    states = tuple(sorted({state for part in parts for state in part.states}))
    number = {state: index for index, state in enumerate(states)}
    executions = pl.concat(
        [
            _renumber_states(part.executions, np.array([number[state] for state in part.states], np.int64))
            for part in parts
        ]
    )
    return Observations(executions.sort(_SORT), states, pl.concat([part.meetings for part in parts]).sort(_PAIR_SORT))


def _renumber_states(executions: pl.DataFrame, number: IntArray) -> pl.DataFrame:
    old_numbers = pl.Series(range(len(number)), dtype=pl.Int64)
    new_numbers = pl.Series(number, dtype=pl.Int64)
    return executions.with_columns(
        pl.col("state").list.eval(pl.element().replace_strict(old_numbers, new_numbers, return_dtype=pl.Int64)),
        pl.col("last_state").replace_strict(old_numbers, new_numbers, return_dtype=pl.Int64),
    )


def _draw_runs(frame: pl.DataFrame, names: pl.DataFrame) -> pl.DataFrame:
    repeated = names.join(frame, on="run_id", how="inner", maintain_order="left_right")
    name = pl.col("draw").cast(pl.String).str.zfill(9) + ":" + pl.col("run_id")
    return repeated.with_columns(name.alias("run_id")).select(frame.columns)
