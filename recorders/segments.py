"""Find the file for the next part of a run: its first log, or a further segment after a stop."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import polars as pl

from hrclog.errors import InvalidEventError, LogExistsError, LogReadError
from hrclog.event_rows import from_row, parse_details
from hrclog.events import TaskFact
from hrclog.ids import new_id
from hrclog.log.begun import Cleared, clear
from hrclog.log.files.system import exists
from hrclog.log.losses import Loss, loss_text
from hrclog.log.reader import read_logs
from hrclog.log.recover import Recovered, recover
from hrclog.log.writing.journal import PARTIAL_SUFFIX, journal_path
from hrclog.state import PLANNED, ExecutionState, apply


@dataclass(frozen=True, slots=True)
class Segment:
    """A file to write, and the state of the run before it.

    Attributes:
        path: the log to be.
        run_id: of the run.
        number: of the segment, from 1.
        next_seq: the sequence number of its first event.
        name: of the run, as far as it is known.
        states: of the executions so far.
        facts: the first fact of each execution.
        last_ns: the latest instant so far.
        losses: what destroyed journals held, of which no log is left that could tell of it.
        told: what was lost of the run when its journals were closed, in words.
    """

    path: Path
    run_id: str
    number: int = 1
    next_seq: int = 0
    name: str = ""
    states: Mapping[str, ExecutionState] = field(default_factory=dict)
    facts: Mapping[str, TaskFact] = field(default_factory=dict)
    last_ns: int = 0
    losses: tuple[Loss, ...] = ()
    told: tuple[str, ...] = ()


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
    """Return the segment that continues a run, behind all others; journals of killed recorders are closed first.

    A run of which no event is left is begun anew. What was lost of the run is in `losses`.

    Raises:
        LogReadError: there is no run to continue, or a recorder still writes it.
        LogWriteError: a journal cannot be closed.
    """
    numbers = _segment_numbers(path)
    if not numbers:
        raise LogReadError(path, "nothing", "a run to continue", "record it without resume")
    closed = [_close_journal(segment_path(path, number)) for number in numbers]
    losses = tuple(result.loss for result in closed if isinstance(result, Cleared) and result.loss is not None)
    told = tuple(filter(None, map(_loss_text, closed)))
    segments = [number for number in numbers if exists(segment_path(path, number))]
    if not segments:
        return replace(first_segment(path), losses=losses, told=told)
    logs = [segment_path(path, number) for number in segments]
    events = read_logs(logs, with_excluded=True).events  # what is excluded was recorded all the same
    n_runs = events["run_id"].n_unique()
    if n_runs != 1:
        raise LogReadError(path, f"{n_runs} runs", "one run to continue", "record under another name")
    number = segments[-1] + 1
    return replace(_continuing_segment(segment_path(path, number), number, events), losses=losses, told=told)


def segments(path: Path) -> list[Path]:
    """Return where the segments of a run are, logs or journals, in order; some may be missing between them."""
    return [segment_path(path, number) for number in _segment_numbers(path)]


def segment_path(path: Path, number: int) -> Path:
    """Return the file of a segment, NAME.mcap, NAME.2.mcap and so on."""
    return path if number == 1 else path.with_name(f"{path.stem}.{number}.mcap")


def _segment_numbers(path: Path) -> list[int]:
    """Return the numbers of the segments of a run, logs and journals, in order; some may be missing between them."""
    names = re.compile(rf"{re.escape(path.stem)}(?:\.([1-9]\d*))?\.mcap({re.escape(PARTIAL_SUFFIX)})?")
    try:
        matches = [names.fullmatch(entry.name) for entry in path.parent.iterdir()]
    except OSError:
        return []
    return sorted({int(match[1] or 1) for match in matches if match and match[1] != "1"})


def _close_journal(log: Path) -> Cleared | Recovered | None:
    """Close the journal of a segment, if there is one."""
    journal = journal_path(log)
    return (clear(journal) or recover(journal, log)) if exists(journal) else None


def _loss_text(closed: Cleared | Recovered | None) -> str:
    """Say what was lost of a journal, if anything."""
    if isinstance(closed, Recovered) and closed.problems:
        places = f"{closed.problems[0].message}{' and more' if len(closed.problems) > 1 else ''}"
        return f"{closed.path}: it was recovered from a damaged journal: {places}"
    if isinstance(closed, Cleared) and closed.loss is not None:
        return f"a journal of this run held no event that can be read: {loss_text(closed.loss)}"
    return ""


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
