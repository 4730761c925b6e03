"""What is remarkable about the events of logs as such, whatever executions they tell of."""

from __future__ import annotations

from typing import Final

import polars as pl

from hrclog.diagnostic import Diagnostic
from hrclog.event_rows import readable_details
from hrclog.events import (
    COLUMNS,
    EVENT_CLASSES,
    EVENT_VERSION,
    FLOAT_COLUMNS,
    INT_COLUMNS,
    LATEST_NS,
    TASK_KINDS,
    Role,
)
from hrclog.log.clocks.checks import check_clocks
from hrclog.log.never_set import check_speeds
from hrclog.log.remarks import numbered_apart, without_remarks
from hrclog.wording import counted

_ROLES: Final = [role.value for role in Role]
_RULES: Final[list[tuple[str, pl.Expr, str | float | None]]] = [
    *(
        (name, pl.col(name).is_between(-LATEST_NS, LATEST_NS) | pl.col(name).is_null(), None)
        for name in INT_COLUMNS
        if name != "time_ns"
    ),
    (
        "speed_scale",
        pl.col("speed_scale").is_between(0, 1) | ~pl.col("speed_scale").is_finite().fill_null(value=False),
        None,
    ),
    ("role", pl.col("role").is_in([*_ROLES, ""]) | ~pl.col("kind").is_in(TASK_KINDS), Role.PRIMARY.value),
]
"""Column, which values it may have, and what stands for others; values that are not finite have a rule of their own."""


def without_copies(events: pl.DataFrame) -> tuple[pl.DataFrame, list[Diagnostic]]:
    """Drop duplicate events (a journal beside its finished log, a file given twice); the first one stays."""
    if events.select(pl.struct("run_id", "seq").n_unique()).item() == events.height:
        return events, []
    unique = events.unique(subset=COLUMNS, keep="first", maintain_order=True)
    dropped = (
        events.group_by("path", maintain_order=True)
        .len()
        .join(unique.group_by("path").len("kept"), on="path", how="left", maintain_order="left")
    )
    counts = dropped.select("path", pl.col("len") - pl.col("kept").fill_null(0)).rows()
    return unique, [
        Diagnostic(
            "duplicate_events",
            counted(
                count, "event was given before and was counted once", "events were given before and were counted once"
            ),
            path,
        )
        for path, count in counts
        if count
    ]


def usable(events: pl.DataFrame) -> pl.DataFrame:
    """Drop events without a possible instant, and unset values that `check_events` calls invalid or not finite."""
    possible = events.filter(pl.col("time_ns").is_between(-LATEST_NS, LATEST_NS))
    finite = [pl.when(pl.col(name).is_finite()).then(pl.col(name)).alias(name) for name in FLOAT_COLUMNS]
    return possible.with_columns(finite).with_columns(
        pl.when(valid).then(pl.col(name)).otherwise(pl.lit(unset)).alias(name) for name, valid, unset in _RULES
    )


def check_events(events: pl.DataFrame) -> list[Diagnostic]:
    """Return what is missing or doubtful.

    Args:
        events: an events frame in the order of time.
    """
    recorded = without_remarks(events)
    return [
        *_sequence(numbered_apart(events)),
        *_conflicting_runs(events),
        *_impossible_times(events),
        *_unknown(events),
        *_newer(events),
        *_non_finite(events),
        *_invalid_values(events),
        *check_speeds(events),
        *check_clocks(recorded),
    ]


def check_given_numbers(events: pl.DataFrame) -> list[Diagnostic]:
    """Check the numbers in runs where some events carry none: `with_numbers` replaces those that were given."""
    if not events["seq"].null_count():
        return []
    is_partly = pl.col("seq").is_null().any().over("run_id")
    given = events.filter(is_partly & pl.col("seq").is_not_null())
    return [finding for finding in _sequence(given) if finding.code != "time_not_monotonic"]


