"""Make study.csv: a study as a lab keeps it in a table, six participants, two conditions, two trials of each.

In `shared`, human and robot work side by side as in the paper's cell; in `apart`, neither disturbs the other. Each
participant has a pace of their own.
"""

from __future__ import annotations

import csv
import math
import random
import sys
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from tempfile import TemporaryDirectory

import polars as pl

import hrclog
from hrclog.log.writing.writer import write_log
from hrclog.sim.run import simulate_run
from hrclog.sim.scenario import Scenario

PARTICIPANTS = 6
TRIALS = 2
PACE = 0.15
FIRST = datetime(2026, 3, 2, 9, 0, tzinfo=UTC)
HEADER = ("participant", "condition", "trial", "agent", "task", "start", "duration_s", "result")


def main(path: Path) -> int:
    """Write the table."""
    with path.open("w", encoding="utf-8", newline="") as stream, TemporaryDirectory() as folder:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(HEADER)
        writer.writerows(_rows(Path(folder) / "run.mcap"))
    return 0


def _rows(scratch: Path) -> Iterator[tuple[str, ...]]:
    paper = hrclog.load_scenario("paper")
    conditions = {"shared": paper, "apart": replace(paper, name="apart", synergies=())}
    paces = random.Random(5)  # noqa: S311 - no secret
    for number in range(PARTICIPANTS):
        pace = paces.gauss(0.0, PACE)
        for trial in range(TRIALS):
            for order, (condition, scenario) in enumerate(conditions.items()):
                session = FIRST + timedelta(days=number, minutes=20 * (2 * trial + order))
                facts = (f"P{number + 1:02}", condition, str(trial + 1))
                yield from _run(facts, _at_pace(scenario, pace), 1 + number * TRIALS + trial, session, scratch)


def _at_pace(scenario: Scenario, pace: float) -> Scenario:
    """Return a scenario whose human takes longer by a factor, given as its logarithm."""
    works = (
        replace(work, time=replace(work.time, median_s=work.time.median_s * math.exp(pace)))
        if work.agent == "human"
        else work
        for work in scenario.works
    )
    return replace(scenario, works=tuple(works))


def _run(
    facts: tuple[str, ...], scenario: Scenario, seed: int, session: datetime, scratch: Path
) -> Iterator[tuple[str, ...]]:
    run = simulate_run(scenario, seed, 0)
    write_log(scratch, run.events)
    executions = hrclog.intervals(hrclog.read_events(scratch)).sort("start_ns", "agent")
    scratch.unlink()
    origin = int(executions["start_ns"][0])
    timed = executions.select("agent", "task", "outcome", pl.col("start_ns") - origin, pl.col("end_ns") - origin)
    for agent, task, outcome, start_ns, end_ns in timed.iter_rows():
        start = session + timedelta(milliseconds=round(start_ns / 1e6))
        result = "ok" if outcome == "succeeded" else "dropped"
        yield (
            *facts,
            agent,
            task,
            start.strftime("%Y-%m-%d %H:%M:%S.") + f"{start.microsecond // 1000:03}",
            f"{(end_ns - start_ns) / 1e9:.3f}",
            result,
        )


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
