"""How long runs took, by planner, by plan, or one after the other."""

from __future__ import annotations

from collections import Counter
from typing import Final

import polars as pl

from hrclog.analyzers.figures.palette import MARK
from hrclog.analyzers.figures.plot import WIDE, Axis, Band, Dot, Key, Plot, Stroke
from hrclog.analyzers.figures.rows import Row, evenly, rows_plot, span
from hrclog.analyzers.projections.mean_interval import mean_interval
from hrclog.analyzers.projections.tags import run_labels, tag_names
from hrclog.events import Outcome

MAX_GROUPS: Final = 30

NOT_SAID: Final = "not said"

HOW_TO_READ_GROUPS: Final = (
    "Each dot is a run, further left is faster. Means whose 95 % intervals are far apart differ by more than chance; "
    "where the intervals overlap much, more runs are needed to tell."
)
HOW_TO_READ_ORDER: Final = (
    "Each dot is a run, in order of time; the dashed line is their mean in its 95 % interval. Dots that drift up or "
    "down say that something changed on the way: people learn, parts wear, plans differ."
)

_NOT_DONE: Final = tuple(outcome.value for outcome in Outcome if outcome is not Outcome.SUCCEEDED)
_LABEL: Final = "makespan: seconds from the first start to the last end"
_BLUE: Final = MARK
_MOST_NAMED: Final = 12
_MOST_TAGS: Final = 4
_GROUP: Final = "group"


def makespan_plot(runs: pl.DataFrame, labels: pl.DataFrame) -> list[Plot]:
    """Return plots of the makespans: in a row per planner, else per plan, else in order of time; and by tag.

    A tag divides runs where some of its values, which are not too many, are those of several runs.

    Runs that did not succeed, or whose executions did not all end, have no makespan to compare. With fewer than two
    remaining runs, nothing is drawn.

    Args:
        runs: a frame of schema `RUNS`.
        labels: a frame of schema `PLAN_LABELS`.
    """
    complete = complete_runs(runs)
    if complete.height < 2:
        return []
    left_out = _left_out_note(runs, complete.height)
    labelled = complete.select("run_id", "makespan_s", pl.Series("label", run_labels(complete), pl.String))
    planned = labelled.join(labels, on="run_id", how="left", maintain_order="left").with_columns(
        pl.col("plan", "planner").fill_null("")
    )
    by_tag = [
        _group_plot(labelled.with_columns(complete[name].alias(_GROUP)), f"tag {name}", left_out)
        for name in _dividing_tags(complete)
    ]
    return [_main_plot(planned, left_out), *by_tag]


def _main_plot(planned: pl.DataFrame, left_out: tuple[str, ...]) -> Plot:
    with_planner = planned.filter(pl.col("planner") != "")
    if with_planner["planner"].n_unique() >= 2:
        return _group_plot(planned.rename({"planner": _GROUP}), "planner", left_out)
    plans = planned.filter(pl.col("plan") != "").group_by("plan").len()
    if (plans["len"] >= 2).any():
        return _group_plot(planned.rename({"plan": _GROUP}), "plan", left_out)
    return _order_plot(planned, left_out)


def _dividing_tags(complete: pl.DataFrame) -> list[str]:
    """Return the tags by which makespans can be compared."""
    names = tag_names(complete)
    counts = {name: Counter(filter(None, complete[name].to_list())) for name in names}
    dividing = (name for name in names if 2 <= len(counts[name]) <= MAX_GROUPS and max(counts[name].values()) > 1)
    return list(dividing)[:_MOST_TAGS]


def complete_runs(runs: pl.DataFrame) -> pl.DataFrame:
    """Return the runs whose makespans can be compared, in order of time: those that were not cut short.

    Args:
        runs: a frame of schema `RUNS`.
    """
    done = ~pl.col("outcome").is_in(_NOT_DONE) & (pl.col("n_open") == 0) & pl.col("makespan_s").is_not_null()
    return runs.filter(done).sort("start_ns", "run_id")


def _left_out_note(runs: pl.DataFrame, complete: int) -> tuple[str, ...]:
    missing = runs.height - complete
    text = "Runs left out, because they did not succeed or their executions did not all end"
    return (f"{text}: {missing:,} of {runs.height:,}.",) if missing else ()


def _group_plot(complete: pl.DataFrame, kind: str, notes: tuple[str, ...]) -> Plot:
    """Return a plot with a row for each value of the column `_GROUP`; `kind` says what these are."""
    groups = (
        complete.group_by(_GROUP)
        .agg(pl.len().alias("n"), pl.col("makespan_s").sort().mean().alias("mean"), "makespan_s", "label")
        .sort(["n", "mean", _GROUP], descending=[True, False, False])
    )
    has_more = groups.height > MAX_GROUPS
    group_note = f"{MAX_GROUPS} of {groups.height:,} {kind}s are drawn, those with the most runs." if has_more else ""
    drawn_groups = groups.head(MAX_GROUPS).sort("mean", _GROUP)
    rows = [
        Row(name or NOT_SAID, tuple(seconds), tuple(names))
        for name, seconds, names in drawn_groups.select(_GROUP, "makespan_s", "label").iter_rows()
    ]
    return rows_plot(
        ("makespans", kind),
        f"How long runs took, by {kind.removeprefix('tag ')}",
        HOW_TO_READ_GROUPS,
        rows,
        _LABEL,
        unit="s",
        boxes=True,
        notes=(*notes, group_note) if group_note else notes,
    )


def _order_plot(complete: pl.DataFrame, notes: tuple[str, ...]) -> Plot:
    seconds = complete["makespan_s"].to_numpy()
    mean, *ends = mean_interval(seconds)
    known_ends = [end for end in ends if end is not None]
    low, high = span(seconds, known_ends)
    indices = evenly(len(seconds)).tolist()
    remarks = (
        f"{len(indices):,} of {len(seconds):,} runs are drawn; the mean is of all."
        if len(indices) < len(seconds)
        else "",
        "The interval reaches beyond the axis." if min(known_ends) < low or max(known_ends) > high else "",
    )
    first, last = 0.5, len(seconds) + 0.5
    names = complete["label"].to_list()
    interval = " to ".join(f"{end:,.3f}" for end in known_ends)
    label = f"mean {mean:,.3f} s (95 % {interval}), n = {len(seconds):,}"
    return Plot(
        path=("makespans", "order"),
        title="How long runs took, in order of time",
        reading=HOW_TO_READ_ORDER,
        x=Axis(first, last, "run", ticks=_run_ticks(len(seconds))),
        y=Axis(low, high, "makespan, seconds", grid=True),
        area=(WIDE, 320),
        bands=(Band((first, last), (max(min(known_ends), low),) * 2, (min(max(known_ends), high),) * 2, _BLUE),),
        strokes=(Stroke(((first, mean), (last, mean)), "ink", 1.5, label, dashed=True),),
        dots=tuple(
            Dot((index + 1.0, float(seconds[index])), 3.0, _BLUE, f"{names[index]}: {seconds[index]:,.3f} s")
            for index in indices
        ),
        keys=(Key("a run", _BLUE, "dot"), Key("mean", "ink", "line")),
        notes=(*notes, *(text for text in remarks if text)),
    )


def _run_ticks(count: int) -> tuple[tuple[float, str], ...]:
    """Return a tick per run, or none if round numbers are enough."""
    return tuple((index + 1.0, str(index + 1)) for index in range(count)) if count <= _MOST_NAMED else ()
