"""Many simulated runs as log files: the same bytes from one process or many, in one go or in several."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from hrclog.errors import HrclogError, LogExistsError, LogWriteError, ScenarioError
from hrclog.parallel import ordered_map
from hrclog.sim.bullet.observed import observed_truth
from hrclog.sim.campaign_folder import add_run, campaign_folder, manifest_of
from hrclog.sim.engine import ENGINES, make_engine
from hrclog.sim.event_queue import EventQueue
from hrclog.sim.run import BASE_EPOCH_NS, run_name, simulate_run
from hrclog.sim.scenario import Scenario
from hrclog.sim.truth import RunTruth, Truth, scenario_truth
from hrclog.tags import NO_TAGS
from hrclog.wording import share

Progress = Callable[[int], None]
"""Told how many further runs are over."""

_BATCH: Final = 25
_SLOW_BATCH: Final = 1
_SHOWN_FAILURES: Final = 3


@dataclass(frozen=True, slots=True)
class _Failure:
    """A run that could not be simulated; `trace` is for whoever looks for the reason."""

    name: str
    text: str
    trace: str


@dataclass(frozen=True, slots=True)
class _Campaign:
    """The inputs of a worker."""

    scenario: Scenario
    seed: int
    engine: str
    out_dir: Path
    tags: Mapping[str, str]


def simulate_campaign(
    scenario: Scenario,
    runs: int,
    seed: int,
    out_dir: Path,
    workers: int = 1,
    progress: Progress | None = None,
    engine: str = ENGINES[0],
    resuming: Progress | None = None,
    on_runs: Callable[[Sequence[Path]], None] = lambda _: None,
    *,
    tags: Mapping[str, str] = NO_TAGS,
) -> tuple[Path, ...]:
    """Simulate runs, write one log each and the truth beside them, and return the paths of the logs.

    Run `index` depends on scenario, seed, engine and index alone: neither on the number of runs nor on the workers. A
    campaign that was killed is resumed by the same call: runs that are there are not simulated again. It may then be
    given more runs, and so may one that is finished. A run that fails does not keep the others from being simulated.

    Args:
        scenario: the cell.
        runs: how many, at least 1.
        seed: any integer.
        out_dir: made if missing; logs are named after scenario and number.
        workers: processes to use.
        progress: called after each batch of runs.
        engine: one of `ENGINES`.
        resuming: called first with the number of runs that are there, if the campaign is resumed.
        on_runs: given the logs of runs that are over, as they come; first, in one go, of those that were there before.
        tags: facts of every run.

    Raises:
        LogExistsError: a file that would be written exists, or another campaign is unfinished in the folder; nothing
            was simulated.
        OutputError: the folder cannot be made.
        LogWriteError: a file cannot be written, or another process is simulating into the folder.
        ScenarioError: a number is out of range, the engine cannot carry out the scenario (nothing was written), or
            runs failed, for example by a standstill (the others are written).
    """
    _check(scenario, engine, seed, runs=runs, workers=workers)
    with campaign_folder(scenario, manifest_of(scenario, runs, seed, engine, tags), out_dir) as folder:
        if folder.resumed and resuming:
            resuming(len(folder.done))
        missing_indices = [index for index in range(runs) if index not in folder.done]
        truths, failures = dict(folder.done), list[_Failure]()
        if truths:
            on_runs([folder.log(index) for index in sorted(truths)])
        campaign = _Campaign(scenario, seed, engine, out_dir, dict(tags))
        for batch in _results(campaign, missing_indices, workers, progress):
            failures += [result for _, result in batch if isinstance(result, _Failure)]
            new_truths = {index: result for index, result in batch if not isinstance(result, _Failure)}
            truths |= new_truths
            if new_truths:
                on_runs([folder.log(index) for index in new_truths])
        if failures:
            raise _failure_error(failures, runs)
        folder.finish(_truth(scenario, seed, engine, [truths[index] for index in range(runs)]))
        return tuple(map(folder.log, range(runs)))


def _check(scenario: Scenario, engine: str, seed: int, **numbers: int) -> None:
    """Raise an error now that would occur in every run."""
    for name, value in numbers.items():
        if value < 1:
            raise ScenarioError(f"{name}: found {value}, expected at least 1")
    make_engine(engine, scenario, EventQueue(BASE_EPOCH_NS), seed, 0).stop()


def _truth(scenario: Scenario, seed: int, engine: str, runs: Sequence[RunTruth]) -> Truth:
    if engine == "bullet" and scenario.cell is not None:
        return observed_truth(scenario, scenario.cell, seed, engine, runs)
    return scenario_truth(scenario, seed, runs)


def _results(
    campaign: _Campaign, indices: Sequence[int], workers: int, progress: Progress | None
) -> Iterator[list[tuple[int, RunTruth | _Failure]]]:
    size = _SLOW_BATCH if campaign.engine == "bullet" else _BATCH
    batches = [indices[start : start + size] for start in range(0, len(indices), size)]
    try:
        for batch, results in zip(batches, ordered_map(partial(_write_batch, campaign), batches, workers), strict=True):
            yield list(zip(batch, results, strict=True))
            if progress:
                progress(len(batch))
    except BrokenExecutor as error:
        raise HrclogError(
            "a worker process was killed, perhaps for want of memory; the same command with fewer --workers goes on"
        ) from error


def _write_batch(campaign: _Campaign, batch: Sequence[int]) -> list[RunTruth | _Failure]:
    return [_write_run(campaign, index) for index in batch]


def _write_run(campaign: _Campaign, index: int) -> RunTruth | _Failure:
    try:
        run = simulate_run(campaign.scenario, campaign.seed, index, engine=campaign.engine)
        add_run(campaign.out_dir, run.tagged(campaign.tags))
    except (LogExistsError, LogWriteError):  # the next run would not fare better
        raise
    except Exception as error:  # noqa: BLE001 - whatever is wrong with a run, the others go on, and it is told at the end
        text = str(error) if isinstance(error, HrclogError) else f"{type(error).__name__}: {error}"
        return _Failure(run_name(campaign.scenario, index), text, traceback.format_exc())
    return run.truth


def _failure_error(failures: Sequence[_Failure], runs: int) -> ScenarioError:
    messages = "; ".join(f"{failure.name}: {failure.text}" for failure in failures[:_SHOWN_FAILURES])
    more = f"; and {len(failures) - _SHOWN_FAILURES} more" if len(failures) > _SHOWN_FAILURES else ""
    remark = ", the others are written; the same command tries only these again" if len(failures) < runs else ""
    error = ScenarioError(f"{share(len(failures), runs, 'run')} failed{remark}: {messages}{more}")
    error.add_note(failures[0].trace)
    return error
