"""Close the loop: random plans -> logs -> learn -> plan -> simulate again; regenerate docs/closed-loop.md.

python benchmarks/closed_loop.py -o DIR [--cells paper:areas paper:ssm ...] [--repeats 30] [--workers 2] [--write]

What was simulated is kept in DIR and not simulated again. Each method's plan is carried out in the same `--repeats`
runs (of one number, runs share what chance does to the human), and the difference to a baseline plan is taken run by
run, against as many different baseline plans.
"""

from __future__ import annotations

import argparse
import math
import re
import statistics
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
import polars as pl
from realised import CellName, Realised

from hrclog.analyzers.learning.learn import gaps, learn
from hrclog.analyzers.projections.intervals import rebuild
from hrclog.analyzers.search.find import find_plan
from hrclog.analyzers.search.judge import possible_plan
from hrclog.analyzers.search.local_search import Effort
from hrclog.analyzers.search.reference import best_by_durations
from hrclog.analyzers.search.search import MOST_ENUMERATED
from hrclog.analyzers.search.space import space_of
from hrclog.analyzers.search.wish import Method, Wish
from hrclog.knowledge.task_times import Factor, TaskTime, TaskTimes
from hrclog.log.reader import read_logs
from hrclog.planning.plan import Plan
from hrclog.planning.random_plans import random_plans
from hrclog.sim.campaign import simulate_campaign
from hrclog.sim.truth import Truth, read_truth

PAGE = Path(__file__).parents[1] / "docs" / "closed-loop.md"
CELLS = ("paper:areas", "paper:distance", "paper:ssm", "authors-areas:areas", "kitting:areas")
TRAINING = (5, 10, 50)
ESTIMATORS = ("aft", "bayes", "ols", "paper")
TRAINING_SEED = 7
PUBLISHED = "18.3 %"


@dataclass(frozen=True)
class Row:
    """How a way to plan did: makespans of its plan, run by run, and what was expected of it."""

    method: str
    runs: int | None
    makespans_s: tuple[float, ...]
    expected_s: float | None


