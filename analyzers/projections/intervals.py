"""Events into intervals: one row per started execution.

Executions whose events are one start, at most one end and one dispatch, in order, are paired column-wise; all others
are folded one by one through the state machine `hrclog.state.apply`. Both ways give the same rows.
"""

from __future__ import annotations

from typing import Any, Final

import polars as pl

from hrclog.analyzers.projections.clock_step import step_diagnostics, task_fact, turned_back, without_turned_ends
from hrclog.analyzers.projections.frames import EVENTS_FRAME, check_frame
from hrclog.analyzers.projections.planned_times import without_turned_plans
from hrclog.analyzers.projections.schemas import INTERVALS
from hrclog.diagnostic import Diagnostic
from hrclog.errors import InvalidEventError
from hrclog.event_rows import parse_details
from hrclog.events import COMPLETED, NOT_LEARNT, OUTCOME_NOT_TOLD, TASK_KINDS, UNKNOWN_OUTCOME, Outcome, Role
from hrclog.log.annotations.exclusions import not_learnt
from hrclog.log.logs import ORDER
from hrclog.state import PLANNED, ExecutionState, apply
from hrclog.wording import counted

SORT: Final = ("run_id", "start_ns", "until_ns", "agent", "task", "execution_id")

_KEY: Final = ("run_id", "execution_id")
_LANE: Final = ("run_id", "agent", "parent_execution_id")
# until when an open execution is known to have lasted; an annotation may be added days later
_SIGNS_OF_LIFE: Final = (
    *TASK_KINDS,
    "run_ended",
    "safety_state_changed",
    "heartbeat",
    "clock_synced",
    "command_rejected",
)
_START_FIELDS: Final = ("agent", "task", "task_type", "role", "parent_execution_id", "item_id", "attempt", "path")
_PLANNED: Final = ("planned_start_ns", "planned_end_ns")
_END_FIELDS: Final = ("outcome", "reason", "planned_duration_s", "planning_time_s", "path_length", "target")
_OPEN: Final = {"reason": "", "target": ""}  # what an execution says that has not ended
_OUTCOMES: Final = tuple(outcome.value for outcome in Outcome)


def intervals(events: pl.DataFrame) -> pl.DataFrame:
    """Rebuild the executions of all runs.

    Args:
        events: an events frame in any order.

    Returns:
        A frame of schema `INTERVALS`.

    Raises:
        HrclogError: `events` is no events frame.
    """
    check_frame(events, EVENTS_FRAME)
    return rebuild(events)[0]


def rebuild(events: pl.DataFrame) -> tuple[pl.DataFrame, list[Diagnostic]]:
    """Rebuild the executions of all runs, and say which events the state machine does not allow.

    Args:
        events: an events frame in any order.

    Returns:
        A frame of schema `INTERVALS`, and one diagnostic per event that was skipped or not understood in full.
    """
    ordered = events.sort(ORDER, maintain_order=True)
    task_events = ordered.filter(pl.col("kind").is_in(TASK_KINDS)).with_row_index("order")
    regular_keys = _find_regular_keys(task_events)
    paired = _pair_events(task_events, regular_keys)
    irregular = task_events.join(regular_keys, on=_KEY, how="anti", maintain_order="left")
    stepped = turned_back(irregular)
    folded, diagnostics = _fold_events(irregular.join(stepped, on=_KEY, how="anti", maintain_order="left"))
    in_order_of_writing = irregular.join(stepped, on=_KEY, how="semi").sort("seq", maintain_order=True)
    folded_by_seq, _ = _fold_events(in_order_of_writing)
    diagnostics += step_diagnostics(in_order_of_writing)
    last = (
        events.filter(pl.col("kind").is_in(_SIGNS_OF_LIFE))
        .group_by("run_id")
        .agg(pl.col("time_ns").max().alias("last_ns"))
    )
    rows = pl.concat([paired, folded, without_turned_ends(folded_by_seq)]).join(last, on="run_id", how="left")
    rows, untold = _with_untold_outcomes(_add_until(rows), ordered)
    rows, turned = without_turned_plans(rows)
    diagnostics = [*_invalid_details(ordered), *diagnostics, *untold, *turned]
    rows = _with_not_learnt(rows, events)
    return rows.select(INTERVALS.names()).cast(INTERVALS).sort(SORT), diagnostics


def _add_until(rows: pl.DataFrame) -> pl.DataFrame:
    """Add until when each execution lasts; an open one until its agent's next start, else the last sign of life."""
    starts = rows.select(*_LANE, "start_ns").unique().sort(*_LANE, "start_ns")
    following = starts.with_columns(pl.col("start_ns").shift(-1).over(_LANE).alias("next_ns"))
    open_until = pl.max_horizontal("start_ns", pl.min_horizontal("last_ns", "next_ns"))
    joined = rows.join(following, on=[*_LANE, "start_ns"], how="left", maintain_order="left")
    return joined.with_columns(pl.coalesce("end_ns", open_until).alias("until_ns"))


