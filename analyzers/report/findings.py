"""The findings at the start of a report: what the runs show, how certain that is, and what they do not show."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from statistics import mean, stdev
from typing import TYPE_CHECKING, Any, Final

import polars as pl

from hrclog.analyzers.figures.makespans import NOT_SAID, complete_runs
from hrclog.analyzers.figures.text import printable
from hrclog.analyzers.projections.overlaps import PAIR
from hrclog.analyzers.projections.plan_labels import plan_labels
from hrclog.analyzers.report.effects import effects
from hrclog.analyzers.report.finding import Finding, task_name
from hrclog.analyzers.synergy.pairs import NO_SUCCESS, UNOBSERVED, WEAKLY_IDENTIFIED
from hrclog.analyzers.synergy.untold import untold
from hrclog.diagnostic import TIMES_CORRECTED, TIMES_IN_DOUBT, Diagnostic
from hrclog.wording import counted

if TYPE_CHECKING:
    from hrclog.analyzers.result import Analysis

MOST_PLANNERS: Final = 5
MOST_FAILING: Final = 3
MOST_DOUBTS: Final = 3


def findings(analysis: Analysis) -> tuple[Finding, ...]:
    """Return the findings, each with its interval and its count, then what is not known."""
    return (
        *_lost_data(analysis),
        *_times_in_doubt(analysis.diagnostics),
        *_makespan(analysis.runs, analysis.events),
        *effects(analysis.synergies, analysis.durations, analysis.estimator),
        *_unknown_pairs(analysis.synergies),
        *_failures(analysis.durations, analysis.diagnostics),
    )


def _lost_data(analysis: Analysis) -> Iterable[Finding]:
    errors = sum(diagnostic.severity == "error" for diagnostic in analysis.diagnostics)
    if errors:
        yield Finding(f"Data was lost or skipped ({counted(errors, 'error')}, see Diagnostics).", kind="lost")


def _times_in_doubt(diagnostics: Iterable[Diagnostic]) -> Iterable[Finding]:
    told = list(diagnostics)
    doubts = tuple(printable(one.message) for one in told if one.code in TIMES_IN_DOUBT)
    if doubts:
        rest = (f"{len(doubts) - MOST_DOUBTS:,} more, see Diagnostics.",) if len(doubts) > MOST_DOUBTS else ()
        text = "Times are in doubt, so durations, overlaps and factors that follow from them may be wrong:"
        yield Finding(text, (*(f"{doubt}." for doubt in doubts[:MOST_DOUBTS]), *rest), "doubt")
    for one in told:
        if one.code == TIMES_CORRECTED:
            yield Finding(f"Times were corrected: {printable(one.message)}.")


def _makespan(runs: pl.DataFrame, events: pl.DataFrame) -> Iterable[Finding]:
    """Yield how long the runs that ended well took, by planner if several planners made the plans."""
    timed = runs.filter(pl.col("makespan_s").is_not_null())
    complete = complete_runs(runs).join(plan_labels(events), on="run_id", how="left")
    seconds = complete["makespan_s"].to_list()
    partly = f" ({complete.height:,} of {runs.height:,} runs, those that ended well)"
    which_runs = partly if complete.height < runs.height else ""
    if complete.filter(pl.col("planner") != "")["planner"].n_unique() > 1:
        yield Finding(f"Makespan by planner, mean ± sample standard deviation{which_runs}:", _by_planner(complete))
    elif len(seconds) > 1:
        middle = f"mean {mean(seconds):.1f} s ± {stdev(seconds):.1f} s"
        spread = f"(sample standard deviation, n = {len(seconds):,}), from {min(seconds):.1f} to {max(seconds):.1f} s"
        yield Finding(f"Makespan: {middle} {spread}{which_runs}.")
    elif seconds:
        yield Finding(f"Makespan: {seconds[0]:.1f} s (n = 1){which_runs}.")
    elif timed.height:
        yield Finding(f"Makespan: {_none_of(runs.height)} ended well, so none is told.", kind="doubt")


def _none_of(runs: int) -> str:
    return "not even the only run" if runs == 1 else f"none of {runs:,} runs"


def _by_planner(complete: pl.DataFrame) -> tuple[str, ...]:
    """Return mean, spread and count per planner, those with the most runs, the fastest first."""
    groups = (
        complete.with_columns(pl.col("planner").fill_null(""))
        .group_by("planner")
        .agg(pl.len().alias("n"), pl.col("makespan_s").sort().mean().alias("mean"), pl.col("makespan_s").sort().std())
        .sort("n", "mean", "planner", descending=[True, False, False])
    )
    sentences = [
        f"{printable(name) if name else NOT_SAID}: {middle:.1f} s{_plus_minus(spread)} (n = {n:,})."
        for name, n, middle, spread in groups.head(MOST_PLANNERS).sort("mean", "planner").iter_rows()
    ]
    further = groups.height - len(sentences)
    return (*sentences, f"{further:,} more in the figure of makespans.") if further else tuple(sentences)


def _plus_minus(spread: float | None) -> str:
    return "" if spread is None else f" ± {spread:.1f} s"


def _unknown_pairs(synergies: pl.DataFrame) -> Iterable[Finding]:
    counts = untold(synergies)
    if unseen := counts.get(UNOBSERVED, 0):
        text = f"{unseen:,} of {counted(synergies.height, 'ordered pair')} of tasks never overlapped"
        yield Finding(f"{text}: nothing is known of them.", (), "doubt")
    if failing := counts.get(NO_SUCCESS, 0):
        text = f"{counted(failing, 'pair')} of tasks overlapped, but the first never succeeded then, so that no factor"
        rows = synergies.filter(pl.col("status") == NO_SUCCESS).sort(
            "overlap_s", *PAIR, descending=[True, *[False] * 4]
        )
        details = [_unsuccessful(row) for row in rows.head(MOST_FAILING).iter_rows(named=True)]
        further = (f"{failing - len(details):,} more in the table of synergies.",) if failing > len(details) else ()
        yield Finding(f"{text} is told:", (*details, *further), "doubt")
    if doubtful := counts.get(WEAKLY_IDENTIFIED, 0):
        text = f"{counted(doubtful, 'pair')} of tasks overlapped, but the data do not tell a factor."
        yield Finding(text, (), "doubt")


def _unsuccessful(row: Mapping[str, Any]) -> str:
    task, other_task = task_name(row["agent"], row["task"]), task_name(row["other_agent"], row["other_task"])
    return f"{task} while {other_task} runs (n = {row['n']:,}, {row['overlap_s']:,.1f} s)."


def _failures(durations: pl.DataFrame, diagnostics: Iterable[Diagnostic]) -> Iterable[Finding]:
    total = sum(int(durations[name].sum()) for name in ("count", *_ENDINGS))
    if not total:
        return
    ending_texts = [
        f"{int(durations[name].sum()):,} {what}" for name, what in _ENDINGS.items() if durations[name].sum()
    ]
    if any(diagnostic.code == "outcome_assumed" for diagnostic in diagnostics) and not durations["n_failed"].sum():
        yield Finding("The logs tell no outcome: executions that ended are counted as completed.")
        return
    if not ending_texts:
        all_of = "The only execution of a main task" if total == 1 else f"All {total:,} executions of main tasks"
        is_suspicious = any(diagnostic.code == "single_outcome" for diagnostic in diagnostics)
        yield Finding(
            f"{all_of} succeeded{': failures may have been removed before we saw them' if is_suspicious else ''}."
        )
        return
    worst = durations.filter(pl.col("n_failed") > 0).sort("success_rate", "agent", "task", nulls_last=True)
    details = tuple(
        f"{task_name(row['agent'], row['task'])} succeeded in {row['count']:,} of {row['count'] + row['n_failed']:,} "
        f"({_percent(row['success_rate'])} [{_percent(row['success_low'])}, {_percent(row['success_high'])}])."
        for row in worst.head(MOST_FAILING).iter_rows(named=True)
    )
    further = worst.height - len(details)
    more = (
        (f"{counted(further, 'more task has', 'more tasks have')} failures, see the table of durations.",)
        if further
        else ()
    )
    text = f"Of {counted(total, 'execution')} of main tasks {', '.join(ending_texts)}"
    yield Finding(f"{text}{'; success least often:' if details else '.'}", (*details, *more))


_ENDINGS: Final = {
    "n_failed": "failed or timed out",
    "n_canceled": "were canceled or skipped",
    "n_censored": "were open when the log ended, or ended without an outcome",
}


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"
