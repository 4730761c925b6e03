"""Runs as a knowledge base keeps them, and by what it tells two versions of one run apart."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

import polars as pl

from hrclog.event_rows import readable_details
from hrclog.events import COLUMNS, RunEnded, RunStarted
from hrclog.knowledge.properties import TaskProperties, declared_properties, snapshot_id
from hrclog.knowledge.rows import clean, clean_text
from hrclog.knowledge.tables import RESULT_ORDER, TASK_RESULTS
from hrclog.log.annotations.said import said_in
from hrclog.log.logs import ORDER
from hrclog.log.remarks import said_among, without_said

_TOTAL_ORDER: Final = (*ORDER, *(name for name in COLUMNS if name not in ORDER))
_UNSET: Final = (None, "")


@dataclass(frozen=True, slots=True)
class Version:
    """One state of a run's log: the one with more events supersedes the other, of equally many that of larger digest.

    So the order in which the states are met does not matter.
    """

    n_events: int
    digest: str

    def supersedes(self, other: Version | None) -> bool:
        """Return whether this version replaces the other one."""
        return other is None or (self.n_events, self.digest) > (other.n_events, other.digest)


@dataclass(frozen=True, slots=True)
class RunRecord:
    """A run: what it declares, and its executions, a frame with the columns of `TASK_RESULTS`."""

    run_id: str
    version: Version
    name: str
    outcome: str
    start_ns: int
    tasks: tuple[TaskProperties, ...]
    results: pl.DataFrame

    @property
    def snapshot(self) -> str:
        """Return the id of what it declares of tasks."""
        return snapshot_id(self.tasks)


def in_order(events: pl.DataFrame) -> pl.DataFrame:
    """Return events, each once, in an order that is the same however they were read."""
    ordered = events.sort(_TOTAL_ORDER, nulls_last=True, maintain_order=True)
    return ordered.unique(subset=COLUMNS, keep="first", maintain_order=True)


def versions(events: pl.DataFrame) -> dict[str, Version]:
    """Return the version of each run that has events.

    Args:
        events: an events frame, as `in_order` gives it.
    """
    return {run: _version(part) for run, part in _parts(events).items()}


def run_records(events: pl.DataFrame, intervals: pl.DataFrame, known: dict[str, Version]) -> list[RunRecord]:
    """Return what a knowledge base keeps of runs, by their ids.

    Args:
        events: an events frame, as `in_order` gives it.
        intervals: the executions in it; columns that are not those of `TASK_RESULTS` are left out.
        known: the runs' versions.
    """
    results = _parts(results_frame(intervals))
    empty = results_frame(intervals.clear())
    return [_record(run, part, known[run], results.get(clean_text(run), empty)) for run, part in _parts(events).items()]


def results_frame(intervals: pl.DataFrame) -> pl.DataFrame:
    """Return intervals with the columns of `TASK_RESULTS`, ordered."""
    return clean(intervals.select(TASK_RESULTS.columns.keys())).sort(RESULT_ORDER)


def _parts(frame: pl.DataFrame) -> dict[str, pl.DataFrame]:
    parts = frame.partition_by("run_id", as_dict=True)
    return {str(key[0]): parts[key] for key in sorted(parts)}


def _version(events: pl.DataFrame) -> Version:
    """Return the version of one run.

    Unset columns do not count, so that further columns change nothing; nor do tags and notes that were said of the run
    afterwards. What was said to count no longer, or again, is behind the digest: the more was said, the later it is.
    """
    recorded = without_said(events)
    digest = _digest(recorded)
    said = said_among(events)
    judging = said.filter([bool(said_in(details).judgements) for details in said["details"]])
    suffix = f":{judging.height:06}-{_digest(judging)[:16]}" if judging.height else ""
    return Version(recorded.height, digest + suffix)


def _digest(events: pl.DataFrame) -> str:
    sha = hashlib.sha256()
    for values in events.select(COLUMNS).iter_rows():
        fields = {name: value for name, value in zip(COLUMNS, values, strict=True) if value not in _UNSET}
        sha.update(json.dumps(fields, ensure_ascii=False, sort_keys=True).encode() + b"\n")
    return sha.hexdigest()


def _record(run_id: str, events: pl.DataFrame, version: Version, results: pl.DataFrame) -> RunRecord:
    by_seq = events.sort("seq", maintain_order=True)
    started = [readable_details(text) for text in _column_of_kind(by_seq, RunStarted.kind, "details")]
    outcomes = _column_of_kind(by_seq, RunEnded.kind, "outcome")
    names = [details["name"] for details in started if isinstance(details.get("name"), str)]
    declared = [tasks for tasks in map(_declared_tasks, started) if tasks]
    return RunRecord(
        run_id=clean_text(run_id),
        version=version,
        name=clean_text(next(filter(None, names), "")),
        outcome=clean_text(outcomes[-1]) if outcomes else "",
        start_ns=int(events["time_ns"][0]),
        tasks=declared[0] if declared else (),
        results=results,
    )


def _column_of_kind(events: pl.DataFrame, kind: str, column: str) -> list[str]:
    values: list[str] = events.filter(pl.col("kind") == kind)[column].to_list()
    return values


def _declared_tasks(details: dict[str, Any]) -> tuple[TaskProperties, ...]:
    return declared_properties(details.get("task_properties"))


def statistics_id(runs: Iterable[tuple[str, str]], estimator: str, version: int, outliers: str) -> str:
    """Return the SHA-256 of what statistics are made from.

    Args:
        runs: (run_id, digest).
        estimator: its name.
        version: of the estimators.
        outliers: which executions it leaves out.
    """
    return hashlib.sha256(json.dumps([sorted(runs), estimator, version, outliers]).encode()).hexdigest()
