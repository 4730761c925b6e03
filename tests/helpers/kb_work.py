"""What other processes do to a knowledge base."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import kb_reads
from kb_runs import frame_of_runs

from hrclog.analyzers.learning.ingest import ingest, update_statistics
from hrclog.knowledge import open_knowledge


def ingest_runs(where: str, numbers: list[int], step: int) -> int:
    """Take runs in, a few at a time, updating statistics in between; return how many were new."""
    added = 0
    with open_knowledge(where, create=True, wait_s=60.0) as kb:
        for first in range(0, len(numbers), step):
            added += len(ingest(kb, frame_of_runs(numbers[first : first + step])).added)
            update_statistics(kb, "paper")
    return added


def watch(where: str, ready: str, stop: str) -> dict[str, Any]:
    """Read until a file appears; return how many states were seen, and what was wrong with them."""
    seen: set[int] = set()
    wrong: list[str] = []
    n_reads = 0
    with open_knowledge(where) as kb:
        Path(ready).touch()
        deadline = time.monotonic() + 120
        while not Path(stop).exists() and time.monotonic() < deadline:
            with kb.view() as view:
                made, durations, synergies = view.statistics(), view.durations(), view.synergies()
                times = view.times()
            n_reads += 1
            if made is None or durations.is_empty() or synergies.is_empty() or not times.times:
                wrong.append("empty")
                continue
            seen.add(len(made.runs))
            of_rows = set((durations["count"] + durations["n_failed"]).to_list())
            if of_rows != {len(made.runs)} or set(synergies["estimator"]) != {made.estimator}:
                wrong.append(f"{made.estimator} of {len(made.runs)} runs beside {of_rows}")
            if kb_reads.durations(kb).is_empty() or not kb.times().times:
                wrong.append("empty alone")
    return {"seen": len(seen), "reads": n_reads, "wrong": wrong}