def main() -> None:
    """Simulate, learn, plan, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--cells", nargs="+", default=CELLS)
    parser.add_argument("--repeats", type=int, default=30)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    tables = []
    for text in given.cells:
        name = CellName(*text.split(":"))
        tables.append(cell_table(name, given.output, given.repeats, given.workers))
        print(tables[-1], flush=True)
    if given.write:
        write_page("\n\n".join(tables))


def cell_table(name: CellName, folder: Path, repeats: int, workers: int) -> str:
    """Return the table of one cell."""
    realised = Realised(name, folder, workers)
    training, truth = train(name, folder / f"train-{name}", workers)
    rows = list(rows_of(realised, training, truth, repeats))
    baseline = rows[0]
    oracle = next(row for row in rows if row.method == "oracle")
    lines = [
        f"### {name.scenario}, guarded by `{name.safety}`",
        "",
        "| plan | learnt from | expected s | realised s | shorter than baseline | longer than the oracle's |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    return "\n".join([*lines, *(_line(row, baseline, oracle) for row in rows)])


def train(name: CellName, folder: Path, workers: int) -> tuple[pl.DataFrame, Truth]:
    """Return the executions of random plans, runs in time order, and what is true of them."""
    if not (folder / "truth.json").exists():
        simulate_campaign(name.load(), max(TRAINING), TRAINING_SEED, folder, workers, engine="bullet")
    return rebuild(read_logs([folder]).events)[0], read_truth(folder / "truth.json")


def rows_of(realised: Realised, training: pl.DataFrame, truth: Truth, repeats: int) -> Iterator[Row]:
    """Yield the baseline, then every other way to plan."""
    problem = realised.cell.problem
    runs = training.sort("start_ns")["run_id"].unique(maintain_order=True).to_list()
    every = learn(training).times
    usual = equally_good(realised, every, repeats)
    yield Row("baseline", len(runs), tuple(realised.one_each_s(usual, 0)), None)
    drawn = list(islice(random_plans(problem, "closed-loop"), repeats))
    while len(drawn) < repeats:
        drawn += drawn[: repeats - len(drawn)]
    yield Row("random", None, tuple(realised.one_each_s(drawn, 0)), None)

    def row(method: str, count: int | None, times: TaskTimes, wish: Wish) -> Row:
        found = find_plan(problem, times, wish)
        makespans_s = realised.makespans_s([found.plan], range(repeats))[0]
        return Row(method, count, tuple(makespans_s), found.forecast.mean_s)

    for count in TRAINING:
        part = training.filter(pl.col("run_id").is_in(runs[:count]))
        for estimator in ESTIMATORS:
            yield row(f"synergy-aware, `{estimator}`", count, learn(part, estimator).times, Wish())
        yield row("not-neighboring", count, learn(part).times, Wish(method=Method.NOT_NEIGHBORING))
    yield row("oracle", None, true_times(truth, training), Wish())


def equally_good(realised: Realised, times: TaskTimes, count: int) -> list[Plan]:
    """Return baseline plans, all with the least makespan by mean durations, as different as can be."""
    space = space_of(realised.cell.problem)
    found = best_by_durations(space, times, MOST_ENUMERATED, Effort(20_000), 0)
    order = np.random.default_rng(0).permutation(len(found.best))
    plans = [possible_plan(space, found.best[index].candidate) for index in order[:count]]
    known = [plan for plan in plans if plan is not None]
    return [known[index % len(known)] for index in range(count)]


def true_times(truth: Truth, training: pl.DataFrame) -> TaskTimes:
    """Return what somebody would know who saw every execution's work and every slowing down as it is."""
    learnt = learn(training).times.times
    times = {}
    for task in truth.tasks:
        key = (task.agent, task.task)
        if task.mu is None or task.sigma is None or key not in learnt:
            continue
        factors = tuple(
            Factor(s.other_agent, s.other_task, math.log(s.synergy), 1_000)
            for s in truth.synergies
            if (s.agent, s.task) == key and s.synergy is not None
        )
        times[key] = TaskTime(*key, task.mu, task.sigma, 1_000, factors, np.zeros((2 + len(factors),) * 2))
        known = learnt[key]
        times[key] = replace(times[key], failure_rate=known.failure_rate, failed_s=known.failed_s)
    return TaskTimes(times, gaps(training))


def _line(row: Row, baseline: Row, oracle: Row) -> str:
    mean = statistics.fmean(row.makespans_s)
    learnt = "" if row.runs is None else f"{row.runs} runs"
    expected = "" if row.expected_s is None else f"{row.expected_s:.1f} ({row.expected_s - mean:+.1f})"
    shorter = "" if row is baseline else _share(baseline.makespans_s, row.makespans_s)
    regret = "" if row is oracle else _share(oracle.makespans_s, row.makespans_s, sign=-1.0)
    realised = f"{mean:.1f} ± {_half(row.makespans_s):.1f}"
    return f"| {row.method} | {learnt} | {expected} | {realised} | {shorter} | {regret} |"


def _share(reference: Sequence[float], found: Sequence[float], sign: float = 1.0) -> str:
    """Return by which part makespans are below those of a reference, run by run, with the 95 % interval."""
    mean = statistics.fmean(reference)
    differences = [sign * (a - b) / mean for a, b in zip(reference, found, strict=True)]
    return f"{statistics.fmean(differences):.1%} ± {_half(differences):.1%}"


def _half(values: Sequence[float]) -> float:
    return 1.96 * statistics.stdev(values) / math.sqrt(len(values)) if len(values) > 1 else math.nan


def write_page(text: str, mark: str = "results") -> None:
    """Put a text between two marks of the page."""
    page = PAGE.read_text()
    pattern = re.compile(rf"(<!-- {mark} -->\n).*?(\n<!-- /{mark} -->)", re.DOTALL)
    if not pattern.search(page):
        sys.exit(f"{PAGE}: no <!-- {mark} --> ... <!-- /{mark} -->")
    PAGE.write_text(pattern.sub(lambda found: found[1] + text + found[2], page))


if __name__ == "__main__":
    main()
