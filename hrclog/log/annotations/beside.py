"""Annotations are in a file beside their log: `run.annotations.mcap` beside `run.mcap`; they are read with it.

A log that is moved without this file loses what was said of its runs.
"""

from __future__ import annotations

from pathlib import Path

import polars as pl

from hrclog.diagnostic import Diagnostic
from hrclog.errors import LogReadError
from hrclog.events import AnnotationAdded
from hrclog.log.files.annotation_files import annotation_files
from hrclog.log.messages.decode import EVENT_COLUMNS
from hrclog.log.parts import complaints, decode_file
from hrclog.wording import counted


def read_annotations(path: Path, diagnostics: list[Diagnostic]) -> pl.DataFrame:
    """Return the annotations of a file, of `EVENT_COLUMNS`, in the order of writing.

    Args:
        path: of the file.
        diagnostics: takes what of it is damaged.

    Raises:
        LogReadError: it cannot be read.
    """
    frames = decode_file(path, complaints(path, diagnostics), signals=False).events
    events = pl.concat([EVENT_COLUMNS.to_frame(), *frames])
    return events.filter(pl.col("kind") == AnnotationAdded.kind)


def with_annotations(events: pl.DataFrame, log: Path, diagnostics: list[Diagnostic]) -> pl.DataFrame:
    """Return the events of a log, and behind them what was said of its runs.

    Args:
        events: of the log, of `EVENT_COLUMNS` and `path`.
        log: its path.
        diagnostics: takes what of the annotations is damaged.
    """
    files = annotation_files(log)
    if not files:
        return events
    runs = events["run_id"].unique()
    frames = [_of_runs(_read(path, diagnostics), path, runs, diagnostics) for path in files]
    return pl.concat([events, *(frame.select(events.columns) for frame in frames)])


def _read(path: Path, diagnostics: list[Diagnostic]) -> pl.DataFrame:
    try:
        return read_annotations(path, diagnostics)
    except LogReadError as error:
        diagnostics.append(Diagnostic("unreadable_file", error.reason, str(path)))
        return EVENT_COLUMNS.to_frame()


def _of_runs(annotations: pl.DataFrame, path: Path, runs: pl.Series, diagnostics: list[Diagnostic]) -> pl.DataFrame:
    """Return annotations with their path, those of the runs of a log; tell of others, as where it was replaced."""
    annotations = annotations.with_columns(pl.lit(str(path)).alias("path"))
    if runs.len() == 1:  # one without a name is called by the path of its file, which may be moved
        run = pl.when(pl.col("run_id") == "").then(pl.lit(runs[0])).otherwise("run_id")
        annotations = annotations.with_columns(run.alias("run_id"))
    is_of_runs = pl.col("run_id").is_in(runs.implode())
    for run_id in sorted(annotations.filter(~is_of_runs)["run_id"].unique()):
        count = counted(annotations.filter(pl.col("run_id") == run_id).height, "annotation is", "annotations are")
        text = f"{count} of run {run_id!r}, which the log beside does not hold"
        diagnostics.append(Diagnostic("annotation_unmatched", text, str(path)))
    return annotations.filter(is_of_runs)
