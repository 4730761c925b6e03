"""What a recovery adds to the events of a log: an annotation of each run that says what was lost, and was not recorded.

Such an annotation stands at the last event of its run and carries the same number: one of its own would be that of an
event that was lost, or of the first one in the run's next file.
"""

from __future__ import annotations

from typing import Final

import polars as pl

from hrclog.events import AnnotationAdded

RECOVERED: Final = "hrclog.recovered"
"""Name of the metadata record, and of the member in the details of an annotation, that hold what was lost."""

_MEMBER: Final = f'"{RECOVERED}"'


def remarks_among(events: pl.DataFrame) -> pl.DataFrame:
    """Return those of some events that recoveries added."""
    return events.filter(_is_annotation()).filter(_is_of_recovery())


def without_remarks(events: pl.DataFrame) -> pl.DataFrame:
    """Return events without those that recoveries added."""
    return events.filter(~(_is_annotation() & _is_of_recovery())) if _may_hold_remarks(events) else events


def numbered_apart(events: pl.DataFrame) -> pl.DataFrame:
    """Return events without those that recoveries added, but for those that have a number of their own.

    Where a copy of a recovered log is numbered anew, its annotation is an event among others.
    """
    if not _may_hold_remarks(events):
        return events
    shares_number = pl.struct("run_id", "seq").is_duplicated()
    return events.filter(~(_is_annotation() & _is_of_recovery() & shares_number))


def _may_hold_remarks(events: pl.DataFrame) -> bool:
    is_annotation = events["kind"] == AnnotationAdded.kind
    if not is_annotation.any():
        return False
    return bool(events["details"].filter(is_annotation).str.contains(_MEMBER, literal=True).any())


def _is_annotation() -> pl.Expr:
    return pl.col("kind") == AnnotationAdded.kind


def _is_of_recovery() -> pl.Expr:
    return pl.col("details").str.contains(_MEMBER, literal=True).fill_null(value=False)
