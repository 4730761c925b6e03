"""Rows of events into executions: what begins pairs with what ends, in order of time."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import polars as pl

from hrclog.recorders.importers.table.skipped import Skip
from hrclog.recorders.importers.table.tables import LINE
from hrclog.recorders.importers.table.words import END, PAUSE, POINT, RESUME, START

# at one instant an execution ends before the next begins
_RANK: Final = {RESUME: 0, PAUSE: 1, END: 2, START: 3, POINT: 4}
_ENDS: Final = ("outcome", "not_told", "end_ns")


@dataclass(slots=True)
class Folded:
    """Executions, points in time and pauses; `pauses` name an execution by its number."""

    executions: pl.DataFrame
    points: pl.DataFrame
    pauses: list[tuple[int, int, int | None]]
    skips: list[Skip]


@dataclass(slots=True)
class _Open:
    """An execution that has begun."""

    start: int  # row of its start
    number: int
    paused_ns: int | None = None


@dataclass(slots=True)
class _Fold:
    """What was made of the rows so far, by their numbers."""

    starts: list[int] = field(default_factory=list)
    ends: dict[int, int] = field(default_factory=dict)
    pauses: list[tuple[int, int, int | None]] = field(default_factory=list)
    skips: list[Skip] = field(default_factory=list)


def paired(rows: pl.DataFrame, meanings: tuple[Mapping[str, str], Mapping[str, str]]) -> Folded:
    """Return the executions that rows of events make.

    An end closes the execution that has been open for longest among those of the same run, agent, task, id and
    further columns; so does a pause.

    Args:
        rows: with the columns of executions, `kind`, `word` and `pairing`; `start_ns` is when the event happened.
        meanings: of words of events, and the outcomes of those that end an execution with one.
    """
    rank = pl.col("kind").replace_strict(_RANK, return_dtype=pl.Int64)
    ordered = rows.with_columns(rank.alias("rank")).sort("start_ns", "rank", maintain_order=True)
    ordered = ordered.with_columns(pl.col("run_parts").list.join("\x1f").alias("run_key"))
    fold = _fold(ordered)
    starts = ordered[fold.starts]
    end_rows = [fold.ends.get(number) for number in range(len(fold.starts))]
    ends = pl.DataFrame({"row": end_rows}, schema={"row": pl.Int64}).join(
        ordered.with_row_index("row").cast({"row": pl.Int64}), on="row", how="left", maintain_order="left"
    )
    executions = starts.with_columns(
        ends["start_ns"].alias("end_ns"), *_outcome_of(ends, meanings[1]), _either(ends, starts, "reason")
    )
    points = ordered.filter(pl.col("kind") == POINT)
    return Folded(executions, points, fold.pauses, fold.skips)


def _outcome_of(ends: pl.DataFrame, outcomes: Mapping[str, str]) -> list[pl.Series]:
    """Return the outcomes of ends, from their own column or from the word of the event."""
    by_word = ends["word"].fill_null("").replace_strict(dict(outcomes), default="", return_dtype=pl.String)
    told = ends["outcome"].fill_null("")
    outcome = pl.select(pl.when(told != "").then(told).otherwise(by_word).alias("outcome")).to_series()
    # where some words of events tell an outcome, what the others mean is not known
    word = ends["word"] if (by_word != "").any() else pl.Series([None], dtype=pl.String).new_from_index(0, ends.height)
    not_told = pl.select(pl.when(outcome == "").then(pl.coalesce(ends["not_told"], word)).alias("not_told")).to_series()
    return [outcome, not_told]


def _either(ends: pl.DataFrame, starts: pl.DataFrame, name: str) -> pl.Series:
    of_end = ends[name].fill_null("")
    return pl.select(pl.when(of_end != "").then(of_end).otherwise(starts[name]).alias(name)).to_series()


def _fold(ordered: pl.DataFrame) -> _Fold:
    fold = _Fold()
    open_by_key: dict[Any, deque[_Open]] = {}
    early_ends: dict[Any, tuple[int, int, int]] = {}  # (row, line, time) of ends that nothing was open for
    columns = ordered.select("kind", "run_key", "agent", "task", "key", "pairing", "start_ns", LINE)
    for row, (kind, run, agent, task, key, pairing, time_ns, line) in enumerate(columns.iter_rows()):
        if kind == POINT:
            continue
        whose = (run, agent, task, key, pairing)
        waiting = open_by_key.setdefault(whose, deque())
        if kind == START:
            _start(fold, waiting, row, early_ends.pop(whose, None), time_ns)
        elif not waiting and kind == END:
            _skip_end(fold, early_ends.get(whose))
            early_ends[whose] = (row, line, time_ns)
        elif not waiting:
            fold.skips.append(Skip(line, f"it is the {kind} of what never started"))
        elif kind == END:
            ended = waiting.popleft()
            fold.ends[ended.number] = row
            if ended.paused_ns is not None:
                fold.pauses.append((ended.number, ended.paused_ns, None))
        else:
            _pause_or_resume(fold, waiting[0], kind, time_ns, line)
    for early in early_ends.values():
        _skip_end(fold, early)
    still_open = (execution for waiting in open_by_key.values() for execution in waiting)
    fold.pauses += [(one.number, one.paused_ns, None) for one in still_open if one.paused_ns is not None]
    return fold


def _start(fold: _Fold, waiting: deque[_Open], row: int, early: tuple[int, int, int] | None, time_ns: int) -> None:
    """Begin an execution; an end that came early ends it if it did so in the same instant."""
    if early is not None and early[2] == time_ns:
        fold.ends[len(fold.starts)] = early[0]
    else:
        _skip_end(fold, early)
        waiting.append(_Open(row, len(fold.starts)))
    fold.starts.append(row)


def _skip_end(fold: _Fold, early: tuple[int, int, int] | None) -> None:
    if early is not None:
        fold.skips.append(Skip(early[1], "it is the end of what never started"))


def _pause_or_resume(fold: _Fold, execution: _Open, kind: str, time_ns: int, line: int) -> None:
    if kind == PAUSE:
        if execution.paused_ns is not None:
            fold.skips.append(Skip(line, "it pauses what is paused already"))
        else:
            execution.paused_ns = time_ns
    elif execution.paused_ns is None:
        fold.skips.append(Skip(line, "it resumes what is not paused"))
    else:
        fold.pauses.append((execution.number, execution.paused_ns, time_ns))
        execution.paused_ns = None
