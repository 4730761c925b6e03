"""Follow the runs that are recorded into a folder: show each in a viewer as it grows, and statistics as it ends."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import polars as pl

from hrclog.analyzers.figures import run_figures
from hrclog.analyzers.live.journal import LiveJournal
from hrclog.analyzers.live.statistics import EndedRuns, Statistics
from hrclog.analyzers.live.streams import CampaignStream, RunStream
from hrclog.analyzers.projections.intervals import rebuild
from hrclog.analyzers.projections.runs import runs
from hrclog.analyzers.result import Analysis
from hrclog.errors import LogReadError
from hrclog.log.annotations.exclusions import judged
from hrclog.log.files.system import exists
from hrclog.log.logs import Logs
from hrclog.log.one_log import read_annotated
from hrclog.log.watch import Listing, Stamp, finished_log, list_folder
from hrclog.wording import counted

EVERY_S: Final = 0.5
DRAWN_RUNS: Final = 3
"""How many of the runs that are found after their end are drawn: the latest ones."""

Tell = Callable[[str], None]
"""A function that takes a sentence for the user."""


@dataclass(slots=True)
class Followed:
    """The ids of the runs that were followed, and of those that have ended."""

    runs: set[str] = field(default_factory=set)
    ended: set[str] = field(default_factory=set)


def follow(
    folder: Path,
    url: str,
    wait: Callable[[float], bool],
    *,
    every_s: float = EVERY_S,
    until_idle_s: float | None = None,
    tell: Tell = lambda _: None,
    on_file: Callable[[Path], None] = lambda _: None,
    followed: Followed | None = None,
) -> Followed:
    """Follow the runs of a folder until `wait` says that it is enough.

    Args:
        folder: into which runs are recorded. Runs that are there already count in the statistics.
        url: of the viewer, `rerun+http://127.0.0.1:PORT/proxy`.
        wait: waits some seconds, and returns whether it is enough. Called with 0 before each log that is there already.
        every_s: seconds between looks.
        until_idle_s: also end after so many seconds without anything new.
        tell: receives what is not drawn, and what cannot be read.
        on_file: called after each log that is there already, for progress.
        followed: updated with the runs, so that callers know them even if this function fails.

    Raises:
        LogReadError: the folder does not exist, or no longer.
    """
    followed = Followed() if followed is None else followed
    live = _Live(folder, url, tell, followed)
    try:
        enough = not live.start(on_file, wait)
        last_news = time.monotonic()
        while not enough:
            began = time.monotonic()
            if live.look():
                last_news = began
            took = time.monotonic() - began
            enough = wait(max(every_s - took, took))  # rests for at least half of the time
            if until_idle_s is not None and time.monotonic() - last_news >= until_idle_s:
                live.statistics.finish()
                enough = True
    finally:
        live.close()
    return followed


class _Live:
    """A folder, the runs in it, and the recordings of them in a viewer."""

    def __init__(self, folder: Path, url: str, tell: Tell, followed: Followed) -> None:
        self._folder = folder
        self._url = url
        self._tell = tell
        self._followed = followed
        self._ended = EndedRuns()
        self._campaign: CampaignStream | None = None
        self.statistics = Statistics(self._ended, self._show)
        self._journals: dict[Path, LiveJournal] = {}
        self._read_stamps: dict[Path, Stamp] = {}  # logs as they were when they were read
        self._last_stamps: dict[Path, Stamp] = {}  # logs as they were at the last look
        self._n_recordings: Counter[str] = Counter()

    def start(self, on_file: Callable[[Path], None], wait: Callable[[float], bool]) -> bool:
        """Read the logs that are there, draw the latest of their runs, and return whether to go on."""
        listing = list_folder(self._folder)
        for path, stamp in listing.logs.items():
            if wait(0.0):
                return False
            self._read_log(path, stamp)
            on_file(path)
        self._last_stamps = dict(listing.logs)
        self._draw_latest(self._ended.starts(), "earlier")
        self.statistics.finish()  # before runs in progress, because a viewer shows what comes last
        self._find_journals(list_folder(self._folder))  # reading may have taken a while
        for journal in self._journals.values():
            journal.look(draw=False)
        stale = sum(not journal.is_alive for journal in self._journals.values())
        if stale:
            which = counted(stale, "unfinished log has", "unfinished logs have")
            remedy = f"hrclog recover {self._folder} closes them"
            self._tell(f"{which} no recorder any more, and no part in the statistics: {remedy}")
        return True

    def look(self) -> bool:
        """Take in and draw what is new, and return whether there was anything."""
        listing = list_folder(self._folder)
        fresh = self._take_logs(listing)
        self._find_journals(listing)
        for path, journal in list(self._journals.items()):
            if path in listing.journals:
                fresh |= journal.look()
                self._followed.runs |= {journal.run_id} if journal.is_drawn else set()
            elif not (exists(path) or exists(finished_log(path))):
                self._tell(f"{path}: the journal is gone, and there is no log in its place")
                journal.close()
                del self._journals[path]
        self.statistics.step()
        return fresh

    def close(self) -> None:
        """Disconnect from the viewer."""
        self.statistics.close()
        for journal in self._journals.values():
            journal.close()
        if self._campaign is not None:
            self._campaign.close()

    def _find_journals(self, listing: Listing) -> None:
        for path in listing.journals:
            if path not in self._journals:
                self._journals[path] = LiveJournal(path, self._url, self._tell, self._ended.events_of, self._new_id)

    def _take_logs(self, listing: Listing) -> bool:
        """Read new logs, finish the runs whose journals became logs, and forget logs that are gone."""
        gone = self._read_stamps.keys() - listing.logs.keys()
        for path in gone:
            self._ended.drop(path)
            del self._read_stamps[path]
            self.statistics.changed()
        finished = {finished_log(path): path for path in self._journals}
        changed = {path: stamp for path, stamp in listing.logs.items() if self._read_stamps.get(path) != stamp}
        # a log without a journal seen before may still be being copied
        new = {
            path: stamp for path, stamp in changed.items() if path in finished or self._last_stamps.get(path) == stamp
        }
        self._last_stamps = dict(listing.logs)
        new_paths: list[Path] = []
        for path, stamp in new.items():
            logs = self._read_log(path, stamp)
            if path in finished:
                self._finish(self._journals.pop(finished[path]), logs)
            elif logs is not None:
                new_paths.append(path)
        if new_paths:
            starts = self._ended.starts().filter(pl.col("path").is_in([str(path) for path in new_paths]))
            self._followed.runs.update(starts["run_id"])
            self._followed.ended.update(starts["run_id"])
            self._draw_latest(starts, "further")
        return bool(gone or changed)

    def _finish(self, journal: LiveJournal, logs: Logs | None) -> None:
        if logs is None:
            journal.close()
            return
        journal.finish(logs)
        self._followed.runs.add(journal.run_id)
        self._followed.ended.add(journal.run_id)

    def _read_log(self, path: Path, stamp: Stamp) -> Logs | None:
        """Take a log into the statistics, and tell the user what cannot be read."""
        self._read_stamps[path] = stamp
        self._ended.drop(path)
        self.statistics.changed()
        try:
            logs = read_annotated(path, signals=True)
        except LogReadError as error:
            self._tell(str(error))
            return None
        for diagnostic in logs.diagnostics:
            if diagnostic.severity == "error":
                self._tell(str(diagnostic))
        self._ended.put(path, logs)
        return logs

    def _draw_latest(self, starts: pl.DataFrame, which: str) -> None:
        """Draw the latest of some runs, and tell the user how many others there are."""
        n_others = max(starts.height - DRAWN_RUNS, 0)
        if n_others:
            others = counted(n_others, f"{which} run is", f"{which} runs are")
            self._tell(f"{others} in the statistics, not drawn: hrclog view FILE shows one")
        for run_id, path in starts.tail(DRAWN_RUNS).select("run_id", "path").iter_rows():
            logs = read_annotated(Path(path), signals=True)
            events = judged(self._ended.events_of(run_id)).events
            executions, _ = rebuild(events)
            row = runs(events, executions).row(0, named=True)
            signals = logs.signals.filter(pl.col("run_id") == run_id)
            figures = run_figures(row, executions, events, signals, logs.scene.of_run(run_id))
            stream = RunStream(self._url, figures, self._new_id(run_id))
            stream.name(figures.name)
            stream.send_whole(figures)
            stream.close()

    def _new_id(self, run_id: str) -> str:
        """Return a new id for a recording of a run."""
        self._n_recordings[run_id] += 1
        return run_id if self._n_recordings[run_id] == 1 else f"{run_id}-{self._n_recordings[run_id]}"

    def _show(self, analysis: Analysis) -> None:
        if self._campaign is None:
            self._campaign = CampaignStream(self._url, f"campaign-{time.time_ns()}")
        self._campaign.send(analysis.campaign_figures())
