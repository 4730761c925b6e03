"""Runs of a single agent."""

from __future__ import annotations

from collections.abc import Iterator

from hrclog.analyzers.projections.lints.record import Record
from hrclog.diagnostic import Diagnostic


def one_agent(record: Record) -> Iterator[Diagnostic]:
    """Say so if all runs have one and the same agent only."""
    agents = record.runs["agents"].explode(empty_as_null=False).unique().sort().to_list()
    if len(agents) == 1:
        yield Diagnostic("one_agent", f"{agents[0]!r} is the only agent: there are no synergies to estimate")
