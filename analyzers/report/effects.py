"""Select the factors that a report names: those surely above or below 1, relative to undisturbed work if known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

import polars as pl

from hrclog.analyzers.report.chance import holm, p_value
from hrclog.analyzers.report.finding import Finding, task_name
from hrclog.analyzers.synergy.estimators import ESTIMATORS
from hrclog.analyzers.synergy.pairs import OK, SPARSE, WEAKLY_IDENTIFIED
from hrclog.wording import counted

MOST_EFFECTS: Final = 5
"""Slow-downs, and speed-ups, that are listed."""

_MISSES: Final = 0.05  # of 95 % intervals
_KEY: Final = ("agent", "task", "other_agent", "other_task")
_STATUS: Final = {SPARSE: "few successes", WEAKLY_IDENTIFIED: "weakly identified"}
_IMPOSSIBLE: Final = ((pl.col("synergy") <= 0) | (pl.col("synergy_free") <= 0)).fill_null(value=False)
_BEYOND: Final = "; no execution was that long: the factor is that of the part that overlapped"
_STILL: Final = 5.0  # times as long


def effects(synergies: pl.DataFrame, durations: pl.DataFrame, estimator: str) -> Iterable[Finding]:
    """Yield which tasks surely take longer or shorter beside others, what may be chance, and what is not known.

    Factors are relative to undisturbed work where that is known. Factors relative to a task's mean are named only if
    they are slow-downs: the mean contains all slow-downs, so undisturbed work lies below it.

    Args:
        synergies: a frame of schema `SYNERGIES`.
        durations: a frame of schema `DURATIONS`.
        estimator: where the factors come from.
    """
    factors, impossible = (
        _known_factors(synergies.filter(~_IMPOSSIBLE), durations),
        synergies.filter(_IMPOSSIBLE).height,
    )
    slower = factors.filter(pl.col("low") > 1).sort("remains", "low", *_KEY, descending=[True, True, *[False] * 4])
    below = factors.filter(pl.col("high") < 1)
    faster = below.filter("free").sort("remains", "high", *_KEY, descending=[True, *[False] * 5])
    if slower.height:
        text = f"{counted(slower.height, 'slow-down')} whose 95 % interval lies above 1, clearest first:"
        yield Finding(text, _sentences(slower, factors.height))
    if faster.height:
        text = f"{counted(faster.height, 'speed-up')} whose 95 % interval lies below 1, clearest first:"
        yield Finding(text, _sentences(faster, factors.height))
    if slower.height + faster.height:
        yield from _by_chance(factors.height, pl.concat([slower, faster])["remains"])
    else:
        yield _nothing_certain(synergies, factors.height, below.height + impossible)
    yield from _below_the_mean(below.height - faster.height)
    yield from _impossible_factors(impossible)
    caution = ESTIMATORS[estimator].caution
    if caution and factors.height:
        yield Finding(caution, (), "doubt")


def _known_factors(synergies: pl.DataFrame, durations: pl.DataFrame) -> pl.DataFrame:
    """Return the rows that have an interval, with the values that decide, and with how long their task took."""
    free = pl.col("synergy_free").is_not_null()
    sources = {
        "factor": ("synergy_free", "synergy"),
        "low": ("free_ci_low", "ci_low"),
        "high": ("free_ci_high", "ci_high"),
    }
    factors = (
        synergies.with_columns(
            free.alias("free"),
            *(
                pl.when(free).then(free_column).otherwise(column).alias(name)
                for name, (free_column, column) in sources.items()
            ),
        )
        .drop_nulls(("factor", "low", "high"))
        .join(durations.select("agent", "task", "mean_s", "min_s", "max_s"), on=["agent", "task"], how="left")
        .sort(_KEY)
    )
    adjusted = holm([p_value(*row) for row in factors.select("factor", "low", "high").iter_rows()])
    return factors.with_columns(pl.Series("remains", [value <= _MISSES for value in adjusted], pl.Boolean))


def _sentences(rows: pl.DataFrame, comparisons: int) -> tuple[str, ...]:
    sentences = tuple(_sentence(row, comparisons) for row in rows.head(MOST_EFFECTS).iter_rows(named=True))
    further = rows.height - len(sentences)
    return (*sentences, f"{further:,} more in the table of synergies.") if further else sentences


def _sentence(row: Mapping[str, Any], comparisons: int) -> str:
    digits = 3 if "1.00" in (f"{row['low']:.2f}", f"{row['high']:.2f}") else 2  # it matters on which side of 1
    factor = f"{row['factor']:.{digits}f} [{row['low']:.{digits}f}, {row['high']:.{digits}f}]"
    times = "times as long as undisturbed" if row["free"] else "times its mean"
    notes = (
        f"n = {row['n']:,}",
        "" if row["status"] == OK else _STATUS.get(row["status"], row["status"]),
        "" if row["remains"] else f"not after allowing for {counted(comparisons, 'comparison')}",
    )
    task, other_task = task_name(row["agent"], row["task"]), task_name(row["other_agent"], row["other_task"])
    beyond = (
        _BEYOND + (", which nearly stood still" if row["factor"] >= _STILL else "") if _is_beyond_longest(row) else ""
    )
    return f"{task} takes {factor} {times} while {other_task} runs ({', '.join(filter(None, notes))}){beyond}."


def _is_beyond_longest(row: Mapping[str, Any]) -> bool:
    """Return whether the factor is larger than any execution of the task reached."""
    least = row["min_s"] if row["free"] else row["mean_s"]
    return bool(least) and row["factor"] > row["max_s"] / least


def _by_chance(comparisons: int, remains: pl.Series) -> Iterable[Finding]:
    """Yield how many effects remain after correcting for the number of comparisons."""
    if comparisons == 1:
        return
    effects_text = f"{counted(len(remains), 'shows', 'show')} a slow-down or a speed-up"
    left_over = counted(int(remains.sum()), "remains", "remain")
    correction = f"after allowing for {comparisons:,} comparisons (Holm)"
    text = f"Of {comparisons:,} intervals of 95 %, {effects_text}; {correction}, {left_over}."
    yield Finding(text, (), "doubt")


def _nothing_certain(synergies: pl.DataFrame, n_known: int, n_unsaid: int) -> Finding:
    if synergies.is_empty():
        text = "No two agents have tasks to compare, so nothing is said of how they affect each other."
    elif n_unsaid:  # though their intervals may exclude 1
        text = "No slow-down and no speed-up is certain."
    elif not n_known:
        text = "No factor has an interval, so no slow-down is certain."
    else:
        of_all = f"all {n_known:,} intervals of 95 % include 1" if n_known > 1 else "the interval includes 1"
        text = f"No slow-down and no speed-up is certain: {of_all}."
    return Finding(text, (), "doubt")


def _below_the_mean(number: int) -> Iterable[Finding]:
    if number:
        subject = counted(number, "factor relative to the mean lies", "factors relative to the mean lie")
        reason = "which undisturbed pairs do too when others slow the task down"
        yield Finding(f"{subject} below 1, {reason}; undisturbed work was not seen enough to tell.", (), "doubt")


def _impossible_factors(number: int) -> Iterable[Finding]:
    if number:
        subject = counted(number, "factor is", "factors are")
        reason = "the data do not support a factor there, so nothing is said of it"
        yield Finding(f"{subject} at or below 0, which no duration can be: {reason}.", (), "doubt")
