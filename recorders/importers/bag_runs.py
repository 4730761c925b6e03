"""Facts of a recording into runs: divided, put in order, numbered by attempts and given ids."""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

from hrclog.diagnostic import Diagnostic
from hrclog.events import (
    LATEST_NS,
    Event,
    Outcome,
    RunEnded,
    RunStarted,
    SafetyStateChanged,
    TaskEnded,
    TaskFact,
    TaskStarted,
)
from hrclog.ids import derived_id
from hrclog.log.messages.encode import FloatSignal, JointSignal
from hrclog.recorders.mapping.executions import SOURCE
from hrclog.recorders.mapping.facts import Fact, RunMark
from hrclog.recorders.mapping.runs import RunRule
from hrclog.wording import counted

_RETRIED: Final = (Outcome.FAILED, Outcome.CANCELED, Outcome.TIMED_OUT)

_Sample = FloatSignal | JointSignal


@dataclass(frozen=True, slots=True)
class Run:
    """A run that was found in a recording."""

    name: str
    run_id: str
    events: Sequence[Event]
    samples: Sequence[_Sample]
    n_executions: int

    def called(self, name: str) -> Run:
        """Return the same run under another name."""
        if name == self.name:
            return self
        renamed = [replace(event, name=name) if isinstance(event, RunStarted) else event for event in self.events]
        return replace(self, name=name, events=renamed)


@dataclass(slots=True)
class _Draft:
    """A run in the making: its name, when it is (`is_marked`: as the source tells), and what is in it."""

    name: str
    begin: int
    end: int
    is_marked: bool = False
    ended: bool = True
    executions: list[list[TaskFact]] = field(default_factory=list)
    others: list[Event] = field(default_factory=list)
    samples: list[_Sample] = field(default_factory=list)


@dataclass(slots=True)
class _Sorted:
    """Facts by what they are."""

    executions: list[list[TaskFact]] = field(default_factory=list)
    others: list[Event] = field(default_factory=list)
    samples: list[_Sample] = field(default_factory=list)
    marks: list[RunMark] = field(default_factory=list)


def runs_of(
    name: str, facts: Sequence[Fact], rule: RunRule, details: Mapping[str, Any], path: str
) -> tuple[list[Run], list[Diagnostic]]:
    """Return the runs of a recording, and what could not go into one.

    Args:
        name: of the recording.
        facts: that it holds, on one clock.
        rule: where runs begin.
        details: of each `run_started`.
        path: of the recording.
    """
    diagnostics: list[Diagnostic] = []
    by_kind = _sorted(facts, diagnostics, path)
    drafts = _drafts(name, by_kind, rule)
    n_outside = _fill(drafts, by_kind)
    if n_outside:
        text = f"{counted(n_outside, 'execution was', 'executions were')} left out: outside of every run"
        diagnostics.append(Diagnostic("outside_runs", text, path))
    runs = [_run(draft, name, details) for draft in drafts if draft.executions or draft.others or draft.samples]
    return runs, diagnostics


def _sorted(facts: Sequence[Fact], diagnostics: list[Diagnostic], path: str) -> _Sorted:
    by_kind = _Sorted()
    executions: defaultdict[str, list[TaskFact]] = defaultdict(list)
    n_untimely = 0
    for fact in facts:
        content = fact.content
        if not 0 <= content.time_ns <= LATEST_NS:
            n_untimely += 1
        elif isinstance(content, RunMark):
            by_kind.marks.append(content)
        elif isinstance(content, TaskFact):
            executions[content.execution_id].append(content)
        elif isinstance(content, FloatSignal | JointSignal):
            by_kind.samples.append(content)
        else:
            by_kind.others.append(content)
    for events in executions.values():
        times = [event.time_ns for event in events]
        if times == sorted(times) and any(isinstance(event, TaskStarted) for event in events):
            by_kind.executions.append(events)
        else:
            text = f"{events[0].task!r} of {events[0].agent!r} was left out: it does not start before it ends"
            diagnostics.append(Diagnostic("skipped_message", text, path))
    if n_untimely:
        text = f"{counted(n_untimely, 'fact was', 'facts were')} left out: more than 73 years from 1970"
        diagnostics.append(Diagnostic("invalid_time", text, path))
    by_kind.executions.sort(key=_start)
    by_kind.others.sort(key=lambda event: event.time_ns)
    by_kind.samples.sort(key=lambda sample: sample.time_ns)
    by_kind.marks.sort(key=lambda mark: mark.time_ns)
    return by_kind


def _start(execution: Sequence[TaskFact]) -> int:
    return next(event.time_ns for event in execution if isinstance(event, TaskStarted))


def _drafts(name: str, by_kind: _Sorted, rule: RunRule) -> list[_Draft]:
    if rule.by == "topic":
        return list(_marked(name, by_kind.marks))
    if rule.by == "gap":
        return list(_divided(name, by_kind.executions, rule.gap_ns))
    return [_Draft(name, -1, LATEST_NS)]


