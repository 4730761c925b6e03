"""Executions whose times run backwards, though their events were written in a legal order: a clock was put back."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, Final

import polars as pl

from hrclog.diagnostic import Diagnostic
from hrclog.event_rows import from_row
from hrclog.events import UNKNOWN_OUTCOME, TaskFact
from hrclog.state import PLANNED, apply

_KEY: Final = ("run_id", "execution_id")


def task_fact(row: dict[str, Any]) -> TaskFact:
    """Return the event of a row whose kind is one of `TASK_KINDS`, without its details."""
    event = from_row(row | {"details": ""})  # the state machine asks nothing of them
    assert isinstance(event, TaskFact)  # noqa: S101 - see above
    return event


def turned_back(task_events: pl.DataFrame) -> pl.DataFrame:
    """Return the keys of executions that are legal in the order of `seq`, and not in that of time.

    Args:
        task_events: task events in the order of time.
    """
    doubtful = task_events.filter((pl.col("seq").diff() < 0).any().over(_KEY))
    parts = doubtful.partition_by(_KEY, as_dict=True)
    keys = [key for key, part in parts.items() if not _is_legal(part) and _is_legal(part.sort("seq"))]
    return pl.DataFrame(keys, schema=dict.fromkeys(_KEY, pl.String), orient="row")


def _is_legal(task_events: pl.DataFrame) -> bool:
    state = PLANNED
    for row in task_events.iter_rows(named=True):
        state, problem = apply(state, task_fact(row))
        if problem:
            return False
    return True


def step_diagnostics(task_events: pl.DataFrame) -> list[Diagnostic]:
    """Return a diagnostic per execution that `turned_back` names.

    Args:
        task_events: their events, in the order of `seq`.
    """
    return [_step_diagnostic(part.rows(named=True)) for part in task_events.partition_by(_KEY, maintain_order=True)]


def _step_diagnostic(rows: list[dict[str, Any]]) -> Diagnostic:
    before, after = min(pairwise(rows), key=lambda pair: pair[1]["time_ns"] - pair[0]["time_ns"])
    seconds = (before["time_ns"] - after["time_ns"]) / 1e9
    agent, task = after["agent"], after["task"]
    text = (
        f"{after['kind']} of {agent!r}, {task!r} was written after {before['kind']} (seq {before['seq']}) and is timed "
        f"{seconds:.3f} s before it: the clock of {agent!r} was put back, and how long the execution took is not known"
    )
    return Diagnostic("clock_step", text, after["path"], after["run_id"], after["seq"])


def without_turned_ends(executions: pl.DataFrame) -> pl.DataFrame:
    """Leave out ends before their starts, and pauses shorter than nothing: such executions count as open.

    Args:
        executions: with the columns of `INTERVALS`.
    """
    is_turned = (pl.col("end_ns") < pl.col("start_ns")).fill_null(value=False)
    return executions.with_columns(
        pl.when(~is_turned).then("end_ns").alias("end_ns"),
        pl.when(is_turned).then(pl.lit(UNKNOWN_OUTCOME)).otherwise("outcome").alias("outcome"),
        pl.when(is_turned).then(0).otherwise(pl.col("paused_ns").clip(lower_bound=0)).alias("paused_ns"),
    )


def turned_ends(events: pl.DataFrame, executions: pl.DataFrame) -> pl.DataFrame:
    """Return the keys of executions that have an end in the log, which is timed before their start.

    Args:
        events: an events frame.
        executions: with the columns of `INTERVALS`.
    """
    ends = events.filter(pl.col("kind") == "task_ended").select(*_KEY, pl.col("time_ns").alias("ended_ns"))
    return executions.join(ends, on=_KEY, how="inner").filter(pl.col("ended_ns") < pl.col("start_ns")).select(_KEY)
