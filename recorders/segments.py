"""Where the next piece of a run goes: its first log, or one more segment after a stop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hrclog.errors import InvalidEventError, LogExistsError, LogReadError
from hrclog.events import TaskFact, from_row, parse_details
from hrclog.ids import new_id
from hrclog.log.reader import read_logs
from hrclog.log.recover import recover
from hrclog.log.writer import PARTIAL_SUFFIX
from hrclog.state import PLANNED, ExecutionState, apply


@dataclass(frozen=True, slots=True)
class Segment:
    """A file to write, and what the run has come to before it."""

    path: Path
    run_id: str
    number: int = 1
    next_seq: int = 0
    name: str = ""
    states: Mapping[str, ExecutionState] = field(default_factory=dict)
    facts: Mapping[str, TaskFact] = field(default_factory=dict)


def first_segment(path: Path) -> Segment:
    """Return the segment of a new run.

    Raises:
        LogExistsError: a log or a journal of that name exists.
    """
    for existing in (path, _journal(path)):
        if existing.exists():
            raise LogExistsError(existing, "choose another name, or continue that run with resume=True")
    return Segment(path, new_id())


def next_segment(path: Path) -> Segment:
    """Return the segment that continues a run; a journal that a killed recorder left is closed first.

    Raises:
        LogReadError: there is no run to continue.
    """
    number = 1
    while (existing := segment_path(path, number)).exists() or _journal(existing).exists():
        if _journal(existing).exists():
            recover(_journal(existing), existing)
        number += 1
    if number == 1:
        raise LogReadError(path, "nothing", "a run to continue", "record it without resume")
    events = read_logs([segment_path(path, n) for n in range(1, number)]).events
    if events["run_id"].n_unique() != 1:
        raise LogReadError(path, f"{events['run_id'].n_unique()} runs", "one run to continue", "name its own log")
    states, facts = _fold(events.iter_rows(named=True))
    return Segment(
        path=segment_path(path, number),
        run_id=events["run_id"][0],
        number=number,
        next_seq=int(events["seq"].max()) + 1,  # type: ignore[arg-type]  # an int64 column
        name=_name(events.filter(events["kind"] == "run_started").rows(named=True)),
        states=states,
        facts=facts,
    )


def segment_path(path: Path, number: int) -> Path:
    """Return the file of a segment: NAME.mcap, NAME.2.mcap, NAME.3.mcap, …"""
    return path if number == 1 else path.with_name(f"{path.stem}.{number}.mcap")


def _journal(path: Path) -> Path:
    return path.with_name(path.name + PARTIAL_SUFFIX)


def _fold(rows: Any) -> tuple[dict[str, ExecutionState], dict[str, TaskFact]]:  # noqa: ANN401 - an iterator of row dicts
    states: dict[str, ExecutionState] = {}
    facts: dict[str, TaskFact] = {}
    for row in rows:
        event = from_row(row)
        if isinstance(event, TaskFact):
            states[event.execution_id] = apply(states.get(event.execution_id, PLANNED), event)[0]
            facts.setdefault(event.execution_id, event)
    return states, facts


def _name(rows: list[dict[str, Any]]) -> str:
    for row in rows:
        try:
            return str(parse_details(row["details"]).get("name", ""))
        except InvalidEventError:
            continue
    return ""
