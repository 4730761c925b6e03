"""Messages of no transport at all through the mapping engine: plain mappings instead of decoded messages."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from hrclog.diagnostic import Diagnostic
from hrclog.events import Event, TaskEnded, TaskFact, TaskStarted
from hrclog.recorders.importers.bag_runs import Run, runs_of
from hrclog.recorders.mapping.alignment import on_one_clock
from hrclog.recorders.mapping.engine import Engine
from hrclog.recorders.mapping.facts import Fact
from hrclog.recorders.mapping.mapping import Mapping as CellMapping
from hrclog.recorders.mapping.received import Received

T = 1_700_000_000_000_000_000
S = 10**9

Message = tuple[int, str, str, Mapping[str, Any]]
"""(log time, topic, type, fields)."""

Row = tuple[str, str, int, int | None, str]
"""(agent, task, start, end, outcome); an execution that is open has the end None and no outcome."""


def cell(text: str) -> CellMapping:
    return CellMapping(Path("cell.toml"), tomllib.loads(text))


def told(text: str, messages: Iterable[Message]) -> tuple[list[Fact], list[Diagnostic]]:
    """Return the facts of messages on one clock, and what is to be said of them."""
    engine = Engine(cell(text))
    facts = [
        fact
        for time_ns, topic, kind, fields in sorted(messages, key=lambda message: message[0])
        if engine.wants(topic, kind)
        for fact in engine.take(Received(topic, kind, time_ns, fields))
    ]
    facts += engine.finish()
    facts, remarks = on_one_clock(facts, engine.notes, "x")
    return facts, [*engine.diagnostics("x"), *remarks]


def runs(text: str, messages: Iterable[Message]) -> tuple[list[Run], list[Diagnostic]]:
    """Return the runs of messages."""
    facts, diagnostics = told(text, messages)
    found, further = runs_of("bag", facts, cell(text).meanings()[1], {}, "x")
    return found, [*diagnostics, *further]


def rows(events: Iterable[Event]) -> list[Row]:
    """Return the executions that events tell, sorted."""
    executions: dict[str, list[TaskFact]] = {}
    for event in events:
        if isinstance(event, TaskFact):
            executions.setdefault(event.execution_id, []).append(event)
    return sorted((_row(events) for events in executions.values()), key=lambda row: (row[2], row[:2]))


def _row(events: list[TaskFact]) -> Row:
    start = next(event for event in events if isinstance(event, TaskStarted))
    end = next((event for event in events if isinstance(event, TaskEnded)), None)
    ended = (None, "") if end is None else (end.time_ns, str(end.outcome))
    return start.agent, start.task, start.time_ns, *ended


def events_of(facts: Iterable[Fact]) -> list[Event]:
    return [fact.content for fact in facts if isinstance(fact.content, Event)]


def time_message(ns: int) -> dict[str, int]:
    return {"sec": ns // S, "nanosec": ns % S}
