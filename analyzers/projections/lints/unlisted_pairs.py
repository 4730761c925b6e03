"""More tasks than a table of pairs can list."""

from __future__ import annotations

from collections.abc import Iterator

from hrclog.analyzers.projections.lints.record import Record
from hrclog.analyzers.projections.overlaps import MOST_PAIRS, pair_count, task_counts
from hrclog.diagnostic import Diagnostic


def unlisted_pairs(record: Record) -> Iterator[Diagnostic]:
    """Say so if not all pairs of tasks are listed."""
    count = pair_count(task_counts(record.intervals))
    if count > MOST_PAIRS:
        text = f"of {count} ordered pairs of tasks only those that overlapped are listed"
        yield Diagnostic("unlisted_pairs", f"{text}: are serial numbers in task names?")
