"""Statistics that follow the runs: made apart, and put in place at once, if they are of the runs that are there."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

import polars as pl

from hrclog.knowledge.base import KnowledgeBase
from hrclog.knowledge.records import RunRecord, results_frame, statistics_id
from hrclog.knowledge.rows import frame_schema
from hrclog.knowledge.tables import TASK_RESULTS
from hrclog.knowledge.view import StatisticsEntry, View
from hrclog.knowledge.write import Taught, clear_runs, put_run, put_statistics

_TRIES: Final = 3


@dataclass(frozen=True, slots=True)
class Method:
    """How statistics are made.

    Attributes:
        estimator: its name.
        version: grows when the same runs give other statistics.
        outliers: which executions it leaves out.
        teach: makes statistics of a frame of intervals.
    """

    estimator: str
    version: int
    outliers: str
    teach: Callable[[pl.DataFrame], Taught]

    def made_from(self, runs: tuple[tuple[str, str], ...]) -> StatisticsEntry:
        """Return what statistics of runs, given as (run_id, digest), are made from."""
        key = statistics_id(runs, self.estimator, self.version, self.outliers)
        return StatisticsEntry(key, self.estimator, self.version, self.outliers, runs)


def update(kb: KnowledgeBase, method: Method) -> bool:
    """Bring statistics up to date, and return whether anything had to be done.

    They are made while others may write; if the runs changed meanwhile, again, and at last with the others waiting.

    Args:
        kb: the knowledge base.
        method: how statistics are made.

    Raises:
        KnowledgeError: the database fails.
    """
    for _ in range(_TRIES):
        with kb.view() as view:
            target = method.made_from(view.used_runs())
            if _is_current(view, target):
                return False
            results = view.results()
        statistics = method.teach(results)
        with kb.writing() as connection:
            view = View(connection)
            if view.used_runs() == target.runs:
                put_statistics(connection, statistics, target)
                return True
    with kb.writing() as connection:
        view = View(connection)
        put_statistics(connection, method.teach(view.results()), method.made_from(view.used_runs()))
    return True


def rebuild(kb: KnowledgeBase, runs: Iterable[RunRecord], method: Method) -> None:
    """Put runs and their statistics in the place of all that is there; withdrawals stay.

    Args:
        kb: the knowledge base.
        runs: each once.
        method: how statistics are made.

    Raises:
        KnowledgeError: the database fails; nothing has changed then.
    """
    by_id = {run.run_id: run for run in runs}
    with kb.view() as view:
        used_before = _used_runs(by_id, view)
    statistics = method.teach(_results(used_before))
    with kb.writing() as connection:
        view = View(connection)
        clear_runs(connection)
        for run in by_id.values():
            put_run(connection, run)
        used = _used_runs(by_id, view)
        if used != used_before:  # somebody withdrew a run meanwhile
            statistics = method.teach(view.results())
        put_statistics(connection, statistics, method.made_from(view.used_runs()))


def _is_current(view: View, target: StatisticsEntry) -> bool:
    existing = view.statistics()
    return existing is not None and existing.statistics_id == target.statistics_id


def _used_runs(runs: dict[str, RunRecord], view: View) -> list[RunRecord]:
    withdrawn = view.withdrawals()
    return [run for run_id, run in runs.items() if run_id not in withdrawn]


def _results(runs: list[RunRecord]) -> pl.DataFrame:
    """Return the executions of runs as a view would, a frame of intervals."""
    empty = pl.DataFrame(schema=frame_schema(TASK_RESULTS))
    return results_frame(pl.concat([empty, *(run.results for run in runs)])).with_columns(pl.lit("").alias("path"))
