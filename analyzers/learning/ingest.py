"""Logs into a knowledge base, and statistics from it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import polars as pl

from hrclog.analyzers.learning.learn import learn
from hrclog.analyzers.projections.intervals import rebuild as rebuild_intervals
from hrclog.analyzers.synergy.estimator import Estimator
from hrclog.analyzers.synergy.estimators import DEFAULT_ESTIMATOR, ESTIMATORS
from hrclog.analyzers.synergy.outlier_methods import OUTLIER_METHODS, Outliers
from hrclog.diagnostic import Diagnostic, loses_data
from hrclog.errors import KnowledgeError
from hrclog.event_rows import to_row
from hrclog.events import Event
from hrclog.knowledge.base import KnowledgeBase
from hrclog.knowledge.records import RunRecord, Version, in_order, run_records, versions
from hrclog.knowledge.update import Method, update
from hrclog.knowledge.update import rebuild as rebuild_from
from hrclog.knowledge.write import Taught
from hrclog.log.annotations.exclusions import exclusion_diagnostics, exclusions_in, judged
from hrclog.log.checks import usable
from hrclog.log.clocks.correction import NO_CLOCKS, Clocks
from hrclog.log.logs import Logs
from hrclog.log.messages.decode import frame_of_rows
from hrclog.log.messages.message import EVENTS
from hrclog.log.reader import read_logs
from hrclog.log.runs.where import ALL_RUNS, Where
from hrclog.plugins import PluginError
from hrclog.wording import counted


@dataclass(frozen=True, slots=True)
class Ingested:
    """Ids of the runs that were added, replaced by a later version of theirs, or there already; and what is wrong."""

    added: list[str] = field(default_factory=list)
    replaced: list[str] = field(default_factory=list)
    unchanged: list[str] = field(default_factory=list)
    diagnostics: list[Diagnostic] = field(default_factory=list)


def ingest_logs(
    kb: KnowledgeBase,
    paths: Iterable[str | Path],
    on_file: Callable[[Path], None] = lambda _: None,
    *,
    clocks: Clocks = NO_CLOCKS,
    where: Where = ALL_RUNS,
) -> Ingested:
    """Take in the runs of logs, folders and globs; what was taken in before adds nothing.

    Args:
        kb: the knowledge base.
        paths: what to read; the segments of a run belong together in one call.
        on_file: called after each file, for progress.
        clocks: by agent, how far its clock is ahead, in ns or as a text (+3600s); that is taken off its times.
        where: which runs, by their tags: texts such as participant=P01 or condition!=pilot, or values by key.

    Raises:
        LogReadError: nothing matched, or no file could be read.
        HrclogError: no event names an agent of `clocks`, or an offset is none; or no run is as `where` says.
        KnowledgeError: the database fails.
    """
    logs = read_logs(paths, on_file=on_file, clocks=clocks, where=where, with_excluded=True)
    ingested = ingest(kb, logs.events, _conflicting_ids(logs))
    return replace(ingested, diagnostics=[*logs.diagnostics, *ingested.diagnostics])


def ingest_events(kb: KnowledgeBase, events: Iterable[Event]) -> Ingested:
    """Take in the runs of events, as they would be read from their logs."""
    return ingest(kb, frame_of_events(events))


def ingest(kb: KnowledgeBase, events: pl.DataFrame, left_out: Iterable[str] = ()) -> Ingested:
    """Take in the runs of an events frame, each in a transaction of its own.

    Args:
        kb: the knowledge base.
        events: an events frame, with what annotations exclude: a run that was taken in before is then replaced.
        left_out: ids of runs that are not to be taken in.

    Raises:
        KnowledgeError: the database fails.
    """
    events = in_order(events.filter(~pl.col("run_id").is_in(list(left_out))))
    run_versions = versions(events)
    with kb.view() as view:
        known_versions = {run: Version(*version) for run, version in view.versions(list(run_versions)).items()}
    newer = {run: version for run, version in run_versions.items() if version.supersedes(known_versions.get(run))}
    part = events.filter(pl.col("run_id").is_in(list(newer)))
    intervals, illegal = rebuild_intervals(judged(part).events)
    changes = {run.run_id: kb.put(run) for run in run_records(part, intervals, newer)}
    return Ingested(
        [run for run, change in changes.items() if change == "added"],
        [run for run, change in changes.items() if change == "replaced"],
        [run for run in run_versions if changes.get(run, "unchanged") == "unchanged"],
        [*exclusion_diagnostics(exclusions_in(events)), *illegal],
    )


def update_statistics(kb: KnowledgeBase, estimator: str | None = None, outliers: Outliers | None = None) -> bool:
    """Bring statistics up to date with the runs, and return whether anything had to be done.

    Args:
        kb: the knowledge base.
        estimator: its name; default what the statistics were made with before, else aft.
        outliers: none or isolation-forest; default as before, else none.

    Raises:
        KnowledgeError: the estimator that the statistics were made with is not there.
        PluginError: the estimator that is asked for is not known.
        KnowledgeError: the database fails.
    """
    return update(kb, _method(kb, estimator, outliers))


def rebuild(
    kb: KnowledgeBase,
    paths: Iterable[str | Path],
    estimator: str | None = None,
    outliers: Outliers | None = None,
    on_file: Callable[[Path], None] = lambda _: None,
    *,
    clocks: Clocks = NO_CLOCKS,
    where: Where = ALL_RUNS,
) -> Ingested:
    """Rebuild everything from logs and swap it in at once; only withdrawals are kept.

    Args:
        kb: the knowledge base.
        paths: logs, folders and globs.
        estimator: as in `update_statistics`.
        outliers: as in `update_statistics`.
        on_file: called after each file, for progress.
        clocks: as in `ingest_logs`.
        where: as in `ingest_logs`.

    Raises:
        LogReadError: nothing matched, or no file could be read.
        HrclogError: no event names an agent of `clocks`, or an offset is none; or no run is as `where` says.
        KnowledgeError: the database fails; nothing has changed then.
    """
    logs = read_logs(paths, on_file=on_file, clocks=clocks, where=where, with_excluded=True)
    records, illegal = _records(logs.events.filter(~pl.col("run_id").is_in(_conflicting_ids(logs))))
    lost = {run.run_id for run in kb.runs()} - {run.run_id for run in records}
    if lost and loses_data(logs.diagnostics):
        which = counted(len(lost), "of its runs is", "of its runs are")
        raise KnowledgeError(
            kb.where,
            f"{which} not in these logs, of which not all could be read; nothing was changed",
            "hrclog check tells what is wrong with them, leave out those that are beyond repair",
        )
    rebuild_from(kb, records, _method(kb, estimator, outliers))
    return Ingested(added=[run.run_id for run in records], diagnostics=[*logs.diagnostics, *illegal])


def frame_of_events(events: Iterable[Event]) -> pl.DataFrame:
    """Return events as a frame, as it would be read from their log."""
    rows = frame_of_rows([to_row(event) for event in events])
    return usable(rows.with_columns(pl.lit("").alias("path")).select(EVENTS.names()))


def _records(events: pl.DataFrame) -> tuple[list[RunRecord], list[Diagnostic]]:
    events = in_order(events)
    intervals, illegal = rebuild_intervals(judged(events).events)
    said = exclusion_diagnostics(exclusions_in(events))
    return run_records(events, intervals, versions(events)), [*said, *illegal]


def _conflicting_ids(logs: Logs) -> list[str]:
    """Return the ids that two different runs carry: nothing can be learnt from a mixture."""
    return sorted({diagnostic.run_id for diagnostic in logs.diagnostics if diagnostic.code == "conflicting_runs"})


def _method(kb: KnowledgeBase, estimator: str | None, outliers: str | None) -> Method:
    statistics = kb.statistics()
    chosen_estimator = (
        ESTIMATORS[estimator]
        if estimator
        else _former_estimator(kb, statistics.estimator if statistics else DEFAULT_ESTIMATOR)
    )
    left_out = OUTLIER_METHODS[outliers or (statistics.outliers if statistics else OUTLIER_METHODS.default)].name

    def teach(intervals: pl.DataFrame) -> Taught:
        learnt = learn(intervals, chosen_estimator.name, left_out)
        return Taught(learnt.durations, learnt.synergies, learnt.times)

    return Method(ESTIMATORS.reference(chosen_estimator.name), chosen_estimator.version, left_out, teach)


def _former_estimator(kb: KnowledgeBase, estimator: str) -> Estimator:
    """Return the estimator that statistics were made with.

    Raises:
        KnowledgeError: it is not there.
    """
    try:
        return ESTIMATORS[estimator]
    except PluginError as error:
        complaint = f"its statistics were made by estimator {estimator!r}, which is not there ({error})"
        raise KnowledgeError(kb.where, complaint, "register it, or choose another with --estimator") from error
