"""A knowledge base: runs and what was learnt from them, in SQLite or PostgreSQL.

It is a projection of the logs. Its state is a function of the set of runs that it was given, of those that were
withdrawn, and of the estimator: neither the order matters, nor how often, nor by how many processes.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from hrclog.errors import KnowledgeError
from hrclog.knowledge.database import Database
from hrclog.knowledge.view import RunEntry, StatisticsEntry, View

if TYPE_CHECKING:
    from hrclog.knowledge.properties import TaskProperties
    from hrclog.knowledge.records import RunRecord
    from hrclog.knowledge.task_times import TaskTimes


class KnowledgeBase(Database):
    """Runs, their executions, and statistics of them, in a database.

    Args:
        where: a file, sqlite:///FILE or postgresql://USER@HOST/DATABASE.
        create: make an empty one where nothing is.
        wait_s: how long to wait while another process writes.

    Raises:
        KnowledgeError: it cannot be reached, or is something else.
    """

    @contextmanager
    def view(self) -> Iterator[View]:
        """Give one state to read from, whatever others write meanwhile."""
        with self.reading() as connection:
            yield View(connection, self.where)

    def runs(self) -> list[RunEntry]:
        """Return all runs, withdrawn ones too, by (start_ns, run_id)."""
        with self.view() as view:
            return view.runs()

    def times(self) -> TaskTimes:
        """Return the task times for judging plans; none if there are no statistics yet."""
        with self.view() as view:
            return view.times()

    def properties(self) -> list[TaskProperties]:
        """Return the tasks as the latest run that is not withdrawn declares each, sorted by name."""
        with self.view() as view:
            return view.properties()

    def statistics(self) -> StatisticsEntry | None:
        """Return what the statistics are made from, None where there are none yet."""
        with self.view() as view:
            return view.statistics()

    def put(self, run: RunRecord) -> str:
        """Keep a run, in a transaction of its own; return added, replaced or unchanged."""
        from hrclog.knowledge.write import put_run

        with self.writing() as connection:
            return put_run(connection, run)

    def withdraw(self, run: str, reason: str = "") -> str:
        """Leave a run out of statistics from their next update on, also if it is given again; return its id.

        Args:
            run: its id or, where only one run has it, its name.
            reason: why.

        Raises:
            KnowledgeError: no run, or several, are meant.
        """
        return self._put_withdrawal(run, reason)

    def undo_withdrawal(self, run: str) -> str:
        """Take a withdrawn run back into statistics, and return its id; arguments as those of `withdraw`."""
        return self._put_withdrawal(run, None)

    def _put_withdrawal(self, run: str, reason: str | None) -> str:
        from hrclog.knowledge.rows import clean_text
        from hrclog.knowledge.write import put_withdrawal

        with self.writing() as connection:
            view = View(connection)
            run_id = _find_run_id(self.where, run, view)
            put_withdrawal(connection, run_id, None if reason is None else clean_text(reason))
            return run_id


def _find_run_id(where: str, run: str, view: View) -> str:
    """Return the id of the run with an id or a name."""
    runs = view.runs()
    if any(run == entry.run_id for entry in runs) or run in view.withdrawals():
        return run
    run_ids = [entry.run_id for entry in runs if entry.name == run]
    if len(run_ids) == 1:
        return run_ids[0]
    reason = f"{len(run_ids)} runs are named {run!r}" if run_ids else f"no run has the id or the name {run!r}"
    remedy = f"give one of their ids: {', '.join(run_ids[:4])}" if run_ids else "hrclog kb show lists them"
    raise KnowledgeError(where, reason, remedy)
