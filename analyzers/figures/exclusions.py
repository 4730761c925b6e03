"""What annotations exclude, as a table."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from typing import Final

import polars as pl

from hrclog.analyzers.figures.table import DataTable
from hrclog.log.annotations.exclusions import Exclusion

_CAPTION: Final = "What annotations exclude, as if it had not happened, or say that nothing is to be learnt from."
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)


def exclusion_table(exclusions: Sequence[Exclusion]) -> list[DataTable]:
    """Return the table, none where nothing is excluded.

    Args:
        exclusions: in the order of the rows.
    """
    rows = [
        {
            "run_id": entry.run_id,
            "what": str(entry.target),
            "executions": ", ".join(f"{agent} {task}" for agent, task in entry.executions.values()),
            "counts as": str(entry.verdict).replace("_", " "),
            "reason": entry.reason,
            "author": entry.author,
            "said (UTC)": _day(entry.at_ns),
        }
        for entry in exclusions
    ]
    return [DataTable("exclusions", "Excluded", pl.DataFrame(rows), _CAPTION)] if rows else []


def _day(at_ns: int) -> str:
    try:
        return (_EPOCH + timedelta(seconds=at_ns // 10**9)).date().isoformat()
    except OverflowError:
        return ""
