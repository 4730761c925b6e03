"""Recordings that were split into several files, of events that name no run: which files are one recording."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import polars as pl

_NUMBER: Final = re.compile(r"^(.*?)(\d+)$")


@dataclass(frozen=True, slots=True)
class Part:
    """What tells whether a file goes on where another one ends.

    Attributes:
        path: the file.
        first_ns: instant of its first event.
        last_ns: instant of its last event.
        first_seq: lowest sequence number.
        last_seq: highest sequence number.
        begins: whether a run starts in it.
        started: executions that start in it.
        touched: executions that pause, resume or end in it.
        ended: executions that end in it.
    """

    path: Path
    first_ns: int
    last_ns: int
    first_seq: int
    last_seq: int
    begins: bool
    started: frozenset[str]
    touched: frozenset[str]
    ended: frozenset[str]


def part_of(path: Path, events: pl.DataFrame) -> Part:
    """Describe a file by its events that name no run; there is at least one."""
    started, paused, resumed, ended = (
        frozenset(events.filter(pl.col("kind") == kind)["execution_id"].to_list())
        for kind in ("task_started", "task_paused", "task_resumed", "task_ended")
    )
    low, high, first, last = events.select(
        pl.col("seq").min().alias("low"),
        pl.col("seq").max().alias("high"),
        pl.col("time_ns").min().alias("first"),
        pl.col("time_ns").max().alias("last"),
    ).row(0)
    return Part(
        path,
        first or 0,
        last or 0,
        low or 0,
        high or 0,
        begins=bool((events["kind"] == "run_started").any()),
        started=started,
        touched=paused | resumed | ended,
        ended=ended,
    )


def chains(parts: Sequence[Part], *, one_bag: bool) -> list[list[Part]]:
    """Return which files are one recording, each in the order of time.

    Files of one folder are one recording only where the sequence numbers or open executions go on from one to the
    next. The parts of a bag are one recording unless a run begins anew in one of them.

    Args:
        parts: files of one folder.
        one_bag: whether they are the parts of a bag.
    """
    recordings: list[list[Part]] = []
    for part in sorted(parts, key=lambda part: (part.first_ns, part.first_seq, part.path)):
        best = max(recordings, key=lambda recording: _fit(recording, part, one_bag=one_bag), default=None)
        if best is not None and _fit(best, part, one_bag=one_bag):
            best.append(part)
        else:
            recordings.append([part])
    return recordings


def _fit(recording: Sequence[Part], part: Part, *, one_bag: bool) -> int:
    """Return how well a file goes on from others; 0 means that it does not."""
    former = recording[-1]
    if part.begins or (part.last_ns < former.last_ns and not one_bag):
        return 0
    (stem, number), (next_stem, next_number) = _numbered(former.path), _numbered(part.path)
    is_next = stem == next_stem and next_number == number + 1
    if _open(recording) & (part.touched - part.started):
        return 3 + is_next
    if part.first_seq == former.last_seq + 1 or (is_next and part.first_seq > former.last_seq):
        return 1 + is_next
    restarts = part.first_seq <= former.first_seq and part.last_seq > part.first_seq
    return int(one_bag and not restarts)


def _open(recording: Sequence[Part]) -> frozenset[str]:
    """Return the executions that are under way at the end."""
    started: frozenset[str] = frozenset()
    for part in recording:
        started = (started | part.started) - part.ended
    return started


def _numbered(path: Path) -> tuple[str, int]:
    """Return what a file's name begins with, and its number; -2 where it has none."""
    match = _NUMBER.match(path.name.partition(".")[0])
    return (match.group(1), int(match.group(2))) if match else (path.name, -2)
