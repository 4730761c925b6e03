"""Executions of runs into events, in columns: all runs in one frame, each in order of time."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import polars as pl

from hrclog.event_rows import to_row
from hrclog.events import COLUMNS, EVENT_VERSION, OUTCOME_NOT_TOLD, Role, RunEnded, RunStarted
from hrclog.ids import derived_id
from hrclog.log.messages.message import EVENTS
from hrclog.recorders.importers.table.runs import FILE, NUMBER, RUN, SEPARATOR, SOURCE, Runs

_EVENT: Final = pl.Schema({name: EVENTS[name] for name in COLUMNS})
_POSITION: Final = "position"  # of a run among all
_RANK: Final = "rank"  # among the events of an instant
_ORDER: Final = "order"  # among the executions of a run

# a run starts before all else; at one instant ends come before starts, but what has no length starts before it ends
_STARTED, _RESUMED, _PAUSED, _ENDED, _BEGAN, _ENDED_AT_ONCE, _NOTED, _OVER = range(8)


@dataclass(frozen=True, slots=True)
class RunEvents:
    """The events of all runs.

    Attributes:
        frame: an events frame, run after run.
        spans: where each run's events lie in it, by the names of the runs.
    """

    frame: pl.DataFrame
    spans: Mapping[str, tuple[int, int]]


def run_events(runs: Runs) -> RunEvents:
    """Return the events of runs."""
    positions = {key: position for position, key in enumerate(runs.runs)}
    run_ids = {key: run.run_id for key, run in runs.runs.items()}
    executions = _identified(runs, positions, run_ids)
    points = runs.points.with_columns(
        _keyed(positions, pl.Int64).alias(_POSITION), _keyed(run_ids, pl.String).alias("run_id")
    )
    parts = [_starts(executions), _ends(executions), *_pauses(runs, executions), _annotations(points)]
    whole = pl.concat([part.select(*_EVENT.names(), _POSITION, _RANK, _ORDER) for part in parts])
    whole = pl.concat([whole, _frames_of_runs(runs, whole, executions)])
    ordered = whole.sort(_POSITION, "time_ns", _RANK, _ORDER, maintain_order=True)
    numbered = ordered.with_columns(pl.int_range(pl.len(), dtype=pl.Int64).over(_POSITION).alias("seq"))
    lengths = numbered.group_by(_POSITION, maintain_order=True).len()
    ends = lengths["len"].cum_sum().to_list()
    begins = [0, *ends[:-1]]
    names = [run.name for run in runs.runs.values()]
    spans = {names[at]: span for at, *span in zip(lengths[_POSITION].to_list(), begins, ends, strict=True)}
    return RunEvents(numbered.select(COLUMNS), {name: (begin, end) for name, (begin, end) in spans.items()})


def _keyed(values: Mapping[str, object], kind: pl.DataType | type[pl.DataType]) -> pl.Expr:
    return pl.col(RUN).replace_strict(dict(values), return_dtype=kind)


def _identified(runs: Runs, positions: Mapping[str, int], run_ids: Mapping[str, str]) -> pl.DataFrame:
    """Return executions with their ids, which derive from their rows, and their order in their runs."""
    ordered = runs.executions.sort(RUN, "start_ns", "agent", "task", "end_ns", FILE, NUMBER, maintain_order=True)
    same = ("agent", "task", "start_ns")
    counted = ordered.with_columns(
        pl.int_range(pl.len()).over(RUN, *same).alias("nth"),
        pl.int_range(pl.len(), dtype=pl.Int64).over(RUN).alias(_ORDER),
    )
    ids = [
        derived_id(SOURCE, *run.split(SEPARATOR), "id", key, str(attempt))
        if key
        else derived_id(SOURCE, *run.split(SEPARATOR), "row", agent, task, str(start), str(nth))
        for run, key, attempt, agent, task, start, nth in counted.select(
            RUN, "key", "attempt", *same, "nth"
        ).iter_rows()
    ]
    return counted.with_columns(
        pl.Series("execution_id", ids, pl.String),
        _keyed(positions, pl.Int64).alias(_POSITION),
        _keyed(run_ids, pl.String).alias("run_id"),
    )


def _events(rows: pl.DataFrame, kind: str, time: str, rank: pl.Expr, **columns: pl.Expr) -> pl.DataFrame:
    """Return events of a kind; what `columns` do not name is unset."""
    unset = {
        name: pl.lit("" if dtype == pl.String else None, dtype) for name, dtype in _EVENT.items() if name not in columns
    } | {"schema_version": pl.lit(EVENT_VERSION), "attempt": pl.lit(0), "seq": pl.lit(0)}
    named = unset | {"kind": pl.lit(kind), "time_ns": pl.col(time), "run_id": pl.col("run_id")} | columns
    return rows.select(
        *(expression.cast(_EVENT[name]).alias(name) for name, expression in named.items()),
        pl.col(_POSITION), rank.cast(pl.Int64).alias(_RANK), pl.col(_ORDER).cast(pl.Int64),
    )  # fmt: skip


def _identity() -> dict[str, pl.Expr]:
    names = ("agent", "task", "execution_id", "attempt")
    return {name: pl.col(name) for name in names} | {"role": pl.lit(Role.PRIMARY.value)}


def _starts(executions: pl.DataFrame) -> pl.DataFrame:
    planned = {name: pl.col(name) for name in ("planned_start_ns", "planned_end_ns")}
    return _events(executions, "task_started", "start_ns", pl.lit(_BEGAN), **_identity(), **planned)


def _ends(executions: pl.DataFrame) -> pl.DataFrame:
    ended = executions.filter(pl.col("end_ns").is_not_null())
    words = {word: _details({OUTCOME_NOT_TOLD: word}) for word in ended["not_told"].drop_nulls().unique()}
    details = pl.col("not_told").replace_strict(words, default="", return_dtype=pl.String) if words else pl.lit("")
    rank = pl.when(pl.col("start_ns") == pl.col("end_ns")).then(_ENDED_AT_ONCE).otherwise(_ENDED)
    facts = {"outcome": pl.col("outcome"), "reason": pl.col("reason"), "details": details}
    return _events(ended, "task_ended", "end_ns", rank, **_identity(), **facts)


def _pauses(runs: Runs, executions: pl.DataFrame) -> list[pl.DataFrame]:
    if runs.pauses.is_empty():
        return []
    joined = runs.pauses.join(executions, on=[FILE, NUMBER], how="inner", maintain_order="left")
    at_once = pl.when(pl.col("pause_ns") == pl.col("start_ns")).then(_ENDED_AT_ONCE).otherwise(_PAUSED)
    resumed = joined.filter(pl.col("resume_ns").is_not_null())
    return [
        _events(joined, "task_paused", "pause_ns", at_once, **_identity(), cause=pl.lit("operator")),
        _events(resumed, "task_resumed", "resume_ns", pl.lit(_RESUMED), **_identity()),
    ]


def _annotations(points: pl.DataFrame) -> pl.DataFrame:
    """Return what happened at one instant as annotations: the name, and what was remarked of it."""
    text = pl.when(pl.col("reason") != "").then(pl.format("{}: {}", "task", "reason")).otherwise("task")
    numbered = points.with_columns(pl.lit(0, pl.Int64).alias(_ORDER))
    return _events(numbered, "annotation_added", "start_ns", pl.lit(_NOTED), agent=pl.col("agent"), reason=text)


def _frames_of_runs(runs: Runs, events: pl.DataFrame, executions: pl.DataFrame) -> pl.DataFrame:
    """Return the first and the last event of each run."""
    times = events.group_by(_POSITION).agg(
        pl.col("time_ns").min().alias("first"), pl.col("time_ns").max().alias("last")
    )
    agents = executions.group_by(_POSITION).agg(pl.col("agent").unique().sort())
    facts = times.join(agents, on=_POSITION, how="left").sort(_POSITION)
    keys = list(runs.runs)
    rows = []
    for position, first, last, run_agents in facts.iter_rows():
        run = runs.runs[keys[position]]
        started = RunStarted(
            time_ns=first,
            run_id=run.run_id,
            name=run.name,
            agents=tuple(run_agents),
            tags=run.tags,
            details={"source": SOURCE},
        )
        ended = RunEnded(time_ns=last, run_id=run.run_id)
        rows.append(to_row(started) | {_POSITION: position, _RANK: _STARTED, _ORDER: 0})
        rows.append(to_row(ended) | {_POSITION: position, _RANK: _OVER, _ORDER: 0})
    schema = _EVENT | {_POSITION: pl.Int64(), _RANK: pl.Int64(), _ORDER: pl.Int64()}
    return pl.DataFrame(rows, schema=schema).select(events.columns)


def _details(values: Mapping[str, object]) -> str:
    return json.dumps(values, ensure_ascii=False, separators=(",", ":"), sort_keys=True)
