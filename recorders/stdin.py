"""Record events that another program writes as JSON lines."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from hrclog.errors import IllegalEventError, InvalidEventError
from hrclog.event_rows import from_row
from hrclog.events import TASK_KINDS, Event, Outcome, Role, RunStarted, UnknownEvent
from hrclog.ids import new_id
from hrclog.log.json_rows import parse_object, row_from_object
from hrclog.recorders.recorder import Recorder
from hrclog.recorders.task_handle import instant


@dataclass(frozen=True, slots=True)
class Refused:
    """A line that is not in the log, and why."""

    line: int
    reason: str


def record_lines(
    lines: Iterable[str],
    recorder: Recorder,
    on_event: Callable[[Event], None] = lambda _: None,
    on_refusal: Callable[[Refused], None] = lambda _: None,
) -> tuple[int, list[Refused]]:
    """Record one event per line: a JSON object with the fields of `TaskEvent`.

    `kind` must be there. `time_ns` defaults to now, `outcome` to succeeded; `run_id` and `seq` are the recorder's. A
    start without an `execution_id` gets a new one; another task event without one means the open execution of that
    agent and task.

    Args:
        lines: text lines; empty ones are passed over.
        recorder: takes the events.
        on_event: called after each event has been written.
        on_refusal: called for each line that is not recorded, at once.

    Returns:
        How many events were recorded, and the lines that were refused.
    """
    count = 0
    refused: list[Refused] = []
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            recorded = recorder.record(_event(parse_object(line), recorder))
        except (InvalidEventError, IllegalEventError) as error:
            refused.append(Refused(number, str(error)))
            on_refusal(refused[-1])
            continue
        count += 1
        on_event(recorded)
    return count, refused


def _event(value: dict[str, Any], recorder: Recorder) -> Event:
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
        raise InvalidEventError("found run_started, which the recorder writes itself; name the run with --run")
    return event


def _execution_id(row: dict[str, Any], recorder: Recorder) -> str:
    """Return the id that a task event without one means."""
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
        f"found {len(open_ids)} open executions of that task, expected one"
    )
