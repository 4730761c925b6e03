"""The tables that a person reads first."""

from __future__ import annotations

from pathlib import Path
from statistics import mean, stdev
from typing import TYPE_CHECKING, Any

from hrclog.cli.common import number, printable, table
from hrclog.diagnostic import TIMES_CORRECTED, TIMES_IN_DOUBT
from hrclog.wording import counted

if TYPE_CHECKING:
    import polars as pl

    from hrclog.analyzers.result import Analysis

_MOST_ROWS = 40
_MOST_DOUBTS = 5


def summary(analysis: Analysis, output: Path, drawn: int) -> str:
    """Return the tables that a person reads first; `drawn` runs have a recording of their own."""
    parts = [_headline(analysis), _durations(analysis), _metrics(analysis), _synergies(analysis), _clocks(analysis)]
    runs = analysis.runs.height
    selection = (
        f" ({drawn} of {counted(runs, 'run')}, evenly spread; --recordings all draws each)" if drawn < runs else ""
    )
    parts.append(
        f"Written to {output}: analysis.json, executions.csv, *.parquet, analysis.rrd, runs/*.rrd{selection}\n"
        f"Look at it: hrclog view {output}"
    )
    return "\n\n".join(part for part in parts if part)


def _headline(analysis: Analysis) -> str:
    from hrclog.analyzers.projections.tags import tags_summary

    runs = analysis.runs
    agents = ", ".join(runs["agents"].explode(empty_as_null=False).unique().sort()) or "none"
    executions = counted(int(runs["n_executions"].sum()), "execution")
    text = f"{counted(runs.height, 'run')}, {executions}, agents: {printable(agents)}"
    tags = tags_summary(runs)
    tagged = f"\ntags: {printable(tags)}" if tags else ""
    return f"{text}{tagged}\n{_makespan(runs)}".rstrip()


def _makespan(runs: pl.DataFrame) -> str:
    """Return the makespans of the runs that ended well, and the number of those runs."""
    from hrclog.analyzers.figures.makespans import complete_runs

    seconds = complete_runs(runs)["makespan_s"].to_list()
    timed = runs["makespan_s"].drop_nulls().len()
    if timed and not seconds:
        return f"makespan not known: {'the run did not end well' if timed == 1 else f'none of {timed} runs ended well'}"
    selection = f" ({len(seconds)} of {runs.height} runs, those that ended well)" if len(seconds) < runs.height else ""
    return makespan(seconds) + (selection if seconds else "")


def makespan(seconds: list[float]) -> str:
    """Return mean, spread and count of makespans as a sentence."""
    if len(seconds) > 1:
        spread = f"+- {stdev(seconds):.1f} (sample standard deviation, n = {len(seconds)})"
        return f"makespan {mean(seconds):.1f} s {spread}"
    return f"makespan {seconds[0]:.1f} s (n = 1)" if seconds else ""


def _durations(analysis: Analysis) -> str:
    if analysis.durations.is_empty():
        return ""
    rows = [
        (
            row["agent"],
            row["task"],
            number(row["mean_s"]),
            number(row["std_s"]),
            number(row["median_s"]),
            number(row["min_s"]),
            number(row["max_s"]),
            str(row["count"]),
            str(row["n_failed"]),
            str(row["n_canceled"]),
            str(row["n_censored"]),
        )
        for row in analysis.durations.head(_MOST_ROWS).iter_rows(named=True)
    ]
    header = ("agent", "task", "mean", "std", "median", "min", "max", "n", "failed", "canceled", "open")
    return (
        "Durations in s (of executions that succeeded)\n"
        + table(header, rows, lambda i: i > 1)
        + _omitted_note(analysis.durations.height)
    )


