"""What is added to the events of a run afterwards: annotations that its recorder did not write.

A recovery says what was lost, `hrclog annotate` what somebody knows of the run. Such an annotation stands at the last
event of its run and carries the same number: one of its own would be that of an event that was lost, or of the first
one in the run's next file.
"""

from __future__ import annotations

from typing import Final

import polars as pl

from hrclog.events import AnnotationAdded

RECOVERED: Final = "hrclog.recovered"
"""Name of the metadata record, and of the member in the details of an annotation, that hold what was lost."""

ANNOTATED: Final = "hrclog.annotated"
"""Name of the member in the details of an annotation that holds what somebody said of a run."""

_RECOVERED_MEMBER: Final = f'"{RECOVERED}"'
_ANNOTATED_MEMBER: Final = f'"{ANNOTATED}"'


def remarks_among(events: pl.DataFrame) -> pl.DataFrame:
    """Return those of some events that recoveries added."""
    return events.filter(_is_annotation()).filter(_holds(_RECOVERED_MEMBER))


def said_among(events: pl.DataFrame) -> pl.DataFrame:
    """Return those of some events by which somebody said something of a run afterwards."""
    return events.filter(_is_annotation()).filter(_holds(_ANNOTATED_MEMBER))


def without_said(events: pl.DataFrame) -> pl.DataFrame:
    """Return events without those by which somebody said something of a run afterwards."""
    return events.filter(~(_is_annotation() & _holds(_ANNOTATED_MEMBER))) if _may_hold_remarks(events) else events


def without_remarks(events: pl.DataFrame) -> pl.DataFrame:
    """Return events without those that were added afterwards."""
    return events.filter(~(_is_annotation() & _is_added())) if _may_hold_remarks(events) else events


def numbered_apart(events: pl.DataFrame) -> pl.DataFrame:
    """Return events without those that were added afterwards, but for those that have a number of their own.

    Where a copy of such a log is numbered anew, its annotation is an event among others.
    """
    if not _may_hold_remarks(events):
        return events
    shares_number = pl.struct("run_id", "seq").is_duplicated()
    return events.filter(~(_is_annotation() & _is_added() & shares_number))


def _may_hold_remarks(events: pl.DataFrame) -> bool:
    is_annotation = events["kind"] == AnnotationAdded.kind
    if not is_annotation.any():
        return False
    return bool(events.filter(is_annotation).select(_is_added().any()).item())


def _is_annotation() -> pl.Expr:
    return pl.col("kind") == AnnotationAdded.kind


def _is_added() -> pl.Expr:
    return _holds(_RECOVERED_MEMBER) | _holds(_ANNOTATED_MEMBER)


def _holds(member: str) -> pl.Expr:
    return pl.col("details").str.contains(member, literal=True).fill_null(value=False)
