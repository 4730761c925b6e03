"""Find the file for the next part of a run: its first log, or a further segment after a stop."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any

import polars as pl

from hrclog.errors import InvalidEventError, LogExistsError, LogReadError
from hrclog.event_rows import from_row, parse_details
from hrclog.events import TaskFact
from hrclog.ids import new_id
from hrclog.log.files.system import exists
from hrclog.log.reader import read_logs
from hrclog.log.recover import drop_begun, recover
from hrclog.log.writing.journal import journal_path
from hrclog.state import PLANNED, ExecutionState, apply


@dataclass(frozen=True, slots=True)
class Segment:
    """A file to write, and the state of the run before it."""

    path: Path
    run_id: str
    number: int = 1
    next_seq: int = 0
    name: str = ""
    states: Mapping[str, ExecutionState] = field(default_factory=dict)
    facts: Mapping[str, TaskFact] = field(default_factory=dict)
    last_ns: int = 0


def first_segment(path: Path) -> Segment:
    """Return the segment of a new run.

    Raises:
        LogExistsError: a log or a journal of that name exists.
    """
    for existing in (path, journal_path(path), segment_path(path, 2), journal_path(segment_path(path, 2))):
        if exists(existing):
            remedy = "choose another name, or continue that run with resume=True (hrclog record --resume)"
            raise LogExistsError(existing, remedy)
    return Segment(path, new_id())


def next_segment(path: Path) -> Segment:
    """Return the segment that continues a run; a journal that a killed recorder left is closed first.

    A run that was killed before its first event is begun anew.

    Raises:
        LogReadError: there is no run to continue, or a recorder still writes it.
    """
    begun = exists(journal_path(path))
    number = next(n for n in count(1) if not _segment_exists(segment_path(path, n)))
    if number == 1 and begun:
        return first_segment(path)
    if number == 1:
        raise LogReadError(path, "nothing", "a run to continue", "record it without resume")
    events = read_logs([segment_path(path, n) for n in range(1, number)]).events
    n_runs = events["run_id"].n_unique()
    if n_runs != 1:
        raise LogReadError(path, f"{n_runs} runs", "one run to continue", "record under another name")
    return _continuing_segment(segment_path(path, number), number, events)


def segment_path(path: Path, number: int) -> Path:
    """Return the file of a segment, NAME.mcap, NAME.2.mcap and so on."""
    return path if number == 1 else path.with_name(f"{path.stem}.{number}.mcap")


def _segment_exists(path: Path) -> bool:
    """Return whether a segment exists, after closing its journal."""
    journal = journal_path(path)
    if exists(journal) and not drop_begun(journal):
        recover(journal, path)
    return exists(path)


def _continuing_segment(path: Path, number: int, events: pl.DataFrame) -> Segment:
    # in the order of writing, as the recorder before saw them
    states, facts = _fold_states(events.sort("seq", maintain_order=True).iter_rows(named=True))
    return Segment(
        path=path,
        run_id=events["run_id"][0],
        number=number,
        next_seq=int(events.select("seq").max().item()) + 1,
        name=_run_name(events.filter(events["kind"] == "run_started")["details"].to_list()),
        states=states,
        facts=facts,
        last_ns=int(events.select("time_ns").max().item()),
    )


def _fold_states(rows: Iterable[dict[str, Any]]) -> tuple[dict[str, ExecutionState], dict[str, TaskFact]]:
    states: dict[str, ExecutionState] = {}
    facts: dict[str, TaskFact] = {}
    for row in rows:
        event = from_row(row | {"details": ""})  # the state machine does not use them
        if isinstance(event, TaskFact):
            states[event.execution_id] = apply(states.get(event.execution_id, PLANNED), event)[0]
            facts.setdefault(event.execution_id, event)
    return states, facts


def _run_name(details: list[str]) -> str:
    for text in details:
        try:
            return str(parse_details(text).get("name", ""))
        except InvalidEventError:
            continue
    return ""
