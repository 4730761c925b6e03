"""Many simulated runs as log files: the same bytes from one process or many."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

from hrclog.errors import LogExistsError, OutputError, ScenarioError
from hrclog.log.writer import write_log
from hrclog.parallel import ordered_map
from hrclog.sim.run import run_name, simulate_run
from hrclog.sim.scenario import Scenario
from hrclog.sim.truth import TRUTH_FILE, RunTruth, scenario_truth, write_truth

Progress = Callable[[int], None]
"""Told how many further runs are written."""

_BATCH: Final = 25


def simulate_campaign(
    scenario: Scenario, runs: int, seed: int, out_dir: Path, workers: int = 1, progress: Progress | None = None
) -> tuple[Path, ...]:
    """Simulate runs, write one log each and the truth beside them, and return the paths of the logs.

    Run `index` depends on scenario, seed and index alone: neither on the number of runs nor on the workers.

    Args:
        scenario: the cell.
        runs: how many, at least 1.
        seed: any integer.
        out_dir: made if missing; logs are named after scenario and number.
        workers: processes to use.
        progress: called after each batch of runs.

    Raises:
        LogExistsError: a file that would be written exists; nothing was simulated.
        OutputError: the folder cannot be made.
        LogWriteError: a log cannot be written.
        ScenarioError: a number is out of range, or a run came to a standstill.
    """
    _check_range("runs", runs)
    _check_range("workers", workers)
    paths = tuple(out_dir / f"{run_name(scenario, index)}.mcap" for index in range(runs))
    _prepare(out_dir, (out_dir / TRUTH_FILE, *paths))
    batches = [range(start, min(start + _BATCH, runs)) for start in range(0, runs, _BATCH)]
    truths: list[RunTruth] = []
    for batch_truths in ordered_map(partial(_write_batch, scenario, seed, out_dir), batches, workers):
        truths += batch_truths
        if progress:
            progress(len(batch_truths))
    write_truth(out_dir / TRUTH_FILE, scenario_truth(scenario, seed, truths))
    return paths


def _check_range(what: str, value: int) -> None:
    if value < 1:
        raise ScenarioError(f"{what}: found {value}, expected at least 1")


def _prepare(out_dir: Path, paths: tuple[Path, ...]) -> None:
    try:
        out_dir.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(out_dir, f"cannot be made ({error.strerror})") from error
    for path in paths:
        if path.exists():
            raise LogExistsError(path, "choose an empty folder with -o")


def _write_batch(scenario: Scenario, seed: int, out_dir: Path, batch: range) -> list[RunTruth]:
    return [_write_run(scenario, seed, index, out_dir) for index in batch]


def _write_run(scenario: Scenario, seed: int, index: int, out_dir: Path) -> RunTruth:
    run = simulate_run(scenario, seed, index)
    write_log(out_dir / f"{run.truth.name}.mcap", run.events)
    return run.truth