def _with_not_learnt(rows: pl.DataFrame, events: pl.DataFrame) -> pl.DataFrame:
    """Give executions from which nothing is to be learnt a role of their own; auxiliary ones are none of it anyway."""
    keys = not_learnt(events)
    if keys.is_empty():
        return rows
    marked = rows.join(keys.with_columns(pl.lit(value=True).alias("unlearnt")), on=_KEY, how="left")
    is_meant = pl.col("unlearnt").fill_null(value=False) & (pl.col("role") != Role.AUXILIARY.value)
    return marked.with_columns(pl.when(is_meant).then(pl.lit(NOT_LEARNT)).otherwise("role").alias("role"))


def _with_untold_outcomes(rows: pl.DataFrame, events: pl.DataFrame) -> tuple[pl.DataFrame, list[Diagnostic]]:
    """Say what ends without an outcome count as: completed in runs that tell none at all, unknown in others."""
    is_untold = pl.col("outcome") == ""
    if not (rows["outcome"] == "").any():
        return rows, []
    ends = events.filter(pl.col("kind") == "task_ended")
    tells = (pl.col("outcome") != "") | pl.col("details").str.contains(f'"{OUTCOME_NOT_TOLD}"', literal=True)
    telling = ends.filter(tells)["run_id"].unique()
    is_unknown = is_untold & pl.col("run_id").is_in(telling.implode())
    counts = rows.select(is_unknown.sum().alias("unknown"), (is_untold & ~is_unknown).sum().alias("completed"))
    n_unknown, n_completed = counts.row(0)
    derived = pl.when(is_unknown).then(pl.lit(UNKNOWN_OUTCOME)).when(is_untold).then(pl.lit(COMPLETED))
    return rows.with_columns(derived.otherwise("outcome").alias("outcome")), _untold_diagnostics(n_unknown, n_completed)


def _untold_diagnostics(n_unknown: int, n_completed: int) -> list[Diagnostic]:
    diagnostics: list[Diagnostic] = []
    if n_unknown:
        text = f"{counted(n_unknown, 'execution')} ended without an outcome, where others of the run have one"
        diagnostics.append(Diagnostic("outcome_not_told", f"{text}: unknown, and left out of durations"))
    if n_completed:
        text = f"{counted(n_completed, 'execution')} ended in runs that tell no outcome at all"
        diagnostics.append(Diagnostic("outcome_assumed", f"{text}: counted as completed"))
    return diagnostics


def is_success() -> pl.Expr:
    """Return which intervals lasted as long as their task takes: they succeeded, or ended where no outcome is told."""
    return pl.col("outcome").is_in((Outcome.SUCCEEDED.value, COMPLETED)) & pl.col("end_ns").is_not_null()


def is_counted() -> pl.Expr:
    """Return which intervals count in overlaps and synergies: primary ones that are no step of another."""
    return (pl.col("role") != Role.AUXILIARY.value) & (pl.col("parent_execution_id") == "")


def has_learnt_role() -> pl.Expr:
    """Return which intervals durations are learnt from, steps of sequences too: primary ones."""
    return ~pl.col("role").is_in((Role.AUXILIARY.value, NOT_LEARNT))


def is_learnt() -> pl.Expr:
    """Return which counted intervals estimators learn from: not those that annotations say nothing is learnt from."""
    return is_counted() & (pl.col("role") != NOT_LEARNT)


def top_level() -> pl.Expr:
    """Return which intervals make up an agent's timeline: all but the steps of a sequence."""
    return pl.col("parent_execution_id") == ""


def _find_regular_keys(task_events: pl.DataFrame) -> pl.DataFrame:
    """Return the keys of executions that need no state machine."""
    kind = pl.col("kind")

    def at(name: str) -> pl.Expr:
        return pl.col("order").filter(kind == name)

    started, ended, dispatched = (at(name) for name in ("task_started", "task_ended", "task_dispatched"))
    facts = task_events.group_by(_KEY).agg(
        ((started.len() == 1) & (ended.len() <= 1) & (dispatched.len() <= 1)).alias("once"),
        (pl.len() == started.len() + ended.len() + dispatched.len()).alias("plain"),
        (ended.first().is_null() | (ended.first() > started.first())).alias("ends_later"),
        (dispatched.first().is_null() | (dispatched.first() < started.first())).alias("dispatched_before"),
        ((pl.col("agent").n_unique() == 1) & (pl.col("task").n_unique() == 1)).alias("same"),
        (pl.col("outcome").filter(kind == "task_ended").is_in((*_OUTCOMES, "")).all()).alias("known"),
        ((pl.col("agent") != "") & (pl.col("task") != "")).all().alias("named"),
    )
    flags = ("once", "plain", "ends_later", "dispatched_before", "same", "known", "named")
    return facts.filter(pl.all_horizontal(flags) & (pl.col("execution_id") != "")).select(_KEY)


