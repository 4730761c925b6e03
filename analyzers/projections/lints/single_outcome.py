"""Outcomes that are all the same."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import polars as pl

from hrclog.analyzers.projections.intervals import is_counted
from hrclog.analyzers.projections.lints.record import Record
from hrclog.diagnostic import Diagnostic
from hrclog.events import Outcome

_FEWEST: Final = 3
"""Outcomes that can be called all the same."""

_ENOUGH: Final = 10
"""With fewer, chance alone is a likely reason: a tenth that fails is absent from 9 in two cases of five."""

_WHY: Final = {Outcome.SUCCEEDED.value: "failures may have been removed before we saw them"}
_ACTIVE: Final = (Outcome.SUCCEEDED.value, Outcome.FAILED.value, Outcome.TIMED_OUT.value)
_OTHERWISE: Final = "was the column filled in, or is one outcome taken for another?"


def single_outcome(record: Record) -> Iterator[Diagnostic]:
    """Say so if all ended executions have the same outcome, those of simulated runs left out: nobody removes theirs."""
    outcomes = list(Outcome)
    rows = record.intervals.filter(is_counted() & pl.col("outcome").is_in(outcomes)).select("run_id", "outcome")
    if rows.height < _FEWEST:
        return
    counts = rows.group_by("run_id").agg(pl.len(), pl.col("outcome").unique())
    real = [row for row in counts.iter_rows() if not _is_simulated(record, row[0])]
    told = {outcome for _, _, of_run in real for outcome in of_run}
    count = sum(n for _, n, _ in real)
    if len(told) == 1 and count >= _FEWEST:
        [outcome] = told
        verb = outcome.replace("_", " ") if outcome in _ACTIVE else f"were {outcome.replace('_', ' ')}"
        text = f"all {count} executions {verb}: {_WHY.get(outcome, _OTHERWISE)}"
        yield Diagnostic("single_outcome" if count >= _ENOUGH else "few_outcomes", text, *record.only_run)


def _is_simulated(record: Record, run: str) -> bool:
    start = record.starts.get(run)
    return start is not None and start.is_simulated
