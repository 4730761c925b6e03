"""A run that is being recorded from JSON lines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hrclog.errors import InvalidEventError
from hrclog.events import TASK_KINDS, Event
from hrclog.recorders.json_lines import event_of
from hrclog.recorders.recorder import Recorder
from hrclog.recorders.sample_lines import Sample, is_sample, sample_of


@dataclass(frozen=True, slots=True)
class Recorded:
    """A run that was recorded, in its finished log.

    Attributes:
        path: the log.
        run_id: of the run.
        n_events: that lines said.
        n_samples: that lines said.
        number: of the run among those of the stream, from 1 in the order in which they began.
        remarks: what may be wrong with it.
    """

    path: Path
    run_id: str
    n_events: int
    n_samples: int
    number: int = 1
    remarks: tuple[str, ...] = ()


@dataclass(slots=True, eq=False)
class LineRun:
    """A run that is being recorded from lines.

    Attributes:
        recorder: of the run.
        number: of the run, from 1.
        opening: the `run_started` line that began it, without what it calls the run; None where another line did.
        key: what lines may call it, "" for nothing.
        first_ns: the first instant that a line of it stated.
        last_ns: when its last line happened, None where that line has no `time_ns`.
        left_ns: the recorder's clock when lines of another run came.
        is_named: whether a line has named it.
        is_named_by_lines: whether another line than its `run_started` has.
        has_unnamed_lines: whether lines belong to it that name no run.
    """

    recorder: Recorder
    number: int
    opening: Mapping[str, Any] | None
    key: str = ""
    first_ns: int | None = None
    last_ns: int | None = None
    left_ns: int | None = None
    is_named: bool = False
    is_named_by_lines: bool = False
    has_unnamed_lines: bool = False
    n_events: int = 0
    n_samples: int = 0
    n_task_events: int = 0
    _told_once: set[str] = field(default_factory=set)
    _bodies: set[str] = field(default_factory=set)
    _posed: dict[str, None] = field(default_factory=dict)

    @property
    def ends_with_next(self) -> bool:
        """Return whether the start of another run ends it; one that lines name may go on beside others."""
        return not self.key or (self.has_unnamed_lines and not self.is_named_by_lines)

    def take(self, value: Mapping[str, Any]) -> Event | Sample:
        """Record the event or the sample of a line."""
        return self._take_sample(sample_of(value)) if is_sample(value) else self._take_event(value)

    def end(self, outcome: str) -> Recorded:
        """Finish the log, with the outcome of a run that no line ended; return what was recorded."""
        self.recorder.close(outcome, time_ns=self.left_ns if self.last_ns is None else self.last_ns)
        path, run_id = self.recorder.path, self.recorder.run_id
        return Recorded(path, run_id, self.n_events, self.n_samples, self.number, self._remarks())

    def _take_event(self, value: Mapping[str, Any]) -> Event:
        event = event_of(value, lambda: (handle.fact for handle in self.recorder.open_executions()))
        recorded = self.recorder.record(event)
        self.n_events += 1
        self.n_task_events += event.kind in TASK_KINDS
        self._remember_time(None if value.get("time_ns") is None else recorded.time_ns)
        return recorded

    def _take_sample(self, sample: Sample) -> Sample:
        if sample.once and sample.once in self._told_once:
            raise InvalidEventError(
                f"found {sample.once} a second time, expected it once per run; poses tell what moves"
            )
        sample.write(self.recorder)
        if sample.once:
            self._told_once.add(sample.once)
            self._bodies.update(sample.bodies)
        if sample.kind == "pose":
            self._posed[sample.names[0]] = None
        self.n_samples += max(len(sample.names), 1)
        self._remember_time(sample.time_ns)
        return sample

    def _remember_time(self, time_ns: int | None) -> None:
        self.last_ns = None if time_ns is None else max(time_ns, self.last_ns or 0)
        if self.first_ns is None:
            self.first_ns = time_ns

    def _remarks(self) -> tuple[str, ...]:
        """Return what may be wrong: a body whose name was misspelt stands still."""
        unknown = [name for name in self._posed if name not in self._bodies]
        if not unknown or "the scene" not in self._told_once:
            return ()
        names = ", ".join(map(repr, unknown[:5])) + (f" and {len(unknown) - 5} more" if len(unknown) > 5 else "")
        return (f"poses of {names} are recorded and not drawn: no box of the scene has that name",)
