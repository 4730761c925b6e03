"""Annotations are in a file beside their log: `run.annotations.mcap` beside `run.mcap`; they are read with it.

A log that is moved without this file loses what was said of its runs.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import polars as pl

from hrclog.diagnostic import Diagnostic
from hrclog.errors import LogReadError
from hrclog.events import AnnotationAdded
from hrclog.log.files.names import ANNOTATIONS_SUFFIX, plain_name
from hrclog.log.files.system import exists
from hrclog.log.messages.decode import EVENT_COLUMNS
from hrclog.log.parts import complaints, decode_file
from hrclog.log.writing.journal import PARTIAL_SUFFIX

_LOG_SUFFIX: Final = ".mcap"


def annotations_path(log: Path) -> Path:
    """Return where annotations of a log are, whether it is finished, a journal, or compressed."""
    name = plain_name(log.name).removesuffix(PARTIAL_SUFFIX).removesuffix(_LOG_SUFFIX)
    return log.with_name(f"{name}{ANNOTATIONS_SUFFIX}")


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
    path = annotations_path(log)
    if not exists(path):
        return events
    try:
        annotations = read_annotations(path, diagnostics)
    except LogReadError as error:
        diagnostics.append(Diagnostic("unreadable_file", error.reason, str(path)))
        return events
    runs = events["run_id"].unique()
    annotations = annotations.with_columns(pl.lit(str(path)).alias("path"))
    if runs.len() == 1:  # one without a name is called by the path of its file, which may be moved
        run = pl.when(pl.col("run_id") == "").then(pl.lit(runs[0])).otherwise("run_id")
        annotations = annotations.with_columns(run.alias("run_id"))
    of_runs = annotations.filter(pl.col("run_id").is_in(runs.implode()))
    return pl.concat([events, of_runs.select(events.columns)])
