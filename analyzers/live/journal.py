"""A run that is being recorded: follow its journal, and draw what is new."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import polars as pl

from hrclog.analyzers.figures import run_figures
from hrclog.analyzers.live.run import LiveRun
from hrclog.analyzers.live.streams import RunStream
from hrclog.analyzers.projections.intervals import rebuild
from hrclog.analyzers.projections.runs import runs
from hrclog.errors import LogReadError
from hrclog.log.checks import usable
from hrclog.log.files.system import exists
from hrclog.log.follow import JournalFollower, News, is_being_written
from hrclog.log.logs import Logs
from hrclog.log.messages.signals import SIGNAL_COLUMNS

QUIET_NS: Final = 60_000_000_000
"""A journal counts as abandoned if it has not grown for so long and the system does not know its writer."""

_CLOCK_NS: Final = 10_000_000  # the resolution of a file's time of change


class LiveJournal:
    """A journal that is followed, and the recording of its run in a viewer; `is_alive` while it is being written.

    Args:
        path: the journal.
        url: of the viewer.
        tell: receives what cannot be read.
        earlier: returns the events that earlier logs hold of a run that this journal continues.
        new_id: returns an id for another recording of a run.
    """

    def __init__(
        self,
        path: Path,
        url: str,
        tell: Callable[[str], None],
        earlier: Callable[[str], pl.DataFrame],
        new_id: Callable[[str], str],
    ) -> None:
        self._path = path
        self._url = url
        self._tell = tell
        self._earlier = earlier
        self._new_id = new_id
        self._follower = JournalFollower(path)
        self.is_alive = True
        self._run: LiveRun | None = None
        self._stream: RunStream | None = None
        self._changed_ns = 0
        self._was_held = False  # a recorder was seen writing it
        self._let_go = False  # and no recorder was seen at the last look
        self._told_texts: set[str] = set()

    @property
    def is_drawn(self) -> bool:
        """Return whether the run has a recording in the viewer."""
        return self._stream is not None

    @property
    def run_id(self) -> str:
        """Return the id of the run, "" while it is not known."""
        return self._run.run_id if self._run is not None else ""

    def look(self, *, draw: bool = True) -> bool:
        """Take in and draw what is new, and return whether there was anything.

        Args:
            draw: draw the run even if it is not alive and has not been drawn so far.
        """
        fresh = False
        more = True
        while more:
            news = self._read_news()
            more = news is not None and news.more
            fresh |= news is not None and self._take(news)
        was_alive, self.is_alive = self.is_alive, self._has_recorder()
        if self._run is not None and (self._stream is not None or self.is_alive or (fresh and draw)):
            self._draw(self._run, fresh=fresh, woke=was_alive != self.is_alive)
        return fresh

    def finish(self, logs: Logs) -> None:
        """Draw the rest of the run, now that its log is complete.

        Args:
            logs: the log that the journal has become. It counts among the earlier logs by now.
        """
        if self._run is None and logs.events.height:
            self._run = self._new_run(logs.events.head(0), str(logs.events["run_id"][0]))
        run = self._run
        if run is None:
            return
        stream = self._open(run)
        # on the clock of the drawing so far, even if earlier events have turned up
        events = self._earlier(run.run_id).with_columns(pl.col("time_ns").clip(run.origin_ns))
        run.take_log(events, logs.signals, logs.scene)
        stream.send(run.part(run.latest_ns, alive=False))
        executions, _ = rebuild(events)
        row = runs(events, executions).row(0, named=True)
        stream.send(run.last_part(run_figures(row, executions, events, SIGNAL_COLUMNS.to_frame())))
        stream.name(run.name)
        self.close()

    def close(self) -> None:
        """Disconnect from the viewer."""
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    def _read_news(self) -> News | None:
        try:
            return self._follower.look()
        except LogReadError as error:
            self._tell_once(str(error))
            return None

    def _take(self, news: News) -> bool:
        """Take in news of the journal, and return whether there were events or samples."""
        self._changed_ns = news.changed_ns
        for diagnostic in news.diagnostics:
            self._tell_once(str(diagnostic))
        if news.restarted:
            self._run = None
            self.close()
        if self._run is not None:
            self._run.take(news.events, news.signals, news.scene)
        elif news.events.height:
            self._run = self._new_run(news.events, str(news.events["run_id"][0]))
            if self._run is not None:
                self._run.take(news.events.head(0), news.signals, news.scene)
        return bool(news.events.height or news.signals.height)

    def _new_run(self, events: pl.DataFrame, run_id: str) -> LiveRun | None:
        events = usable(pl.concat([self._earlier(run_id), events]))
        return LiveRun(events) if events.height else None

    def _has_recorder(self) -> bool:
        is_held = is_being_written(self._path)
        if is_held is None and not exists(self._path):  # it has become a log
            return True
        self._was_held |= bool(is_held)
        let_go, self._let_go = self._let_go, self._was_held and not is_held
        if self._was_held:  # a recorder that closes its log releases the journal before the log replaces it
            return bool(is_held) or not let_go
        return bool(is_held) or time.time_ns() - self._changed_ns <= QUIET_NS

    def _draw(self, run: LiveRun, *, fresh: bool, woke: bool) -> None:
        is_new = self._stream is None
        stream = self._open(run)
        now_ns = run.latest_ns
        if self.is_alive and not run.has_ended:
            now_ns += max(0, time.time_ns() - self._changed_ns - _CLOCK_NS)
        if fresh or woke or is_new or self.is_alive:
            stream.send(run.part(now_ns, alive=self.is_alive or run.has_ended))
        is_abandoned = not self.is_alive and not run.has_ended
        stream.name(f"{run.name} ({'unfinished' if is_abandoned else 'live'})")
        if is_abandoned:
            remedy = f"hrclog recover {self._path} closes the log"
            self._tell_once(f"{self._path}: its recorder has gone, what was open is shown as unfinished; {remedy}")

    def _open(self, run: LiveRun) -> RunStream:
        if self._stream is None:
            self._stream = RunStream(self._url, run.figures, self._new_id(run.run_id))
        return self._stream

    def _tell_once(self, text: str) -> None:
        if text not in self._told_texts:
            self._told_texts.add(text)
            self._tell(text)
