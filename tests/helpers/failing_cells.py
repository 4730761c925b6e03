"""Runs of a human who screws while a robot scans, whatever comes of the scans."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

from interval_frames import Row, row

from hrclog.events import Event, RunEnded, RunStarted, TaskEnded, TaskStarted
from hrclog.log.writing.writer import write_log

SECOND = 1_000_000_000
SCREW, SCAN, HOLD = ("human", "screw"), ("robot", "scan"), ("robot", "hold")
SCREW_WHILE_SCAN, SCAN_WHILE_SCREW = (*SCREW, *SCAN), (*SCAN, *SCREW)
SLOTS = 8


def cell(outcome_of: Callable[[int], str], n_runs: int = 6) -> list[Row]:
    """Return runs of 8 screws: 4 take about 4 s alone, 4 take about 8.2 s wholly beside a scan; holds meet nothing.

    Args:
        outcome_of: what becomes of the scan of a number; one that is unknown stays open until it stopped.
        n_runs: how many.
    """
    source, found, scans = random.Random(1), list[Row](), 0
    for run in range(n_runs):
        identity = {"run_id": f"run{run}"}
        for slot in range(SLOTS):
            start, noise, beside = 20 * slot, source.gauss(1.0, 0.02), slot % 2
            span = (start * SECOND, round((start + (8.2 if beside else 4.0) * noise) * SECOND))
            found.append(row(*SCREW, *span, execution_id=f"{run}-screw{slot}", **identity))
            if beside:
                outcome = outcome_of(scans)
                scans += 1
                span = ((start - 1) * SECOND, round((start + 9 + noise) * SECOND))
                scan = row(*SCAN, *span, execution_id=f"{run}-scan{slot}", outcome=outcome, **identity)
                found.append(scan | {"end_ns": None} if outcome == "unknown" else scan)
            else:
                span = ((start + 10) * SECOND, (start + 12) * SECOND)
                found.append(row(*HOLD, *span, execution_id=f"{run}-hold{slot}", **identity))
    return found


def events_of(rows: list[Row]) -> list[Event]:
    """Return the executions of one run as events."""
    zero, run_id = 1_700_000_000 * SECOND, str(rows[0]["run_id"])
    facts: list[Event] = []
    for one in rows:
        names = ("run_id", "agent", "task", "execution_id")
        identity = {name: str(one[name]) for name in names}
        facts.append(TaskStarted(time_ns=zero + one["start_ns"], **identity))
        if one["end_ns"] is not None:
            facts.append(TaskEnded(time_ns=zero + one["end_ns"], outcome=one["outcome"], **identity))
    facts.sort(key=lambda fact: fact.time_ns)
    last = max(one["until_ns"] for one in rows)
    begin = zero + min(one["start_ns"] for one in rows)
    agents = tuple(sorted({one["agent"] for one in rows}))
    return [
        RunStarted(time_ns=begin, run_id=run_id, name=run_id, agents=agents),
        *facts,
        RunEnded(time_ns=zero + last, run_id=run_id),
    ]


def write_cell(folder: Path, rows: list[Row]) -> Path:
    """Write a log per run, and return the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for run in sorted({one["run_id"] for one in rows}):
        write_log(folder / f"{run}.mcap", events_of([one for one in rows if one["run_id"] == run]))
    return folder
