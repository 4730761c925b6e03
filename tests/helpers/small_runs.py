"""Runs of the small cell, for processes of their own too."""

from __future__ import annotations

import hashlib
from pathlib import Path

from cells import HUMAN, ROBOT, small_cell, small_plan, small_scenario

from hrclog.log.writing.writer import write_log
from hrclog.sim.run import Run, simulate_run

TASKS = (
    *((ROBOT, "pick_red"), (ROBOT, "put"), (ROBOT, "pick_red"), (ROBOT, "put")),
    *((HUMAN, "pick_white"), (HUMAN, "put"), (HUMAN, "pick_white"), (HUMAN, "put")),
)


def small_run(seed: int, index: int) -> Run:
    """Return a run of the small cell."""
    scenario = small_scenario(small_cell(), TASKS, gap_s=0.2)
    return simulate_run(scenario, seed, index, plan=small_plan(*TASKS), engine="bullet")


def digest(run: Run, path: Path) -> str:
    """Return the SHA-256 of a run's log."""
    write_log(path, run.events, run.signals)
    return hashlib.sha256(path.read_bytes()).hexdigest()


def digests_of_small_runs(indices: list[int], folder: str) -> list[str]:
    """Return the SHA-256 of the logs of small runs."""
    return [digest(small_run(1, index), Path(folder) / f"{index}.mcap") for index in indices]
