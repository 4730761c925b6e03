"""Runs in which so much overlaps that their overlaps were left out."""

from __future__ import annotations

from collections.abc import Iterator

from hrclog.analyzers.projections.crowded import crowded_runs as runs_left_out
from hrclog.analyzers.projections.lints.record import Record
from hrclog.diagnostic import Diagnostic


def crowded_runs(record: Record) -> Iterator[Diagnostic]:
    """Say which runs are in no overlap and in no estimate."""
    for run, reason in sorted(runs_left_out(record.intervals).items()):
        text = (
            f"{reason}: its overlaps were left out, and it is in no estimate; do executions lack their ends, or is it "
            "several runs?"
        )
        yield Diagnostic("overlaps_left_out", text, record.paths[run], run)
