"""Choose the single runs that a report shows: few, always the same ones, and not only typical ones."""

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

    The runs stand at evenly spaced quantiles of the makespan, so the shortest and the longest are among them. If any
    run has failures, the run with the most of them replaces a quantile; of equal ones, the shortest does.

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
    quantiles = _spread_evenly(timed, count)
    # the run with most failures replaces a quantile, unless it is one; untimed runs fill up the remaining places
    candidates = (
        quantiles if set(failed) <= set(quantiles) else [*failed, *_spread_evenly(timed, count - 1), *quantiles]
    )
    places = sorted(list(dict.fromkeys([*candidates, *untimed]))[: max(count, 0)])
    reasons = {place: _reason(place, timed, [row[2] for row in rows]) for place in places}
    for place in failed:
        reasons[place] = ", ".join(
            part for part in (reasons.get(place, ""), f"most failures ({rows[place][3]})") if part
        )
    return tuple(Chosen(rows[place][0], rows[place][1] or rows[place][0], reasons[place]) for place in places)


def sample_sentence(chosen: tuple[Chosen, ...], total: int) -> str:
    """Return a sentence that says how many of the runs are shown, and which."""
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


def _spread_evenly(places: list[int], count: int) -> list[int]:
    """Return `count` of the places, evenly spaced from the first to the last. A single one is the middle."""
    if count <= 0 or not places:
        return []
    if count >= len(places):
        return places
    if count == 1:
        return [places[(len(places) - 1) // 2]]
    gaps, last = count - 1, len(places) - 1
    return [places[(2 * index * last + gaps) // (2 * gaps)] for index in range(count)]


def _reason(place: int, timed: list[int], makespans: list[float | None]) -> str:
    if place not in timed:
        return "no executions"
    if len(timed) == 1:
        return "the only one with executions"
    makespan, timed_makespans = makespans[place], [makespans[other] for other in timed]
    if timed_makespans[0] == timed_makespans[-1]:
        return "as long as all others"
    if makespan == timed_makespans[0]:
        return "shortest" if timed_makespans.count(makespan) == 1 else "among the shortest"
    if makespan == timed_makespans[-1]:
        return "longest" if timed_makespans.count(makespan) == 1 else "among the longest"
    return f"longer than {100 * timed_makespans.index(makespan) / (len(timed) - 1):.0f} % of the others"