def _metrics(analysis: Analysis) -> str:
    """Return mean and spread over the runs of every metric but the makespan, which stands in the headline."""
    rows = []
    groups = analysis.metrics.sort("metric", "key").group_by("metric", "key", maintain_order=True)
    for (metric, key), part in groups:
        if metric != "makespan_s":
            values: list[float] = part["value"].to_list()
            spread = stdev(values) if len(values) > 1 else None
            rows.append((str(metric), str(key), number(mean(values)), number(spread), str(len(values))))
    if not rows:
        return ""
    metrics_table = table(("metric", "of", "mean", "std", "runs"), rows[:_MOST_ROWS], lambda i: i > 1)
    title = "Metrics per run (fractions of the makespan, *_s in seconds; docs/metrics.md)"
    return f"{title}\n{metrics_table}{_omitted_note(len(rows))}"


def _synergies(analysis: Analysis) -> str:
    if analysis.synergies.is_empty():
        return ""
    seen = analysis.synergies.filter(analysis.synergies["n"] > 0)
    free = bool(seen["synergy_free"].is_not_null().any())
    rows = [
        (
            f"{row['agent']}: {row['task']}",
            f"{row['other_agent']}: {row['other_task']}",
            number(row["synergy"]),
            f"[{number(row['ci_low'])}, {number(row['ci_high'])}]",
            *([_free(row)] if free else []),
            str(row["n"]),
            number(row["overlap_s"], 1),
            row["status"],
        )
        for row in seen.head(_MOST_ROWS).iter_rows(named=True)
    ]
    title = (
        f"Synergies by {analysis.estimator}: factor on a task's mean duration while another's task runs (> 1 is slower)"
    )
    drawn = f"\nIntervals come from {counted(analysis.bootstrap, 'draw')} of whole runs" if analysis.bootstrap else ""
    note = drawn + "".join(f"\n{line}" for line in _untold_lines(analysis.synergies))
    header = ("task", "while", "factor", "95 % interval", *(["over free"] if free else []), "n", "overlap s", "status")
    return f"{title}\n{table(header, rows, lambda i: 1 < i < len(header) - 1)}{_omitted_note(seen.height)}{note}"


def _untold_lines(synergies: pl.DataFrame) -> list[str]:
    """Return which pairs of tasks have no factor, and why; weakly identified ones are marked in the table."""
    from hrclog.analyzers.synergy.pairs import NO_SUCCESS, UNOBSERVED
    from hrclog.analyzers.synergy.untold import untold

    counts = untold(synergies)
    lines = {
        NO_SUCCESS: "of tasks overlapped, but the first never succeeded then (no_success): no factor is told",
        UNOBSERVED: "of tasks never overlapped: not observed",
    }
    return [f"{counted(counts[status], 'pair')} {text}" for status, text in lines.items() if status in counts]


def _clocks(analysis: Analysis) -> str:
    """Return what was corrected in the times of agents, and what is in doubt."""
    codes = (TIMES_CORRECTED, *TIMES_IN_DOUBT)
    told = [diagnostic for diagnostic in analysis.diagnostics if diagnostic.code in codes]
    lines = [f"  {printable(diagnostic.message)}" for diagnostic in told[:_MOST_DOUBTS]]
    if len(told) > _MOST_DOUBTS:
        lines.append(f"  ... and {len(told) - _MOST_DOUBTS} more, see analysis.json")
    doubted = any(diagnostic.code in TIMES_IN_DOUBT for diagnostic in told)
    title = "Times are in doubt, and with them the numbers above:" if doubted else "Times were corrected:"
    return "\n".join([title, *lines]) if told else ""


def _free(row: dict[str, Any]) -> str:
    if row["synergy_free"] is None:
        return "n/a"
    ends = "" if row["free_ci_low"] is None else f" [{number(row['free_ci_low'])}, {number(row['free_ci_high'])}]"
    return number(row["synergy_free"]) + ends


def _omitted_note(height: int) -> str:
    return f"\n... and {counted(height - _MOST_ROWS, 'more row')}, see analysis.json" if height > _MOST_ROWS else ""
