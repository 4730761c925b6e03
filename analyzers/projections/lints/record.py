"""What lints look at: the events of some runs and what was made of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import polars as pl

from hrclog.analyzers.projections.lints.run_start import RunStart, run_starts
from hrclog.diagnostic import Diagnostic
from hrclog.events import AnnotationAdded, StatisticsUpdated

Lint = Callable[["Record"], Iterable[Diagnostic]]
"""Finds one thing, or a few that belong together."""

_AFTERWARDS: Final = (AnnotationAdded.kind, StatisticsUpdated.kind)


@dataclass(frozen=True)
class Record:
    """The events of some runs, and frames of the schemas `INTERVALS`, `OVERLAPS` and `RUNS`."""

    events: pl.DataFrame
    intervals: pl.DataFrame
    overlaps: pl.DataFrame
    runs: pl.DataFrame

    @cached_property
    def happened(self) -> pl.DataFrame:
        """Return the events without what was said or computed afterwards, which may be days later."""
        return self.events.filter(~pl.col("kind").is_in(_AFTERWARDS))

    @cached_property
    def starts(self) -> Mapping[str, RunStart]:
        """Return by run what it declares of itself; runs without a `run_started` or a plan have no entry."""
        return run_starts(self.events)

    @cached_property
    def names(self) -> Mapping[str, str]:
        """Return the name of each run."""
        return dict(self.runs.select("run_id", "name").iter_rows())

    @cached_property
    def paths(self) -> Mapping[str, str]:
        """Return the first file of each run."""
        return dict(self.runs.select("run_id", "path").iter_rows())

    @cached_property
    def only_run(self) -> tuple[str, str]:
        """Return path and id of the run if there is just one, else two empty texts."""
        rows = self.runs.select("path", "run_id").rows()
        return rows[0] if len(rows) == 1 else ("", "")
