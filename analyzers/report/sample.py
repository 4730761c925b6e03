"""Which single runs a report shows: few, the same ones every time, and not only the typical ones."""

from __future__ import annotations

from dataclasses import dataclass

import polars as pl

from hrclog.wording import agree


@dataclass(frozen=True, slots=True)
class Chosen:
    """A run that is shown, and why."""

    run_id: str
    name: str
    why: str


def choose_runs(runs: pl.DataFrame, count: int) -> tuple[Chosen, ...]:
    """Return the runs to show, shortest first.

    They stand at evenly spaced quantiles of the makespan, so that the shortest and the longest are among them. If any
    run has failures, the one with most of them is shown too, in the place of a quantile; of equal ones the shortest.

    Args:
        runs: schema `RUNS`.
        count: how many; all, where there are fewer.
    """
    ordered = runs.sort("makespan_s", "start_ns", "run_id", nulls_last=True)
    rows = ordered.select("run_id", "name", "makespan_s", "n_failed").rows()
    timed = [place for place, row in enumerate(rows) if row[2] is not None]
    untimed = [place for place in range(len(rows)) if place not in set(timed)]
    worst = max(range(len(rows)), key=lambda place: (rows[place][3], -place), default=None)
    failed = [] if worst is None or not rows[worst][3] else [worst]
    evenly = _evenly(timed, count)
    # a quantile gives way to the run with most failures, unless that is one; untimed runs come where others are used up
    wanted = evenly if set(failed) <= set(evenly) else [*failed, *_evenly(timed, count - 1), *evenly]
    places = sorted(list(dict.fromkeys([*wanted, *untimed]))[: max(count, 0)])
    whys = {place: _why(place, timed, [row[2] for row in rows]) for place in places}
    for place in failed:
        whys[place] = ", ".join(part for part in (whys.get(place, ""), f"most failures ({rows[place][3]})") if part)
    return tuple(Chosen(rows[place][0], rows[place][1] or rows[place][0], whys[place]) for place in places)


def sample_sentence(chosen: tuple[Chosen, ...], total: int) -> str:
    """Return how many runs of how many are shown, and which."""
    if not total:
        return "There are no runs to show."
    if total == 1:
        return "The only run is shown." if chosen else "The only run is not shown on its own; --runs 1 shows it."
    if len(chosen) == total:
        return f"All {total:,} runs are shown, shortest first."
    if not chosen:
        return f"None of {total:,} runs is shown on its own; --runs N shows N of them."
    reasons = "; ".join(run.why for run in chosen)
    verb = agree(len(chosen), "is", "are")
    return (
        f"{len(chosen):,} of {total:,} runs {verb} shown, shortest first: {reasons}. "
        "They stand at evenly spaced quantiles of the makespan, and the run with most failures, if any failed, is "
        "always among them; --runs N shows more."
    )


def _evenly(places: list[int], count: int) -> list[int]:
    """Return `count` of the places, evenly spaced from the first to the last; one alone is the middle."""
    if count <= 0 or not places:
        return []
    if count >= len(places):
        return places
    if count == 1:
        return [places[(len(places) - 1) // 2]]
    gaps, last = count - 1, len(places) - 1
    return [places[(2 * index * last + gaps) // (2 * gaps)] for index in range(count)]


def _why(place: int, timed: list[int], makespans: list[float | None]) -> str:
    if place not in timed:
        return "no executions"
    if len(timed) == 1:
        return "the only one with executions"
    own, known = makespans[place], [makespans[one] for one in timed]
    if known[0] == known[-1]:
        return "as long as all others"
    if own == known[0]:
        return "shortest" if known.count(own) == 1 else "among the shortest"
    if own == known[-1]:
        return "longest" if known.count(own) == 1 else "among the longest"
    return f"longer than {100 * known.index(own) / (len(timed) - 1):.0f} % of the others"