def _marked(name: str, marks: Sequence[RunMark]) -> Iterator[_Draft]:
    for mark, following in zip(marks, [*marks[1:], None], strict=True):
        if mark.name:
            run_name = f"{name}_{mark.name}" if mark.name.isdecimal() else mark.name
            end = LATEST_NS if following is None else following.time_ns
            yield _Draft(run_name, mark.time_ns, end, is_marked=True, ended=following is not None)


def _divided(name: str, executions: Sequence[Sequence[TaskFact]], gap_ns: int) -> Iterator[_Draft]:
    """Divide where for longer than the gap nobody does anything."""
    spans: list[tuple[int, int]] = []
    for events in executions:
        begin, end = _start(events), events[-1].time_ns
        if spans and begin - spans[-1][1] <= gap_ns:
            spans[-1] = spans[-1][0], max(spans[-1][1], end)
        else:
            spans.append((begin, end))
    for number, (begin, end) in enumerate(spans, 1):
        yield _Draft(f"{name}_{number}", begin - gap_ns // 2, end + gap_ns // 2 + 1)


def _fill(drafts: Sequence[_Draft], by_kind: _Sorted) -> int:
    """Put executions, other events and samples where they belong; return how many executions belong nowhere."""
    n_outside = 0
    for events in by_kind.executions:
        draft = _draft_at(drafts, _start(events))
        if draft is None:
            n_outside += 1
        else:
            draft.executions.append(events)
    for event in by_kind.others:
        draft = _draft_at(drafts, event.time_ns)
        if draft is not None:
            draft.others.append(event)
    for sample in by_kind.samples:
        draft = _draft_at(drafts, sample.time_ns)
        if draft is not None:
            draft.samples.append(sample)
    for draft in drafts:
        _carry_safety(draft, by_kind.others)
    return n_outside


def _draft_at(drafts: Sequence[_Draft], time_ns: int) -> _Draft | None:
    at = bisect_right(drafts, time_ns, key=lambda draft: draft.begin) - 1
    return drafts[at] if at >= 0 and time_ns < drafts[at].end else None


def _carry_safety(draft: _Draft, others: Sequence[Event]) -> None:
    """Let a run begin in the safety states that were told before it."""
    if draft.begin < 0:
        return
    states = {
        event.agent: event for event in others if isinstance(event, SafetyStateChanged) and event.time_ns < draft.begin
    }
    told = {
        event.agent for event in draft.others if event.time_ns == draft.begin and isinstance(event, SafetyStateChanged)
    }
    carried = [replace(event, time_ns=draft.begin) for agent, event in sorted(states.items()) if agent not in told]
    draft.others[:0] = carried


def _run(draft: _Draft, recording: str, details: Mapping[str, Any]) -> Run:
    executions = _with_attempts(draft.executions)
    events = [event for _, event in sorted(_ranked(executions, draft.others), key=lambda item: item[0])]
    times = [event.time_ns for event in events] or [sample.time_ns for sample in draft.samples]
    begin = min(draft.begin, *times) if draft.is_marked else min(times)
    end = max(draft.end, *times) if draft.is_marked and draft.ended else max(times)
    first = [events[0].execution_id for events in executions if _start(events) == _start(executions[0])]
    run_id = derived_id(SOURCE, str(times[0]), *sorted(first))
    agents = tuple(sorted({events[0].agent for events in executions}))
    if draft.name != recording:
        details = {**details, "recording": recording}
    started = RunStarted(time_ns=begin, run_id=run_id, name=draft.name, agents=agents, details=details)
    is_ended = draft.ended if draft.is_marked else all(isinstance(events[-1], TaskEnded) for events in executions)
    whole = [started, *(replace(event, run_id=run_id) for event in events)]
    if is_ended:
        whole.append(RunEnded(time_ns=end, run_id=run_id))
    samples = [replace(sample, run_id=run_id) for sample in draft.samples]
    return Run(draft.name, run_id, whole, samples, len(executions))


def _with_attempts(executions: Sequence[Sequence[TaskFact]]) -> list[list[TaskFact]]:
    """Number the attempts: one more while the executions before, of the same agent and task, did not succeed."""
    last: dict[tuple[str, str], int] = {}
    numbered: list[list[TaskFact]] = []
    for execution in executions:
        key = (execution[0].agent, execution[0].task)
        attempt = last.get(key, 0) + 1
        numbered.append([replace(event, attempt=attempt) for event in execution])
        end = execution[-1]
        is_retried = isinstance(end, TaskEnded) and end.outcome in _RETRIED
        last[key] = attempt if is_retried else 0
    return numbered


def _ranked(
    executions: Sequence[Sequence[TaskFact]], others: Sequence[Event]
) -> Iterator[tuple[tuple[int, int, int], Event]]:
    """Yield events with keys that sort them: at one instant ends come before what begins."""
    number = 0
    for execution in executions:
        before = -1
        for event in execution:
            number += 1
            is_first_of_instant = event.time_ns > before
            rank = 0 if isinstance(event, TaskEnded) and is_first_of_instant else 2
            yield (event.time_ns, rank, number), event
            before = event.time_ns
    for other in others:
        number += 1
        yield (other.time_ns, 1, number), other
