"""The lints there are, in the order in which they are told."""

from __future__ import annotations

from typing import Final

import polars as pl

from hrclog.analyzers.projections.lints.crowded_runs import crowded_runs
from hrclog.analyzers.projections.lints.identical_durations import identical_durations
from hrclog.analyzers.projections.lints.idle_agents import idle_agents
from hrclog.analyzers.projections.lints.implausible_times import implausible_times
from hrclog.analyzers.projections.lints.long_executions import long_executions
from hrclog.analyzers.projections.lints.missing_from_plan import missing_from_plan
from hrclog.analyzers.projections.lints.one_agent import one_agent
from hrclog.analyzers.projections.lints.open_executions import open_executions
from hrclog.analyzers.projections.lints.outside_run import outside_run
from hrclog.analyzers.projections.lints.pauses import pauses_never_resumed
from hrclog.analyzers.projections.lints.record import Lint, Record
from hrclog.analyzers.projections.lints.self_overlaps import self_overlaps
from hrclog.analyzers.projections.lints.shared_ids import shared_ids
from hrclog.analyzers.projections.lints.short_runs import short_runs
from hrclog.analyzers.projections.lints.similar_names import alike_names
from hrclog.analyzers.projections.lints.single_outcome import single_outcome
from hrclog.analyzers.projections.lints.undeclared_agents import undeclared_agents
from hrclog.analyzers.projections.lints.unended_runs import unended_runs
from hrclog.analyzers.projections.lints.unlisted_pairs import unlisted_pairs
from hrclog.analyzers.projections.lints.wrong_units import wrong_units
from hrclog.analyzers.projections.lints.zero_durations import zero_durations
from hrclog.diagnostic import Diagnostic

LINTS: Final[tuple[Lint, ...]] = (
    open_executions,
    pauses_never_resumed,
    zero_durations,
    implausible_times,
    wrong_units,
    outside_run,
    missing_from_plan,
    short_runs,
    long_executions,
    identical_durations,
    self_overlaps,
    shared_ids,
    alike_names,
    undeclared_agents,
    idle_agents,
    single_outcome,
    one_agent,
    unlisted_pairs,
    crowded_runs,
    unended_runs,
)


def lint(events: pl.DataFrame, intervals: pl.DataFrame, overlaps: pl.DataFrame, runs: pl.DataFrame) -> list[Diagnostic]:
    """Return the lints of a set of runs, ordered by kind and run.

    Args:
        events: an events frame.
        intervals: the executions in it, schema `INTERVALS`.
        overlaps: of those, schema `OVERLAPS`.
        runs: schema `RUNS`.
    """
    record = Record(events, intervals, overlaps, runs)
    return [diagnostic for find in LINTS for diagnostic in find(record)]
