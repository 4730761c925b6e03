"""Say something of runs: add annotations to the file beside their log."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl

from hrclog.diagnostic import Diagnostic
from hrclog.errors import LogReadError, LogWriteError
from hrclog.event_rows import from_row
from hrclog.events import AnnotationAdded, Event
from hrclog.files import lock
from hrclog.log.annotations.beside import read_annotations
from hrclog.log.annotations.said import Said
from hrclog.log.files.annotation_files import annotations_path
from hrclog.log.files.system import exists
from hrclog.log.messages.decode import EVENT_COLUMNS
from hrclog.log.messages.encode import event_message
from hrclog.log.messages.message import UNSET_INT
from hrclog.log.writing.writer import FinishedWriter, write_atomically


def add(log: Path, events: pl.DataFrame, said: Mapping[str, Said], *, is_nameless: bool = False) -> Path:
    """Say something of runs of a log, in the file beside it, and return that file.

    Args:
        log: the log.
        events: of the log, with `seq` null where its writer gave none.
        said: what is said, by run.
        is_nameless: whether the log has one run, which its events do not name.

    Raises:
        LogReadError: the file beside the log cannot be read, or is damaged.
        LogWriteError: it cannot be written.
    """
    path = annotations_path(log)
    added = [(_annotation(events, run, words, is_nameless=is_nameless), words.at_ns) for run, words in said.items()]
    with _locked_folder(path):
        earlier = _earlier(path)
        _write(path, [*earlier, *added])
    return path


def _earlier(path: Path) -> list[tuple[Event, int]]:
    """Return the annotations that are there, each with the time of its writing."""
    diagnostics: list[Diagnostic] = []
    earlier = read_annotations(path, diagnostics) if exists(path) else EVENT_COLUMNS.to_frame()
    if diagnostics:
        remedy = f"recover it (hrclog recover {path}) and put the result in its place, or move it away"
        raise LogReadError(path, f"damage ({diagnostics[0].message})", "whole annotations", remedy)
    return [(_event(row), row["log_time_ns"]) for row in earlier.iter_rows(named=True)]


def _event(row: Mapping[str, Any]) -> Event:
    event = from_row(row)
    return replace(event, seq=UNSET_INT) if row["seq"] is None else event


def _annotation(events: pl.DataFrame, run: str, said: Said, *, is_nameless: bool) -> AnnotationAdded:
    """Return the annotation of a run: at its last event, and of the same number."""
    of_run = events.filter(pl.col("run_id") == run)
    last_seq, last_ns = of_run.select(pl.col("seq").max(), pl.col("time_ns").max()).row(0)
    return AnnotationAdded(
        time_ns=max(last_ns or 0, 0),
        run_id="" if is_nameless else run,
        seq=UNSET_INT if last_seq is None else last_seq,
        reason=said.reason,
        details=said.details(),
    )


def _write(path: Path, events: Sequence[tuple[Event, int]]) -> None:
    def fill(writer: FinishedWriter) -> None:
        for event, log_time in events:
            writer.add(event_message(event, log_time))

    write_atomically(path, fill)


@contextmanager
def _locked_folder(path: Path) -> Iterator[None]:
    """Hold the folder of a file, so that of two who add to it none loses what the other says."""
    if os.name != "posix":
        yield
        return
    try:
        fd = os.open(path.parent, os.O_RDONLY)
    except OSError as error:
        reason = f"its folder cannot be opened ({error.strerror})"
        raise LogWriteError(path, reason, "choose a folder that can be written") from error
    try:
        lock(fd, wait=True)
        yield
    finally:
        os.close(fd)
