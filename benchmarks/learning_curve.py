"""Learn while producing: plan, run, learn, repeat; regenerate the second table of docs/closed-loop.md.

python benchmarks/learning_curve.py [--cells kitting:areas ...] [--runs 40] [--sequences 6] [--workers 2] [--write]

Every sequence begins with nothing but declared guesses: the expected durations of tasks that nobody disturbs. `greedy`
always carries out the best plan by what is known, `explore` the best by one draw of it, `random` any plan.
"""

from __future__ import annotations

import argparse
import math
import statistics
from collections.abc import Sequence
from functools import partial

import polars as pl
from closed_loop import write_page
from realised import CellName, makespan_s

from hrclog.analyzers.learning.ingest import frame_of_events
from hrclog.analyzers.learning.learn import learn
from hrclog.analyzers.projections.intervals import rebuild
from hrclog.analyzers.search.find import find_plan
from hrclog.analyzers.search.wish import Method, Wish
from hrclog.knowledge.task_times import NOTHING, with_guesses
from hrclog.parallel import ordered_map
from hrclog.sim.run import simulate_run

CELLS = ("kitting:areas", "authors-areas:areas")
WISHES = {"random": Wish(method=Method.RANDOM), "greedy": Wish(), "explore": Wish(explore=True)}
BLOCK = 10
_SEED = 60_000


def main() -> None:
    """Simulate the sequences and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", nargs="+", default=CELLS)
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--sequences", type=int, default=6)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    text = "\n\n".join(table(CellName(*cell.split(":")), given) for cell in given.cells)
    print(text)
    if given.write:
        write_page(text, "curve")


def table(name: CellName, given: argparse.Namespace) -> str:
    """Return mean makespans by block of runs."""
    jobs = [(how, sequence) for how in WISHES for sequence in range(given.sequences)]
    found = list(ordered_map(partial(sequence_s, name, given.runs), jobs, given.workers))
    blocks = range(0, given.runs, BLOCK)
    lines = [
        f"### {name.scenario}, guarded by `{name.safety}`",
        "",
        f"| s | {' | '.join(f'runs {first + 1}-{first + BLOCK}' for first in blocks)} |",
        "| --- |" + " --- |" * len(blocks),
    ]
    for how in WISHES:
        rows = [row for (which, _), row in zip(jobs, found, strict=True) if which == how]
        cells = [_cell([statistics.fmean(row[first : first + BLOCK]) for row in rows]) for first in blocks]
        lines.append(f"| {how} | {' | '.join(cells)} |")
    return "\n".join(lines)


def sequence_s(name: CellName, runs: int, job: tuple[str, int]) -> list[float]:
    """Return the makespans of one sequence of runs, each planned by what those before have taught."""
    how, sequence = job
    cell = name.load()
    known = with_guesses(NOTHING, cell.durations_s)
    seen: list[pl.DataFrame] = []
    makespans = []
    for index in range(runs):
        wish = Wish(WISHES[how].objective, WISHES[how].method, 1000 * sequence + index, explore=WISHES[how].explore)
        plan = find_plan(cell.problem, known, wish).plan
        run = simulate_run(cell, _SEED + sequence, index, plan, engine="bullet")
        makespans.append(makespan_s(run))
        seen.append(rebuild(frame_of_events(run.events))[0])
        known = with_guesses(learn(pl.concat(seen)).times, cell.durations_s)
    return makespans


def _cell(values: Sequence[float]) -> str:
    half = 1.96 * statistics.stdev(values) / math.sqrt(len(values)) if len(values) > 1 else math.nan
    return f"{statistics.fmean(values):.1f} ± {half:.1f}"


if __name__ == "__main__":
    main()
