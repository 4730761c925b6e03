"""The data of ended runs that statistics need, and their analysis in the background."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import polars as pl

from hrclog.analyzers.analysis import analyze_logs
from hrclog.analyzers.projections.metrics import MINIMUM_DISTANCE
from hrclog.analyzers.projections.schemas import SIGNALS
from hrclog.analyzers.result import Analysis
from hrclog.diagnostic import Diagnostic
from hrclog.log.annotations.exclusions import excluded_runs, exclusion_diagnostics, judged
from hrclog.log.checks import check_events, usable, without_copies
from hrclog.log.logs import ORDER, Logs
from hrclog.log.messages.message import EVENTS


@dataclass(frozen=True, slots=True)
class _KeptLog:
    """The parts of a log that are kept. Of its signals, these are the smallest distances, by run and name."""

    events: pl.DataFrame
    distances: dict[tuple[str, str], pl.Series]
    diagnostics: list[Diagnostic]


class EndedRuns:
    """The runs that have ended, by the log that holds them."""

    def __init__(self) -> None:
        self._logs: dict[Path, _KeptLog] = {}

    def put(self, path: Path, logs: Logs) -> None:
        """Take in a log, in place of an earlier one under the same path."""
        distance_signals = logs.signals.filter(pl.col("name").str.split("/").list.last() == MINIMUM_DISTANCE)
        parts = distance_signals.group_by("run_id", "name", maintain_order=True)
        distances = {(str(run), str(name)): part["value"] for (run, name), part in parts}
        self._logs[path] = _KeptLog(logs.events, distances, logs.diagnostics)

    def drop(self, path: Path) -> None:
        """Forget a log."""
        self._logs.pop(path, None)

    def starts(self) -> pl.DataFrame:
        """Return one row per run that counts, the earliest first: run_id, start_ns and the path of its last log."""
        run_starts = (
            judged(self._events())
            .events.group_by("run_id")
            .agg(pl.col("time_ns").min().alias("start_ns"), pl.col("path").sort_by("time_ns").last())
        )
        return run_starts.sort("start_ns", "run_id")

    def events_of(self, run_id: str) -> pl.DataFrame:
        """Return a run's events, schema `EVENTS`, in order."""
        return usable(self._events().filter(pl.col("run_id") == run_id)).sort(ORDER, maintain_order=True)

    def logs(self) -> Logs:
        """Return all logs together, as if they had been read at once."""
        told = self._events()
        whole_runs = excluded_runs([told])
        left_out = {entry.run_id for entry in whole_runs}
        events, copies = without_copies(told.filter(~pl.col("run_id").is_in(sorted(left_out))))
        events = events.sort(ORDER, maintain_order=True)
        logs = [self._logs[path] for path in sorted(self._logs)]
        diagnostics = [diagnostic for log in logs for diagnostic in log.diagnostics]
        signals = [
            pl.DataFrame({"value": values}).select(
                pl.lit(run).alias("run_id"), pl.lit(name).alias("name"), pl.lit(0).alias("time_ns"), "value"
            )
            for log in logs
            for (run, name), values in log.distances.items()
            if run not in left_out
        ]
        verdict = judged(usable(events))
        exclusions = [*whole_runs, *verdict.exclusions]
        diagnostics += [*copies, *check_events(events), *exclusion_diagnostics(exclusions)]
        samples = pl.concat([SIGNALS.to_frame(), *(part.cast(SIGNALS) for part in signals)])
        paths = sorted(self._logs)
        return Logs(verdict.events, samples, diagnostics, paths, excluded=verdict.excluded, exclusions=exclusions)

    def _events(self) -> pl.DataFrame:
        return pl.concat([EVENTS.to_frame(), *(self._logs[path].events for path in sorted(self._logs))])


class Statistics:
    """Analyses the ended runs in a separate thread, and again if the runs have changed by then.

    Args:
        ended: the runs.
        show: receives each analysis, in that thread.
    """

    def __init__(self, ended: EndedRuns, show: Callable[[Analysis], None]) -> None:
        self._ended = ended
        self._show = show
        self._thread = ThreadPoolExecutor(1, "hrclog-statistics")
        self._under_way: Future[None] | None = None
        self._due = False

    def changed(self) -> None:
        """Note that the runs have changed."""
        self._due = True

    def step(self) -> bool:
        """Begin an analysis if one is due and none is running. Return whether all is done."""
        if self._under_way is not None and self._under_way.done():
            self._under_way.result()
            self._under_way = None
        if self._due and self._under_way is None:
            self._due = False
            logs = self._ended.logs()
            if logs.events.height:
                self._under_way = self._thread.submit(lambda: self._show(analyze_logs(logs)))
        return self._under_way is None and not self._due

    def finish(self) -> None:
        """Wait until all is done."""
        while not self.step():
            if self._under_way is not None:
                self._under_way.result()

    def close(self) -> None:
        """Stop the thread after its current analysis."""
        self._thread.shutdown(wait=True, cancel_futures=True)
