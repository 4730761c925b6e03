"""The first row of tables as it was read, for people."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Final

from hrclog.recorders.importers.table.runs import FILE, RUN, Runs
from hrclog.recorders.importers.table.tables import LINE

_MS: Final = 10**6


def first_row_text(runs: Runs) -> str:
    """Return what the first row says."""
    row = runs.executions.sort(FILE, LINE, maintain_order=True).row(0, named=True)
    run = runs.runs[row[RUN]]
    until = "still open" if row["end_ns"] is None else f"to {_instant(row['end_ns'])}"
    outcome = row["outcome"] or ("" if row["end_ns"] is None else "no outcome")
    planned = "" if row["planned_start_ns"] is None else f", planned from {_instant(row['planned_start_ns'])}"
    tags = "".join(f", {key}={value}" for key, value in run.tags.items())
    parts = [f"{row['agent']} {row['task']} in run {run.name} from {_instant(row['start_ns'])} {until}", outcome]
    return ", ".join(part for part in parts if part) + planned + tags


def _instant(ns: int) -> str:
    seconds, rest = divmod(ns, 10**9)
    text = datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M:%S")
    return f"{text}.{rest // _MS:03d}"
