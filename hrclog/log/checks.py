"""What is remarkable about the events of logs as such, whatever executions they tell of."""

from __future__ import annotations

import polars as pl

from hrclog.diagnostic import Diagnostic
from hrclog.events import COLUMNS, EVENT_CLASSES, FLOAT_COLUMNS, SCHEMA_VERSION


def without_copies(events: pl.DataFrame) -> tuple[pl.DataFrame, list[Diagnostic]]:
    """Drop what is there twice: a journal beside its finished log, a file given twice; the first one stays."""
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
        Diagnostic("duplicate_events", f"{count} events were given before and were counted once", path)
        for path, count in counts
        if count
    ]


def only_finite(events: pl.DataFrame) -> pl.DataFrame:
    """Unset numbers that are infinite or NaN."""
    return events.with_columns(
        pl.when(pl.col(name).is_finite()).then(pl.col(name)).alias(name) for name in FLOAT_COLUMNS
    )


def check_events(events: pl.DataFrame) -> list[Diagnostic]:
    """Return what is missing or doubtful.

    Args:
        events: an events frame in the order of time.
    """
    return [*_sequence(events), *_unknown(events), *_newer(events), *_non_finite(events)]


def _sequence(events: pl.DataFrame) -> list[Diagnostic]:
    seq = pl.col("seq")
    runs = events.group_by("run_id", maintain_order=True).agg(
        pl.col("path").first(),
        seq.min().alias("low"),
        seq.max().alias("high"),
        seq.n_unique().alias("distinct"),
        (pl.len() - seq.n_unique()).alias("shared"),
        (seq.diff() < 0).sum().alias("backwards"),
    )
    found: list[Diagnostic] = []
    for run_id, path, low, high, distinct, shared, backwards in runs.iter_rows():
        missing = high + 1 - distinct
        texts = {
            "events_missing": f"{missing} events between seq 0 and {high} are missing" if low >= 0 and missing else "",
            "conflicting_seq": f"{shared} events share the sequence number of another, different event"
            if shared
            else "",
            "time_not_monotonic": f"{backwards} times run backwards against the order of writing" if backwards else "",
        }
        found += [Diagnostic(code, text, path, run_id) for code, text in texts.items() if text]
    return found


def _unknown(events: pl.DataFrame) -> list[Diagnostic]:
    return [
        Diagnostic("unknown_event", f"{count} events are of the unknown kind {kind!r}", path, run_id, seq)
        for path, run_id, kind, seq, count in _first_of(events, ~pl.col("kind").is_in(list(EVENT_CLASSES)), "kind")
    ]


def _newer(events: pl.DataFrame) -> list[Diagnostic]:
    newer = pl.col("schema_version") > SCHEMA_VERSION
    return [
        Diagnostic(
            "newer_schema",
            f"{count} events have version {version}, this hrclog knows {SCHEMA_VERSION}",
            path,
            run_id,
            seq,
        )
        for path, run_id, version, seq, count in _first_of(events, newer, "schema_version")
    ]


def _non_finite(events: pl.DataFrame) -> list[Diagnostic]:
    return [
        Diagnostic("non_finite_value", f"{name} is {value} in {count} events and counts as unset", path, run_id, seq)
        for name in FLOAT_COLUMNS
        for path, run_id, value, seq, count in _first_of(events, ~pl.col(name).is_finite(), name)
    ]


def _first_of(events: pl.DataFrame, which: pl.Expr, name: str) -> list[tuple[str, str, object, int, int]]:
    """Return (path, run, value, seq of the first, count) of some events, by their value of a column."""
    groups = events.filter(which).group_by("path", "run_id", name, maintain_order=True)
    return list(groups.agg(pl.col("seq").first(), pl.len()).iter_rows())