def _pair_events(task_events: pl.DataFrame, keys: pl.DataFrame) -> pl.DataFrame:
    """Join starts with their ends and dispatches."""
    regular = task_events.join(keys, on=_KEY, how="semi")
    starts = regular.filter(pl.col("kind") == "task_started").select(
        *_KEY, *_START_FIELDS, *_PLANNED, pl.col("time_ns").alias("start_ns")
    )
    ends = regular.filter(pl.col("kind") == "task_ended").select(*_KEY, *_END_FIELDS, pl.col("time_ns").alias("end_ns"))
    plans = regular.filter(pl.col("kind") == "task_dispatched").select(
        *_KEY, *_PLANNED, "item_id", pl.col("time_ns").alias("dispatched_ns")
    )
    joined = starts.join(ends, on=_KEY, how="left").join(plans, on=_KEY, how="left", suffix="_dispatched")
    return (
        joined.select(
            *_KEY,
            *(name for name in _START_FIELDS if name != "item_id"),
            pl.when(pl.col("item_id") != "")
            .then("item_id")
            .otherwise(pl.col("item_id_dispatched").fill_null(""))
            .alias("item_id"),
            "dispatched_ns",
            "start_ns",
            "end_ns",
            pl.col("outcome").fill_null(UNKNOWN_OUTCOME),
            pl.col("reason").fill_null(""),
            pl.lit(0, pl.Int64).alias("paused_ns"),
            *(pl.coalesce(name, f"{name}_dispatched").alias(name) for name in _PLANNED),
            "planned_duration_s",
            "planning_time_s",
            "path_length",
            pl.col("target").fill_null(""),
        )
        .select(_COLUMNS.names())
        .cast(_COLUMNS)
    )


_COLUMNS: Final = pl.Schema({name: kind for name, kind in INTERVALS.items() if name != "until_ns"})


def _fold_events(task_events: pl.DataFrame) -> tuple[pl.DataFrame, list[Diagnostic]]:
    """Run the state machine over executions, event by event."""
    states: dict[tuple[str, str], ExecutionState] = {}
    facts: dict[tuple[str, str], dict[str, Any]] = {}
    diagnostics: list[Diagnostic] = []
    for row in task_events.iter_rows(named=True):
        key = (row["run_id"], row["execution_id"])
        before = states.get(key, PLANNED)
        after, code = apply(before, task_fact(row))
        if code:
            diagnostics.append(_complaint(code, row))
        if after is before:
            continue
        states[key] = after
        facts.setdefault(key, {}).update(_facts(row, facts.get(key, {})))
    rows = [
        _OPEN | facts[key] | _outcome(state) | {"run_id": key[0], "execution_id": key[1]}
        for key, state in states.items()
        if state.start_ns is not None
    ]
    return pl.DataFrame(rows, schema=_COLUMNS), diagnostics


def _invalid_details(events: pl.DataFrame) -> list[Diagnostic]:
    """Return a diagnostic per event whose details are no JSON object."""
    text = pl.col("details")
    # polars sorts out nearly all of them, and refuses a few that Python takes
    doubtful = events.filter((text != "") & ~(text.str.starts_with("{") & text.str.json_path_match("$").is_not_null()))
    diagnostics: list[Diagnostic] = []
    for details, kind, path, run_id, seq in doubtful.select("details", "kind", "path", "run_id", "seq").iter_rows():
        try:
            parse_details(details, kind)
        except InvalidEventError as error:
            diagnostics.append(Diagnostic("invalid_details", str(error), path, run_id, seq))
    return diagnostics


def _facts(row: dict[str, Any], known: dict[str, Any]) -> dict[str, Any]:
    """Return what an accepted event adds to its execution's row."""
    match row["kind"]:
        case "task_dispatched":
            dispatched = {"dispatched_ns": row["time_ns"]}
            return {name: row[name] for name in (*_START_FIELDS, *_PLANNED)} | dispatched
        case "task_started":
            planned = {name: row[name] if row[name] is not None else known.get(name) for name in _PLANNED}
            item = row["item_id"] or known.get("item_id", "")
            return {name: row[name] for name in _START_FIELDS} | planned | {"item_id": item}
        case "task_ended":
            return {name: row[name] for name in _END_FIELDS if name != "outcome"}
        case _:
            return {}


def _outcome(state: ExecutionState) -> dict[str, Any]:
    return {
        "start_ns": state.start_ns,
        "end_ns": state.end_ns,
        "outcome": state.outcome if state.end_ns is not None else UNKNOWN_OUTCOME,
        "paused_ns": state.paused_ns,
    }


def _complaint(code: str, row: dict[str, Any]) -> Diagnostic:
    event = f"{row['kind']} of {row['agent']!r}, {row['task']!r} (execution {row['execution_id'] or 'without id'})"
    return Diagnostic(code, f"{event} is not allowed: {_WHY[code]}", row["path"], row["run_id"], row["seq"])


_WHY: Final = {
    "end_without_start": "it never started",
    "duplicate_start": "an execution with this id has already started",
    "event_after_end": "the execution has ended",
    "dispatch_after_start": "it was dispatched or started before",
    "pause_without_start": "it has not started",
    "pause_while_paused": "it is paused already",
    "resume_without_pause": "it is not paused",
    "identity_changed": "the execution belongs to another agent or task",
    "missing_identity": "agent, task and execution id must be named",
    "invalid_outcome": "its outcome is not in the vocabulary; it counts as unknown",
}
