"""What a report says first: what the runs tell for sure, how sure, and what they do not tell."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from statistics import mean, stdev
from typing import TYPE_CHECKING, Any, Final, Literal

import polars as pl

from hrclog.analyzers.figures.text import printable
from hrclog.analyzers.synergy.pairs import OK, UNOBSERVED, WEAKLY_IDENTIFIED

if TYPE_CHECKING:
    from hrclog.analyzers.analysis import Analysis

MOST_EFFECTS: Final = 5
"""Slow-downs, and speed-ups, that are listed."""
MOST_FAILING: Final = 3

_MISSES: Final = 0.05  # of 95 % intervals
_STATUS: Final = {"sparse": "few pairs", WEAKLY_IDENTIFIED: "weakly identified"}


@dataclass(frozen=True, slots=True)
class Finding:
    """A sentence, and details in sentences of their own; `doubt` limits what the others say, `lost` spoils it."""

    text: str
    details: tuple[str, ...] = ()
    kind: Literal["lost", "fact", "doubt"] = "fact"


def findings(analysis: Analysis) -> tuple[Finding, ...]:
    """Return what stands out, each with its interval and its count, and then what is not known."""
    return (
        *_lost(analysis),
        *_makespan(analysis.runs),
        *_effects(analysis.synergies),
        *_unknown_pairs(analysis.synergies),
        *_failures(analysis.durations),
    )


def _lost(analysis: Analysis) -> Iterable[Finding]:
    errors = sum(diagnostic.severity == "error" for diagnostic in analysis.diagnostics)
    if errors:
        yield Finding(f"Data was lost or skipped ({_count(errors, 'error')}, see Diagnostics).", kind="lost")


def _makespan(runs: pl.DataFrame) -> Iterable[Finding]:
    seconds = runs["makespan_s"].drop_nulls().to_list()
    if len(seconds) > 1:
        middle = f"mean {mean(seconds):.1f} s ± {stdev(seconds):.1f} s"
        spread = f"(sample standard deviation, n = {len(seconds):,}), from {min(seconds):.1f} to {max(seconds):.1f} s"
        yield Finding(f"Makespan: {middle} {spread}.")
    elif seconds:
        yield Finding(f"Makespan: {seconds[0]:.1f} s (n = 1).")


def _effects(synergies: pl.DataFrame) -> Iterable[Finding]:
    """Say which factors are surely above or below 1, and how many would be by chance."""
    known = synergies.filter(pl.col("ci_low").is_not_null() & pl.col("ci_high").is_not_null())
    slower = known.filter(pl.col("ci_low") > 1).sort("ci_low", *_KEY, descending=[True, *[False] * len(_KEY)])
    faster = known.filter(pl.col("ci_high") < 1).sort("ci_high", *_KEY)
    certain = slower.height + faster.height
    if not certain:
        yield _nothing_certain(synergies, known)
        return
    if slower.height:
        text = f"{_count(slower.height, 'slow-down')} whose 95 % interval lies above 1, clearest first:"
        yield Finding(text, _sentences(slower))
    if faster.height:
        text = f"{_count(faster.height, 'speed-up')} whose 95 % interval lies below 1, clearest first"
        yield Finding(f"{text} (the mean it relates to contains all slow-downs):", _sentences(faster))
    yield Finding(_by_chance(known.height, certain), (), "doubt")


def _by_chance(intervals: int, exclude: int) -> str:
    """Say how many intervals would exclude 1 without any effects, as if they were independent."""
    from scipy.special import bdtrc

    found = f"Of {_count(intervals, 'interval')} of 95 %, {exclude:,} exclude{'s' if exclude == 1 else ''} 1"
    as_many = float(bdtrc(exclude - 1, intervals, _MISSES))
    verdict = ", so this may be chance" if as_many > _MISSES else ""
    return f"{found}; without any effects about {intervals * _MISSES:.1f} would{verdict}."


def _nothing_certain(synergies: pl.DataFrame, known: pl.DataFrame) -> Finding:
    if synergies.is_empty():
        text = "No two agents have tasks to compare, so nothing is said of how they affect each other."
    elif known.is_empty():
        text = "No factor has an interval, so no slow-down is certain."
    else:
        of_all = f"all {known.height:,} intervals of 95 % include 1" if known.height > 1 else "the interval includes 1"
        text = f"No slow-down and no speed-up is certain: {of_all}."
    return Finding(text, (), "doubt")


_KEY: Final = ("agent", "task", "other_agent", "other_task")


def _sentences(rows: pl.DataFrame) -> tuple[str, ...]:
    shown = tuple(effect_sentence(row) for row in rows.head(MOST_EFFECTS).iter_rows(named=True))
    further = rows.height - len(shown)
    return (*shown, f"{further:,} more in the table of synergies.") if further else shown


def effect_sentence(row: Mapping[str, Any]) -> str:
    """Return a row of `SYNERGIES` with an interval as a sentence."""
    digits = 3 if "1.00" in (f"{row['ci_low']:.2f}", f"{row['ci_high']:.2f}") else 2  # it matters on which side of 1
    factor = f"{row['synergy']:.{digits}f} [{row['ci_low']:.{digits}f}, {row['ci_high']:.{digits}f}]"
    doubt = "" if row["status"] == OK else f", {_STATUS.get(row['status'], row['status'])}"
    one, other = _name(row["agent"], row["task"]), _name(row["other_agent"], row["other_task"])
    return f"{one} takes {factor} times its mean while {other} runs (n = {row['n']:,}{doubt})."


def _unknown_pairs(synergies: pl.DataFrame) -> Iterable[Finding]:
    unseen = synergies.filter(pl.col("status") == UNOBSERVED).height
    untold = synergies.filter((pl.col("status") != UNOBSERVED) & pl.col("synergy").is_null()).height
    if unseen:
        text = f"{unseen:,} of {_count(synergies.height, 'ordered pair')} of tasks never overlapped in executions that"
        yield Finding(f"{text} succeeded: nothing is known of them.", (), "doubt")
    if untold:
        yield Finding(f"{_count(untold, 'pair')} of tasks overlapped, but the data do not tell a factor.", (), "doubt")


def _failures(durations: pl.DataFrame) -> Iterable[Finding]:
    total = sum(int(durations[name].sum()) for name in ("count", *_ENDINGS))
    if not total:
        return
    bad = [f"{int(durations[name].sum()):,} {what}" for name, what in _ENDINGS.items() if durations[name].sum()]
    if not bad:
        yield Finding(f"All {_count(total, 'execution')} of main tasks succeeded.")
        return
    worst = durations.filter(pl.col("n_failed") > 0).sort("success_rate", "agent", "task", nulls_last=True)
    details = tuple(
        f"{_name(row['agent'], row['task'])} succeeded in {row['count']:,} of {row['count'] + row['n_failed']:,} "
        f"({_percent(row['success_rate'])} [{_percent(row['success_low'])}, {_percent(row['success_high'])}])."
        for row in worst.head(MOST_FAILING).iter_rows(named=True)
    )
    further = worst.height - len(details)
    more = (f"{further:,} more tasks have failures, see the table of durations.",) if further else ()
    text = f"Of {_count(total, 'execution')} of main tasks {', '.join(bad)}"
    yield Finding(f"{text}{'; success least often:' if details else '.'}", (*details, *more))


_ENDINGS: Final = {
    "n_failed": "failed or timed out",
    "n_canceled": "were canceled or skipped",
    "n_censored": "were open when the log ended",
}


def _name(agent: str, task: str) -> str:
    return f"{printable(agent)}: {printable(task)}"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _count(number: int, what: str) -> str:
    return f"{number:,} {what}{'' if number == 1 else 's'}"