def _sequence(events: pl.DataFrame) -> list[Diagnostic]:
    seq = pl.col("seq")
    # compare within an agent: agents may be recorded one after the other
    backwards = (seq.diff() < 0).over("run_id", "agent")
    runs = (
        events.with_columns(backwards.alias("backwards"))
        .group_by("run_id", maintain_order=True)
        .agg(
            pl.col("path").first(),
            seq.max().alias("high"),
            seq.filter(seq >= 0).n_unique().alias("distinct"),
            (pl.len() - seq.n_unique()).alias("shared"),
            pl.col("backwards").sum(),
        )
    )
    diagnostics: list[Diagnostic] = []
    for run_id, path, high, distinct, shared, backwards in runs.iter_rows():
        missing = high + 1 - distinct
        texts = {
            "events_missing": (
                missing,
                f"event between seq 0 and {high} is missing",
                f"events between seq 0 and {high} are missing",
            ),
            "conflicting_seq": (
                shared,
                "event shares the sequence number of another, different event",
                "events share the sequence number of another, different event",
            ),
            "time_not_monotonic": (
                backwards,
                "time runs backwards against the order of writing",
                "times run backwards against the order of writing",
            ),
        }
        diagnostics += [Diagnostic(code, counted(*text), path, run_id) for code, text in texts.items() if text[0] > 0]
    return diagnostics


def _conflicting_runs(events: pl.DataFrame) -> list[Diagnostic]:
    """Find ids that two different runs carry: a run starts once per segment."""
    started = events.filter(pl.col("kind") == "run_started")
    diagnostics: list[Diagnostic] = []
    for (run_id,), part in started.group_by("run_id", maintain_order=True):
        segments = [_segment(details) for details in part["details"]]
        if len(set(segments)) < len(segments):
            paths = ", ".join(part["path"].unique().sort())
            text = f"{len(segments)} runs carry the id {run_id}: {paths}"
            diagnostics.append(Diagnostic("conflicting_runs", text, part["path"][0], str(run_id)))
    return diagnostics


def _segment(details: str) -> int:
    number = readable_details(details).get("segment", 1)
    return number if isinstance(number, int) else 1


def _impossible_times(events: pl.DataFrame) -> list[Diagnostic]:
    return [
        Diagnostic(
            "invalid_time",
            f"time_ns is {value} in {counted(count, 'event, which was', 'events, which were')} skipped",
            path,
            run_id,
            seq,
        )
        for path, run_id, value, seq, count in _first_of(
            events, ~pl.col("time_ns").is_between(-LATEST_NS, LATEST_NS), "time_ns"
        )
    ]


def _invalid_values(events: pl.DataFrame) -> list[Diagnostic]:
    return [
        Diagnostic(
            "invalid_value",
            f"{name} is {value!r} in {counted(count, 'event')} and counts as {unset!r}",
            path,
            run_id,
            seq,
        )
        for name, valid, unset in _RULES
        for path, run_id, value, seq, count in _first_of(events, ~valid, name)
    ]


def _unknown(events: pl.DataFrame) -> list[Diagnostic]:
    return [
        Diagnostic(
            "unknown_event",
            f"{counted(count, 'event is', 'events are')} of the unknown kind {kind!r}",
            path,
            run_id,
            seq,
        )
        for path, run_id, kind, seq, count in _first_of(events, ~pl.col("kind").is_in(list(EVENT_CLASSES)), "kind")
    ]


def _newer(events: pl.DataFrame) -> list[Diagnostic]:
    newer = pl.col("schema_version") > EVENT_VERSION
    return [
        Diagnostic(
            "newer_schema",
            f"{counted(count, 'event has', 'events have')} version {version}, this hrclog knows {EVENT_VERSION}",
            path,
            run_id,
            seq,
        )
        for path, run_id, version, seq, count in _first_of(events, newer, "schema_version")
    ]


def _non_finite(events: pl.DataFrame) -> list[Diagnostic]:
    return [
        Diagnostic(
            "non_finite_value",
            f"{name} is {value} in {counted(count, 'event')} and counts as unset",
            path,
            run_id,
            seq,
        )
        for name in FLOAT_COLUMNS
        for path, run_id, value, seq, count in _first_of(events, ~pl.col(name).is_finite(), name)
    ]


def _first_of(events: pl.DataFrame, condition: pl.Expr, name: str) -> list[tuple[str, str, object, int, int]]:
    """Return (path, run, value, seq of the first, count) of some events, by their value of a column."""
    groups = events.filter(condition).group_by("path", "run_id", name, maintain_order=True)
    return list(groups.agg(pl.col("seq").first(), pl.len()).iter_rows())
