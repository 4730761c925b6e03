"""Record the runs that another program writes as JSON lines: a log for each."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
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
from hrclog.recorders.json_lines import BEGINNINGS, check_first, run_facts, start_fact
from hrclog.recorders.line_run import LineRun, Recorded
from hrclog.recorders.line_times import check_times
from hrclog.recorders.recorder import Recorder, check_facts, log_path
from hrclog.recorders.run_label import RunLabel, take_label
from hrclog.recorders.sample_lines import Sample
from hrclog.recorders.segments import first_segment
from hrclog.tags import NO_TAGS, checked_tags
from hrclog.wording import counted

MAX_OPEN: Final = 32
"""So many runs are recorded side by side."""

_BYTE_ORDER_MARK: Final = "\ufeff"


@dataclass(frozen=True, slots=True)
class Refused:
    """A line that was not recorded, and the reason."""

    line: int
    reason: str


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

    A line is an event with the fields of `TaskEvent`, or a sample of one of `SAMPLE_KINDS`. `kind` must be there.
    `time_ns` defaults to now, `outcome` to succeeded; `seq` is the recorder's, and so is the `run_id` in the log. A
    start without an `execution_id` gets a new one; another task event without one means the open execution of that
    agent and task. Unknown fields are refused; further facts belong into `details`. Empty lines are passed over.

    A run begins with the first line that can be recorded, at its `time_ns` if it has one. A `run_started` line also
    gives the name, the agents and its other fields; one that follows task events begins another run, as does a line
    with a new `run_id` or `run`. A run ends with `run_ended`, with the start of another run if its lines do not name
    it, or with the lines; where no `run_ended` ends it, then at the `time_ns` of its last line, if that line has one.
    Runs that lines name go on side by side, `MAX_OPEN` at most. The first run goes to `path`, each further one to the
    first free name of NAME-run2.mcap, NAME-run3.mcap and so on.

    Args:
        lines: text lines.
        path: the log of the first run; missing folders are made, and a symbolic link is the file that it points to.
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
class _Runs:
    """The runs of a stream of lines: one after the other, or side by side where lines say which they belong to."""

    path: Path
    run: str
    resume: bool
    fsync: bool
    tags: Mapping[str, str]
    hooks: Hooks
    finished: list[Recorded] = field(default_factory=list)
    refused: list[Refused] = field(default_factory=list)
    losses: tuple[str, ...] = ()
    _n_begun: int = 0
    _open: dict[int, LineRun] = field(default_factory=dict)  # by number, in the order of their last lines
    _by_key: dict[str, LineRun] = field(default_factory=dict)
    _ended: dict[str, str] = field(default_factory=dict)  # why, by key
    _current: LineRun | None = None
    _may_have_missed_start: bool = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        with ExitStack() as stack:
            for run in self._open.values():
                stack.callback(run.recorder.__exit__, kind, error, traceback)

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
        """Finish all runs when the lines have ended; no lines at all are a run without events.

        Raises:
            InvalidEventError: no line could be recorded.
        """
        if not self._n_begun:
            if self.refused:
                lines = counted(len(self.refused), "line")
                text = f"{self.path}: found {lines} of which none can be recorded, expected events; nothing was written"
                raise InvalidEventError(text)
            self._open_run({}, None, RunLabel())
        for _, run in sorted(self._open.items()):
            self._finish(run)
        self.finished.sort(key=lambda recorded: recorded.number)

    def _take(self, value: dict[str, Any]) -> None:
        label = take_label(value)
        run = self._run_of(label, value.get("kind"))
        check_times(value, run.first_ns if run else None)
        if value.get("kind") == RunStarted.kind:
            self._begin(value, label, run)
            return
        if run is None:
            run = self._begin_without_start(value, label)
        taken = run.take(value)
        self._go_on_with(run, label)
        if isinstance(taken, Sample):
            self.hooks.on_sample(taken)
            return
        self.hooks.on_event(taken)
        if isinstance(taken, RunEnded):
            self._finish(run, RunEnded.kind)

    def _run_of(self, label: RunLabel, kind: object) -> LineRun | None:
        """Return the open run that a line belongs to: the one it names, or without a name that of the line before.

        A run that no line named yet is the one that a new name means, unless a further task begins with it.
        """
        current = self._current
        if not label.key:
            return current
        if label.key in self._by_key:
            return self._by_key[label.key]
        if current is None or current.is_named or label.key in self._ended:
            return None
        goes_on = isinstance(kind, str) and kind in TASK_KINDS and kind not in BEGINNINGS
        return current if goes_on or not current.n_task_events else None

    def _begin(self, value: dict[str, Any], label: RunLabel, run: LineRun | None) -> None:
        """Begin the run of a `run_started` line; it ends the run before it, unless lines name that one.

        Args:
            value: the line.
            label: what it calls its run.
            run: the open run that the line may be meant for.
        """
        facts = run_facts(value)
        check_facts(facts["run"], facts.get("agents", ()), facts.get("software"), facts.get("seed"))
        facts["tags"] = checked_tags(facts.get("tags"))
        if run is not None and not run.n_task_events:
            if run.opening is None:
                raise InvalidEventError(
                    "found run_started after the run began, expected it in the first line or not at all"
                )
            if run.opening == value and label.key in ("", run.key):
                raise InvalidEventError("found the run_started of this run a second time, expected it once")
        if run is not None and label.key and run.key == label.key:
            self._finish(run, "")
        self._open_run(facts, value, label)

    def _begin_without_start(self, value: dict[str, Any], label: RunLabel) -> LineRun:
        """Begin a run with a line that is not its `run_started`.

        It is the first line, or one whose `run_started` was refused, or the first that names its run.
        """
        kind = value.get("kind")
        check_first(value)
        if label.key in self._ended:
            text = f"found {kind} of run {label.key!r} after {self._ended[label.key]}"
            raise IllegalEventError(f"{text}, expected nothing more of it, or another run_started")
        if self._n_begun and not label.key and not (self._may_have_missed_start and kind in BEGINNINGS):
            raise IllegalEventError(f"found {kind} after run_ended, expected nothing more, or another run_started")
        is_resumed = self.resume and not self._n_begun
        if not is_resumed and kind in TASK_KINDS and kind not in BEGINNINGS:
            place = f"{kind} of {value.get('agent')!r}, {value.get('task')!r}"
            raise InvalidEventError(f"{place}: found 0 open executions, expected a task_started before it")
        return self._open_run({"run": ""} | start_fact(value), None, label)

    def _open_run(self, facts: dict[str, Any], opening: Mapping[str, Any] | None, label: RunLabel) -> LineRun:
        self._make_room()
        number = self._n_begun + 1
        path = self.path if number == 1 else _free_path(self.path)
        resumes = self.resume and number == 1
        name = facts.get("run", "") or ("" if resumes else label.run or label.run_id)
        facts = facts | {"run": (self.run if number == 1 else "") or name, "resume": resumes}
        _make_folder(path)
        recorder = Recorder(path, fsync=self.fsync, **facts | {"tags": {**self.tags, **facts.get("tags", {})}})
        self._n_begun = number
        self.losses += recorder.losses
        for text in recorder.losses:
            self.hooks.on_loss(text)
        self._may_have_missed_start = False
        run = LineRun(recorder, number, opening, key=label.key or name, first_ns=_first_ns(recorder, facts))
        if run.key:
            self._by_key[run.key] = run
        self._open[number] = run
        self._go_on_with(run, label, is_start=True)
        return run

    def _go_on_with(self, run: LineRun, label: RunLabel, *, is_start: bool = False) -> None:
        """Remember that a line of a run was taken, and what it calls the run."""
        if self._current is not run:
            if self._current is not None:
                self._current.left_ns = self._current.recorder.now_ns()
            self._current = run
            self._open[run.number] = self._open.pop(run.number)
        if label.key:
            run.is_named = True
            run.key = run.key or label.key
            for key in filter(None, (label.run_id, label.run)):
                self._by_key[key] = run
                self._ended.pop(key, None)
        if not is_start:
            run.is_named_by_lines |= bool(label.key)
            run.has_unnamed_lines |= not label.key

    def _make_room(self) -> None:
        """End the runs that the start of another ends, and where too many are open, the one that was left first."""
        for run in [run for run in self._open.values() if run.ends_with_next]:
            self._finish(run, "another run began")
        if len(self._open) >= MAX_OPEN:
            self._finish(next(iter(self._open.values())), f"{MAX_OPEN} other runs went on since its last line")

    def _finish(self, run: LineRun, why: str = "") -> None:
        """Close the log of a run.

        Args:
            run: which.
            why: what ended it, for lines that name it later.
        """
        result = run.end(self.hooks.outcome())
        del self._open[run.number]
        for key in [key for key, named in self._by_key.items() if named is run]:
            del self._by_key[key]
            self._ended[key] = why
        if self._current is run:
            self._current = None
        self.finished.append(result)
        self.hooks.on_run(result)


def _first_ns(recorder: Recorder, facts: Mapping[str, Any]) -> int | None:
    """Return an instant by which the clock of a run that begins is known, None if nothing tells it."""
    stated: int | None = facts.get("time_ns")
    return stated if recorder.resumed_ns is None else recorder.resumed_ns


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
