"""Which factors a report names: those surely above or below 1, relative to undisturbed work where that is known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

import polars as pl

from hrclog.analyzers.report.chance import holm, p_value
from hrclog.analyzers.report.finding import Finding, task_name
from hrclog.analyzers.synergy.estimators import ESTIMATORS
from hrclog.analyzers.synergy.pairs import OK, WEAKLY_IDENTIFIED
from hrclog.wording import counted

MOST_EFFECTS: Final = 5
"""Slow-downs, and speed-ups, that are listed."""

_MISSES: Final = 0.05  # of 95 % intervals
_KEY: Final = ("agent", "task", "other_agent", "other_task")
_STATUS: Final = {"sparse": "few pairs", WEAKLY_IDENTIFIED: "weakly identified"}
_IMPOSSIBLE: Final = ((pl.col("synergy") <= 0) | (pl.col("synergy_free") <= 0)).fill_null(value=False)
_BEYOND: Final = "; no execution was that long: the factor is that of the part that overlapped"
_STILL: Final = 5.0  # times as long


def effects(synergies: pl.DataFrame, durations: pl.DataFrame, estimator: str) -> Iterable[Finding]:
    """Say which tasks surely take longer or shorter beside others, which of it may be chance, and what cannot be told.

    Factors are relative to undisturbed work where that is known. Those relative to a task's mean are named if they are
    slow-downs: the mean contains all slow-downs, so that undisturbed work lies below it.

    Args:
        synergies: a frame of schema `SYNERGIES`.
        durations: a frame of schema `DURATIONS`.
        estimator: where the factors come from.
    """
    known, impossible = _known(synergies.filter(~_IMPOSSIBLE), durations), synergies.filter(_IMPOSSIBLE).height
    slower = known.filter(pl.col("low") > 1).sort("remains", "low", *_KEY, descending=[True, True, *[False] * 4])
    below = known.filter(pl.col("high") < 1)
    faster = below.filter("free").sort("remains", "high", *_KEY, descending=[True, *[False] * 5])
    if slower.height:
        text = f"{counted(slower.height, 'slow-down')} whose 95 % interval lies above 1, clearest first:"
        yield Finding(text, _sentences(slower, known.height))
    if faster.height:
        text = f"{counted(faster.height, 'speed-up')} whose 95 % interval lies below 1, clearest first:"
        yield Finding(text, _sentences(faster, known.height))
    if slower.height + faster.height:
        yield from _by_chance(known.height, pl.concat([slower, faster])["remains"])
    else:
        yield _nothing_certain(synergies, known.height, below.height + impossible)
    yield from _below_the_mean(below.height - faster.height)
    yield from _impossible(impossible)
    caution = ESTIMATORS[estimator].caution
    if caution and known.height:
        yield Finding(caution, (), "doubt")


def _known(synergies: pl.DataFrame, durations: pl.DataFrame) -> pl.DataFrame:
    """Return the rows with an interval, what they are to be judged by, and how long their task took."""
    free = pl.col("synergy_free").is_not_null()
    judged = {
        "factor": ("synergy_free", "synergy"),
        "low": ("free_ci_low", "ci_low"),
        "high": ("free_ci_high", "ci_high"),
    }
    known = (
        synergies.with_columns(
            free.alias("free"),
            *(pl.when(free).then(one).otherwise(other).alias(name) for name, (one, other) in judged.items()),
        )
        .drop_nulls(("factor", "low", "high"))
        .join(durations.select("agent", "task", "mean_s", "min_s", "max_s"), on=["agent", "task"], how="left")
        .sort(_KEY)
    )
    adjusted = holm([p_value(*row) for row in known.select("factor", "low", "high").iter_rows()])
    return known.with_columns(pl.Series("remains", [value <= _MISSES for value in adjusted], pl.Boolean))


def _sentences(rows: pl.DataFrame, comparisons: int) -> tuple[str, ...]:
    shown = tuple(_sentence(row, comparisons) for row in rows.head(MOST_EFFECTS).iter_rows(named=True))
    further = rows.height - len(shown)
    return (*shown, f"{further:,} more in the table of synergies.") if further else shown


def _sentence(row: Mapping[str, Any], comparisons: int) -> str:
    digits = 3 if "1.00" in (f"{row['low']:.2f}", f"{row['high']:.2f}") else 2  # it matters on which side of 1
    factor = f"{row['factor']:.{digits}f} [{row['low']:.{digits}f}, {row['high']:.{digits}f}]"
    times = "times as long as undisturbed" if row["free"] else "times its mean"
    notes = (
        f"n = {row['n']:,}",
        "" if row["status"] == OK else _STATUS.get(row["status"], row["status"]),
        "" if row["remains"] else f"not after allowing for {counted(comparisons, 'comparison')}",
    )
    one, other = task_name(row["agent"], row["task"]), task_name(row["other_agent"], row["other_task"])
    beyond = _BEYOND + (", which nearly stood still" if row["factor"] >= _STILL else "") if _beyond(row) else ""
    return f"{one} takes {factor} {times} while {other} runs ({', '.join(filter(None, notes))}){beyond}."


def _beyond(row: Mapping[str, Any]) -> bool:
    """Return whether no execution took as many times as long as the factor says."""
    least = row["min_s"] if row["free"] else row["mean_s"]
    return bool(least) and row["factor"] > row["max_s"] / least


def _by_chance(comparisons: int, remains: pl.Series) -> Iterable[Finding]:
    """Say how many effects remain if it is allowed for how many were looked for."""
    if comparisons == 1:
        return
    shown = f"{counted(len(remains), 'shows', 'show')} a slow-down or a speed-up"
    left = counted(int(remains.sum()), "remains", "remain")
    text = (
        f"Of {comparisons:,} intervals of 95 %, {shown}; after allowing for {comparisons:,} comparisons (Holm), {left}."
    )
    yield Finding(text, (), "doubt")


def _nothing_certain(synergies: pl.DataFrame, known: int, unsaid: int) -> Finding:
    if synergies.is_empty():
        text = "No two agents have tasks to compare, so nothing is said of how they affect each other."
    elif unsaid:  # though their intervals may exclude 1
        text = "No slow-down and no speed-up is certain."
    elif not known:
        text = "No factor has an interval, so no slow-down is certain."
    else:
        of_all = f"all {known:,} intervals of 95 % include 1" if known > 1 else "the interval includes 1"
        text = f"No slow-down and no speed-up is certain: {of_all}."
    return Finding(text, (), "doubt")


def _below_the_mean(number: int) -> Iterable[Finding]:
    if number:
        lie = counted(number, "factor relative to the mean lies", "factors relative to the mean lie")
        why = "which undisturbed pairs do too when others slow the task down"
        yield Finding(f"{lie} below 1, {why}; undisturbed work was not seen enough to tell.", (), "doubt")


def _impossible(number: int) -> Iterable[Finding]:
    if number:
        they = counted(number, "factor is", "factors are")
        why = "the data do not support a factor there, so nothing is said of it"
        yield Finding(f"{they} at or below 0, which no duration can be: {why}.", (), "doubt")
