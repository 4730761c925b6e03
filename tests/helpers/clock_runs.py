"""Runs of two agents with clocks and delays as a test wants them, written as a bag of ROS nodes would hold them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hrclog.event_rows import to_row
from hrclog.events import Event, RunEnded, RunStarted, TaskEnded, TaskStarted
from hrclog.log.messages.channels import EVENTS as EVENTS_CHANNEL
from hrclog.log.messages.encode import Message
from hrclog.log.messages.message import encode_row
from hrclog.log.writing.writer import write_atomically

SECOND = 10**9
BEGIN = 1_780_000_000 * SECOND
HUMAN, ROBOT = "human", "robot"

Clock = Callable[[int], int]
"""Takes the true instant and returns what a clock shows."""


@dataclass(frozen=True)
class Written:
    """An event and when it was written."""

    event: Event
    log_time: int


def right(instant: int) -> int:
    """Show the true instant."""
    return instant


def ahead(seconds: float) -> Clock:
    """Return a clock that is ahead, or behind."""
    return lambda instant: instant + round(seconds * SECOND)


def jumps(seconds: float, at: int) -> Clock:
    """Return a clock that is put forward, or back, at an instant."""
    return lambda instant: instant + (round(seconds * SECOND) if instant >= at else 0)


def run(
    human: Clock = right,
    robot: Clock = right,
    delays: Sequence[float] = (0.0,),
    *,
    log: Clock = right,
    tasks: int = 6,
    run_id: str = "run",
) -> list[Written]:
    """Return a run in which human and robot work side by side, a task each, `tasks` times.

    Args:
        human: the human's clock.
        robot: the robot's clock.
        delays: after so many seconds an event is written, in turn.
        log: the clock of log times.
        tasks: of each agent.
        run_id: of the run.
    """
    moments: list[tuple[int, Event]] = []
    for number in range(tasks):
        for agent, clock, start, length in (
            (HUMAN, human, 1.0, 6.0 + number % 3),
            (ROBOT, robot, 2.5, 8.0 - number % 2),
        ):
            fact = {
                "run_id": run_id,
                "agent": agent,
                "task": f"{agent}_{number % 2}",
                "execution_id": f"{agent}{number}",
            }
            begin = BEGIN + round((start + 11 * number) * SECOND)
            end = begin + round(length * SECOND)
            moments.append((begin, TaskStarted(time_ns=clock(begin), **fact)))
            moments.append((end, TaskEnded(time_ns=clock(end), **fact)))
    last = max(moment for moment, _ in moments) + SECOND
    moments.append((BEGIN, RunStarted(time_ns=BEGIN, run_id=run_id, name=run_id, agents=(HUMAN, ROBOT))))
    moments.append((last, RunEnded(time_ns=last, run_id=run_id)))
    late = [
        (moment + round(delays[number % len(delays)] * SECOND), number, event)
        for number, (moment, event) in enumerate(sorted(moments, key=lambda pair: pair[0]))
    ]
    return [
        Written(replace(event, seq=seq), log(written))
        for seq, (written, _, event) in enumerate(sorted(late, key=_first))
    ]


def _first(entry: tuple[int, int, Event]) -> tuple[int, int]:
    return entry[:2]


def write(path: Path, events: Sequence[Written], **columns: Any) -> Path:  # noqa: ANN401 - values of columns
    """Write events with their log times; `columns` are set in every one of them."""

    def fill(writer: Any) -> None:  # noqa: ANN401 - a FinishedWriter
        for entry in events:
            row = to_row(entry.event) | columns
            writer.add(Message(EVENTS_CHANNEL, entry.log_time, max(row["time_ns"], 0), encode_row(row), row["seq"]))

    write_atomically(path, fill)
    return path
