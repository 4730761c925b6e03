"""Small runs for knowledge bases, made fast, and all that a knowledge base holds."""

from __future__ import annotations

import random
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl
from sqlalchemy import select

from hrclog.analyzers.learning.ingest import frame_of_events
from hrclog.events import Event, RunEnded, RunStarted, TaskEnded, TaskStarted
from hrclog.knowledge import open_knowledge
from hrclog.knowledge.base import KnowledgeBase
from hrclog.knowledge.tables import METADATA

TASKS = (("human", "wave"), ("robot", "pick"), ("human", "place"), ("robot", "put"))
DECLARED = [
    {"name": "pick", "type": "pick", "agents": ["robot"], "targets": ["box"], "expected_s": 4},
    {"name": "put", "agents": ["robot"], "targets": [], "expected_s": {"robot": 5.5}},
    {"name": "wave", "agents": ["human"]},
]


def run_of(number: int) -> list[Event]:
    """Return the events of a run of two agents, two tasks each, of random durations."""
    chance = random.Random(number)
    run_id, zero = f"run-{number:04d}", 1_700_000_000_000_000_000 + number * 60_000_000_000
    events: list[Event] = [RunStarted(time_ns=zero, run_id=run_id, name=f"n{number}", task_properties=DECLARED)]
    free = {"human": zero, "robot": zero}
    for place, (agent, task) in enumerate(TASKS):
        identity: dict[str, Any] = {"run_id": run_id, "agent": agent, "task": task, "execution_id": f"e{place}"}
        start = free[agent] + chance.randrange(10**8)
        free[agent] = start + chance.randrange(10**9, 9 * 10**9)
        outcome = "failed" if chance.random() < 0.05 else "succeeded"
        events += [TaskStarted(time_ns=start, **identity)]
        events += [TaskEnded(time_ns=free[agent], outcome=outcome, path_length=chance.random(), **identity)]
    events.append(RunEnded(time_ns=max(free.values()), run_id=run_id))
    return [replace(event, seq=seq) for seq, event in enumerate(events)]


def frame_of_runs(numbers: Iterable[int]) -> pl.DataFrame:
    """Return the events of runs as a frame."""
    return frame_of_events([event for number in numbers for event in run_of(number)])


def state(kb: KnowledgeBase, tables: Sequence[str] = ()) -> dict[str, list[tuple[Any, ...]]]:
    """Return the rows of all tables, or of some, in an order of their own; floats as their exact texts."""
    with kb.writing() as connection:
        return {
            name: sorted(tuple(map(repr, row)) for row in connection.execute(select(table)))
            for name, table in METADATA.tables.items()
            if not tables or name in tables
        }


def state_at(where: str | Path, tables: Sequence[str] = ()) -> dict[str, list[tuple[Any, ...]]]:
    """Return `state` of a knowledge base that is not open."""
    with open_knowledge(where) as kb:
        return state(kb, tables)
