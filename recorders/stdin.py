"""Record events that another program writes as JSON lines."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Final

from hrclog.errors import IllegalEventError, InvalidEventError
from hrclog.event_rows import from_row, parse_details
from hrclog.events import COLUMNS, TASK_KINDS, Event, Outcome, Role, RunStarted, UnknownEvent
from hrclog.ids import new_id
from hrclog.log.json_rows import parse_object, row_from_object
from hrclog.recorders.recorder import Recorder, log_path
from hrclog.recorders.segments import first_segment
from hrclog.recorders.task_handle import instant
from hrclog.wording import counted

_RUN_FACTS: Final = ("name", "agents", "plan", "task_properties", "dispatch_mode", "software", "seed")
_BYTE_ORDER_MARK: Final = "\ufeff"


@dataclass(frozen=True, slots=True)
class Refused:
    """A line that was not recorded, and the reason."""

    line: int
    reason: str


@dataclass(frozen=True, slots=True)
class Recorded:
    """The result of recording a stream of lines."""

    path: Path
    run_id: str
    n_events: int
    refused: list[Refused]


def record_stream(
    lines: Iterable[str],
    path: Path,
    *,
    run: str = "",
    resume: bool = False,
    fsync: bool = False,
    on_event: Callable[[Event], None] = lambda _: None,
    on_refusal: Callable[[Refused], None] = lambda _: None,
    outcome: Callable[[], str] = lambda: Outcome.SUCCEEDED,
) -> Recorded:
    """Record a run from JSON lines until they end.

    The run begins with its first line. A `run_started` line gives the name, the agents and its other fields. Any other
    first line gives only the start of the run, by its `time_ns` if it has one. The run ends at the `time_ns` of its
    last line, if that line has one.

    Args:
        lines: text lines, see `record_lines`.
        path: the log to be.
        run: name of the run; default what a first `run_started` says, or the file's.
        resume: continue the run that is at `path`.
        fsync: each event also survives a crash of the operating system.
        on_event: called after each event has been written.
        on_refusal: called for each line that is not recorded, at once.
        outcome: asked at the end for the outcome of a run that no `run_ended` ended.

    Raises:
        LogExistsError: the log exists.
        LogWriteError: the log cannot be written.
    """
    if not resume:
        first_segment(log_path(path))  # say so before waiting for input
    rest = iter(lines)
    head = list(_lines_until_text(rest))
    opening, consumed = _opening_facts(head[-1]) if head else ({}, 0)
    facts = {"run": run or opening.pop("name", ""), **opening}
    with _open_recorder(path, facts, len(head), resume=resume, fsync=fsync) as recorder:
        remaining = chain(head[len(head) - 1 + consumed :], rest)
        first_number = max(len(head), 1) + consumed
        n_events, refused, last_ns = record_lines(remaining, recorder, on_event, on_refusal, first_number)
        recorder.close(outcome(), time_ns=last_ns)
    return Recorded(recorder.path, recorder.run_id, n_events, refused)


def record_lines(
    lines: Iterable[str],
    recorder: Recorder,
    on_event: Callable[[Event], None] = lambda _: None,
    on_refusal: Callable[[Refused], None] = lambda _: None,
    first_number: int = 1,
) -> tuple[int, list[Refused], int | None]:
    """Record one event per line: a JSON object with the fields of `TaskEvent`.

    `kind` must be there. `time_ns` defaults to now, `outcome` to succeeded; `run_id` and `seq` are the recorder's. A
    start without an `execution_id` gets a new one; another task event without one means the open execution of that
    agent and task. Unknown fields are refused; further facts belong into `details`.

    Args:
        lines: text lines; empty ones are passed over.
        recorder: takes the events.
        on_event: called after each event has been written.
        on_refusal: called for each line that is not recorded, at once.
        first_number: of the first of these lines.

    Returns:
        How many events were recorded, the lines that were refused, and the instant of the last event if its line
        said when it happened.
    """
    count = 0
    last_ns: int | None = None
    refused: list[Refused] = []
    for number, line in enumerate(lines, first_number):
        if not line.strip():
            continue
        try:
            value = parse_object(line)
            recorded = recorder.record(_event_of(value, recorder))
        except (InvalidEventError, IllegalEventError) as error:
            refused.append(Refused(number, str(error)))
            on_refusal(refused[-1])
            continue
        count += 1
        last_ns = None if value.get("time_ns") is None else max(recorded.time_ns, last_ns or 0)
        on_event(recorded)
    return count, refused, last_ns


def _lines_until_text(lines: Iterator[str]) -> Iterator[str]:
    """Yield lines up to the first that is not empty, without a byte order mark."""
    for number, line in enumerate(lines):
        text = line.removeprefix(_BYTE_ORDER_MARK) if not number else line
        yield text
        if text.strip():
            return


def _open_recorder(path: Path, facts: dict[str, Any], line: int, *, resume: bool, fsync: bool) -> Recorder:
    """Open a recorder with the facts of the first line. If they are invalid, there is no run to record into."""
    try:
        return Recorder(path, resume=resume, fsync=fsync, **facts)
    except InvalidEventError as error:
        raise InvalidEventError(f"line {line}: {error}; nothing was recorded") from error


def _opening_facts(line: str) -> tuple[dict[str, Any], int]:
    """Return the facts that the first line states about the run, and 1 if it states nothing else, else 0."""
    try:
        value = parse_object(line)
        row = row_from_object(value)
        details = parse_details(row["details"])
    except InvalidEventError:
        return {}, 0
    start_fact = {} if row["time_ns"] is None else {"time_ns": row["time_ns"]}
    if row["kind"] != RunStarted.kind:
        return start_fact, 0
    _check_fields(value, (*COLUMNS, *_RUN_FACTS))
    facts = {name: value.get(name, details.get(name)) for name in _RUN_FACTS}
    return start_fact | {name: fact for name, fact in facts.items() if fact is not None}, 1


def _event_of(value: dict[str, Any], recorder: Recorder) -> Event:
    _check_fields(value)
    row = row_from_object(value)
    row["time_ns"] = instant(row["time_ns"])
    row["seq"] = 0
    row["role"] = row["role"] or Role.PRIMARY.value
    if row["kind"] in ("task_ended", "run_ended"):
        row["outcome"] = row["outcome"] or Outcome.SUCCEEDED.value
    if row["kind"] in TASK_KINDS and not row["execution_id"]:
        row["execution_id"] = _execution_id(row, recorder)
    event = from_row(row)
    if isinstance(event, UnknownEvent):
        raise InvalidEventError(f"kind is {row['kind']!r}, expected one of the vocabulary (see docs/events.md)")
    if isinstance(event, RunStarted):
        raise InvalidEventError("found run_started after the run began, expected it in the first line or not at all")
    return event


def _check_fields(value: dict[str, Any], known_names: tuple[str, ...] = COLUMNS) -> None:
    for name in value:
        if name not in known_names:
            similar_names = difflib.get_close_matches(name.lower(), known_names, 1)
            hint = f"did you mean {similar_names[0]!r}?" if similar_names else "put further facts into details"
            raise InvalidEventError(f"found the unknown field {name!r}, expected those of TaskEvent; {hint}")


def _execution_id(row: dict[str, Any], recorder: Recorder) -> str:
    """Return the execution id for a task event that has none."""
    if row["kind"] in ("task_started", "task_dispatched"):
        return new_id()
    open_ids = [
        handle.execution_id
        for handle in recorder.open_executions()
        if (handle.fact.agent, handle.fact.task) == (row["agent"], row["task"])
    ]
    if len(open_ids) == 1:
        return open_ids[0]
    raise InvalidEventError(
        f"{row['kind']} of {row['agent']!r}, {row['task']!r} names no execution_id: "
        f"found {counted(len(open_ids), 'open execution')} of that task, expected one"
    )
