"""Record the runs that another program writes as JSON lines: a log for each."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from hrclog.errors import IllegalEventError, InvalidEventError, LogWriteError
from hrclog.events import TASK_KINDS, Event, Outcome, RunEnded, RunStarted
from hrclog.log.files.system import exists
from hrclog.log.messages.json_rows import parse_object
from hrclog.log.writing.journal import journal_path
from hrclog.recorders.json_lines import (
    BEGINNINGS,
    SIGNAL,
    Sample,
    check_first,
    check_unit,
    event_of,
    run_facts,
    sample_of,
    start_fact,
)
from hrclog.recorders.recorder import Recorder, check_facts, log_path
from hrclog.recorders.segments import first_segment
from hrclog.tags import NO_TAGS, checked_tags
from hrclog.wording import counted

_BYTE_ORDER_MARK: Final = "\ufeff"


@dataclass(frozen=True, slots=True)
class Refused:
    """A line that was not recorded, and the reason."""

    line: int
    reason: str


@dataclass(frozen=True, slots=True)
class Recorded:
    """A run that was recorded, in its finished log."""

    path: Path
    run_id: str
    n_events: int
    n_samples: int


@dataclass(frozen=True, slots=True)
class Recording:
    """The result of recording a stream of lines: its runs, what was not recorded, and what was lost before."""

    runs: list[Recorded]
    refused: list[Refused]
    losses: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Hooks:
    """What is called while lines are recorded.

    Attributes:
        on_event: called after each event has been written.
        on_sample: called after each sample has been written.
        on_refusal: called for each line that is not recorded, at once.
        on_run: called after each log has been finished.
        on_loss: called for each thing that was found lost of the run that is resumed.
        outcome: asked for the outcome of a run that no `run_ended` ended.
    """

    on_event: Callable[[Event], None] = lambda _: None
    on_sample: Callable[[Sample], None] = lambda _: None
    on_refusal: Callable[[Refused], None] = lambda _: None
    on_run: Callable[[Recorded], None] = lambda _: None
    on_loss: Callable[[str], None] = lambda _: None
    outcome: Callable[[], str] = lambda: Outcome.SUCCEEDED


def record_stream(
    lines: Iterable[str],
    path: Path,
    *,
    run: str = "",
    resume: bool = False,
    fsync: bool = False,
    tags: Mapping[str, str] = NO_TAGS,
    hooks: Hooks | None = None,
) -> Recording:
    """Record runs from JSON lines until they end.

    A line is an event with the fields of `TaskEvent`, or a sample of signals. `kind` must be there. `time_ns` defaults
    to now, `outcome` to succeeded; `run_id` and `seq` are the recorder's. A start without an `execution_id` gets a new
    one; another task event without one means the open execution of that agent and task. Unknown fields are refused;
    further facts belong into `details`. Empty lines are passed over.

    A run begins with the first line that can be recorded, at its `time_ns` if it has one. A `run_started` line also
    gives the name, the agents and its other fields; one that follows task events begins another run. A run ends with
    `run_ended`, with the `run_started` of another run, or with the lines; where no `run_ended` ends it, then at the
    `time_ns` of its last line, if that line has one. The first run goes to `path`, each further one to the first free
    name of NAME-run2.mcap, NAME-run3.mcap and so on.

    Args:
        lines: text lines.
        path: the log of the first run; missing folders are made.
        run: name of the first run; default what its `run_started` says, or the file's.
        resume: the first run continues the one that is at `path`.
        fsync: each event also survives a crash of the operating system.
        tags: facts of every run; those of a `run_started` line stand above them.
        hooks: what is called on the way.

    Raises:
        InvalidEventError: lines were given, and none can be recorded; nothing is written.
        LogExistsError: the log exists.
        LogWriteError: a log cannot be written.
    """
    if not resume:
        first_segment(log_path(path))  # say so before waiting for input
    with _Runs(log_path(path), run, resume=resume, fsync=fsync, tags=tags, hooks=hooks or Hooks()) as runs:
        for number, line in enumerate(lines, 1):
            runs.take_line(number, line if number > 1 else line.removeprefix(_BYTE_ORDER_MARK))
        runs.end()
    return Recording(runs.finished, runs.refused, runs.losses)


@dataclass(slots=True)
class _OpenRun:
    """A run that is being recorded: its recorder, the `run_started` line that began it, and its counts so far."""

    recorder: Recorder
    start_ns: int
    opening: Mapping[str, Any] | None
    n_events: int = 0
    n_samples: int = 0
    n_task_events: int = 0
    last_ns: int | None = None

    def take(self, value: Mapping[str, Any]) -> Event | Sample:
        """Record the event or the sample of a line."""
        if value.get("kind") == SIGNAL:
            sample = sample_of(value)
            for name, number in sample.values.items():
                self.recorder.signal(name, number, time_ns=sample.time_ns)
            self.n_samples += len(sample.values)
            self._remember_time(sample.time_ns)
            return sample
        event = event_of(value, (handle.fact for handle in self.recorder.open_executions()))
        recorded = self.recorder.record(event)
        self.n_events += 1
        self.n_task_events += event.kind in TASK_KINDS
        self._remember_time(None if value.get("time_ns") is None else recorded.time_ns)
        return recorded

    def result(self) -> Recorded:
        """Return what was recorded."""
        return Recorded(self.recorder.path, self.recorder.run_id, self.n_events, self.n_samples)

    def _remember_time(self, time_ns: int | None) -> None:
        self.last_ns = None if time_ns is None else max(time_ns, self.last_ns or 0)


@dataclass(slots=True)
class _Runs:
    """The runs of a stream of lines, one after the other."""

    path: Path
    run: str
    resume: bool
    fsync: bool
    tags: Mapping[str, str]
    hooks: Hooks
    finished: list[Recorded] = field(default_factory=list)
    refused: list[Refused] = field(default_factory=list)
    losses: tuple[str, ...] = ()
    _current: _OpenRun | None = None
    _may_have_missed_start: bool = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._current is not None:
            self._current.recorder.__exit__(kind, error, traceback)

    def take_line(self, number: int, line: str) -> None:
        """Record a line, or refuse it."""
        if not line.strip():
            return
        try:
            self._take(parse_object(line))
        except (InvalidEventError, IllegalEventError) as error:
            self._may_have_missed_start |= isinstance(error, InvalidEventError) and self._current is None
            refused = Refused(number, str(error))
            self.refused.append(refused)
            self.hooks.on_refusal(refused)

    def end(self) -> None:
        """Finish the last run when the lines have ended; no lines at all are a run without events.

        Raises:
            InvalidEventError: no line could be recorded.
        """
        if self._current is None and not self.finished:
            if self.refused:
                lines = counted(len(self.refused), "line")
                text = f"{self.path}: found {lines} of which none can be recorded, expected events; nothing was written"
                raise InvalidEventError(text)
            self._open({}, None)
        self._finish()

    def _take(self, value: dict[str, Any]) -> None:
        check_unit(value, self._current.start_ns if self._current else None)
        if value.get("kind") == RunStarted.kind:
            self._begin(value)
            return
        current = self._current or self._begin_without_start(value)
        taken = current.take(value)
        if isinstance(taken, Sample):
            self.hooks.on_sample(taken)
            return
        self.hooks.on_event(taken)
        if isinstance(taken, RunEnded):
            self._finish()

    def _begin(self, value: dict[str, Any]) -> None:
        """Begin the run of a `run_started` line; it ends the run before it."""
        facts = run_facts(value)
        check_facts(facts["run"], facts.get("agents", ()), facts.get("software"), facts.get("seed"))
        facts["tags"] = checked_tags(facts.get("tags"))
        if self._current is not None and not self._current.n_task_events:  # it may be meant for this run
            if self._current.opening is None:
                raise InvalidEventError(
                    "found run_started after the run began, expected it in the first line or not at all"
                )
            if self._current.opening == value:
                raise InvalidEventError("found the run_started of this run a second time, expected it once")
        self._finish()
        self._open(facts, value)

    def _begin_without_start(self, value: dict[str, Any]) -> _OpenRun:
        """Begin a run with a line that is not its `run_started`: the first, or one whose `run_started` was refused."""
        kind = value.get("kind")
        check_first(value)
        if self.finished and not (self._may_have_missed_start and kind in BEGINNINGS):
            raise IllegalEventError(f"found {kind} after run_ended, expected nothing more, or another run_started")
        if not self.resume and kind in TASK_KINDS and kind not in BEGINNINGS:
            place = f"{kind} of {value.get('agent')!r}, {value.get('task')!r}"
            raise InvalidEventError(f"{place}: found 0 open executions, expected a task_started before it")
        return self._open({"run": ""} | start_fact(value), None)

    def _open(self, facts: dict[str, Any], opening: Mapping[str, Any] | None) -> _OpenRun:
        is_first = not self.finished
        path = self.path if is_first else _free_path(self.path)
        if is_first:
            facts = facts | {"run": self.run or facts.get("run", ""), "resume": self.resume}
        _make_folder(path)
        recorder = Recorder(path, fsync=self.fsync, **facts | {"tags": {**self.tags, **facts.get("tags", {})}})
        self.losses += recorder.losses
        for text in recorder.losses:
            self.hooks.on_loss(text)
        self._may_have_missed_start = False
        self._current = _OpenRun(recorder, facts.get("time_ns", recorder.now_ns()), opening)
        return self._current

    def _finish(self) -> None:
        """Close the log of the current run, if there is one."""
        if self._current is None:
            return
        self._current.recorder.close(self.hooks.outcome(), time_ns=self._current.last_ns)
        result, self._current = self._current.result(), None
        self.finished.append(result)
        self.hooks.on_run(result)


def _free_path(path: Path) -> Path:
    """Return the first of NAME-run2.mcap, NAME-run3.mcap and so on that does not exist, neither as a journal."""
    paths = (path.with_name(f"{path.stem}-run{number}.mcap") for number in count(2))
    return next(free for free in paths if not exists(free) and not exists(journal_path(free)))


def _make_folder(path: Path) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = f"its folder cannot be made ({error.strerror})"
        raise LogWriteError(path, reason, "choose a folder that can be written") from error
