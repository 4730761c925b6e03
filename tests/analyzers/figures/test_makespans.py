"""How long runs took: every run a dot in its row, sorted by mean, and what is left out is said."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plot_marks import check, names
from run_frames import labels_of, runs_of, runs_that_took

from hrclog.analyzers.figures.makespans import MAX_GROUPS, NOT_SAID, makespan_plot
from hrclog.analyzers.figures.palette import CARD
from hrclog.analyzers.figures.plot import Dot, Plot
from hrclog.analyzers.figures.rows import MAX_DOTS, evenly, spread
from hrclog.analyzers.projections.plan_labels import plan_labels

if TYPE_CHECKING:
    from conftest import Runs


def drawn(runs: pl.DataFrame, labels: pl.DataFrame | None = None) -> Plot:
    plots = makespan_plot(runs, labels_of(runs) if labels is None else labels)
    assert len(plots) == 1
    check(plots[0])
    return plots[0]


def values(plot: Plot, row: int) -> list[float]:
    """Return what the dots of a row stand at, without its mean."""
    return sorted(dot.at[0] for dot in plot.dots if row <= dot.at[1] < row + 1 and dot.rim is None)


def means(plot: Plot) -> list[Dot]:
    return [dot for dot in plot.dots if dot.rim == CARD]


def test_planners_have_a_row_each_the_fastest_on_top() -> None:
    runs = runs_that_took(90, 100, 70, 80, 60)
    plot = drawn(runs, labels_of(runs, planners=["slow", "slow", "fast", "fast", ""]))
    assert plot.path == ("makespans", "planner")
    assert names(plot) == [f"{NOT_SAID} (1)", "fast (2)", "slow (2)"]
    assert [values(plot, row) for row in range(3)] == [[60], [70, 80], [90, 100]]
    assert [dot.at[0] for dot in means(plot)] == [60, 75, 95]
    boxes = [(rect.low[0], rect.high[0]) for rect in plot.rects]
    assert boxes == [(72.5, 77.5), (92.5, 97.5)], "one run has no quartiles"


def test_plans_have_rows_where_some_plan_was_run_twice() -> None:
    runs = runs_that_took(9, 7, 8)
    plot = drawn(runs, labels_of(runs, plans=["a", "b", "a"], planners=["one"] * 3))
    assert plot.path == ("makespans", "plan")
    assert names(plot) == ["b (1)", "a (2)"]


@pytest.mark.parametrize("plans", [[], ["a", "b", "c"]])
def test_runs_stand_in_order_of_time_where_nothing_groups_them(plans: list[str]) -> None:
    runs = runs_that_took(9, 7, 8)
    plot = drawn(runs.reverse(), labels_of(runs, plans=plans))
    assert plot.path == ("makespans", "order")
    assert [dot.at for dot in plot.dots] == [(1.0, 9.0), (2.0, 7.0), (3.0, 8.0)]
    (mean,) = plot.strokes
    assert {y for _, y in mean.points} == {8.0}
    assert [dot.label for dot in plot.dots] == ["run 0: 9.000 s", "run 1: 7.000 s", "run 2: 8.000 s"]


def test_runs_without_a_good_end_are_left_out_and_said() -> None:
    bad = [
        runs_that_took(1, outcome="failed"),
        runs_that_took(1, outcome="canceled"),
        runs_that_took(1, n_open=1),
        runs_that_took(None),
    ]
    told = [part.with_columns(pl.lit(f"bad{number}").alias("run_id")) for number, part in enumerate(bad)]
    runs = pl.concat([runs_that_took(9, 7), *told])
    plot = drawn(runs)
    assert sorted(dot.at[1] for dot in plot.dots) == [7.0, 9.0]
    assert plot.notes[0].endswith("4 of 6.")
    assert not drawn(runs_that_took(9, 7)).notes or "left out" not in drawn(runs_that_took(9, 7)).notes[0]


def test_a_run_whose_log_has_no_end_counts_if_nothing_was_left_open() -> None:
    assert len(drawn(runs_that_took(9, 7, outcome="")).dots) == 2


@pytest.mark.parametrize(
    "runs",
    [runs_that_took(), runs_that_took(5), runs_that_took(5, 6, outcome="failed"), runs_that_took(None, None)],
    ids=["none", "one", "all failed", "none started"],
)
def test_fewer_than_two_complete_runs_are_not_compared(runs: pl.DataFrame) -> None:
    assert makespan_plot(runs, labels_of(runs)) == []


def test_of_many_plans_those_with_most_runs_are_drawn() -> None:
    count = MAX_GROUPS + 3
    plans = [f"p{number:02}" for number in range(count)] + [f"p{number:02}" for number in range(3, count)]
    runs = runs_that_took(*(float(100 + number) for number in range(len(plans))))
    plot = drawn(runs, labels_of(runs, plans=plans))
    assert names(plot) == [f"p{number:02} (2)" for number in range(3, count)]
    assert any(f"{MAX_GROUPS} of {count} plans" in note for note in plot.notes)


@given(st.lists(st.tuples(st.sampled_from("abc"), st.floats(1, 1000)), min_size=2, max_size=12))
@settings(max_examples=40)
def test_every_run_is_in_its_row_whatever_the_order_of_rows(found: list[tuple[str, float]]) -> None:
    runs = runs_that_took(*(took for _, took in found))
    labels = labels_of(runs, planners=[planner for planner, _ in found])
    plot = drawn(runs, labels)
    assert makespan_plot(runs.sample(fraction=1, shuffle=True, seed=1), labels.reverse()) == [plot]
    groups = {planner: sorted(took for name, took in found if name == planner) for planner, _ in found}
    if len(groups) > 1:
        assert {names(plot)[row].split()[0]: values(plot, row) for row in range(len(groups))} == groups
        found_means = [dot.at[0] for dot in means(plot)]
        assert found_means == sorted(found_means)
        assert sorted(found_means) == pytest.approx(sorted(np.mean(took) for took in groups.values()))
    elif plot.path[1] == "order":
        assert sorted(dot.at[1] for dot in plot.dots) == sorted(took for _, took in found)


def test_many_runs_are_thinned_their_ends_kept_and_their_mean_of_all() -> None:
    took = [float(100 + number % 97) for number in range(1000)]
    runs = runs_that_took(*took)
    order = drawn(runs)
    assert len(order.dots) == MAX_DOTS
    assert order.strokes[0].points[0][1] == pytest.approx(np.mean(took))
    assert "500 of 1,000 runs are drawn" in order.notes[0]
    rows = drawn(runs, labels_of(runs, planners=["one"] * 999 + ["other"]))
    assert len(values(rows, 0)) + len(values(rows, 1)) == MAX_DOTS + 1
    assert (min(dot.at[0] for dot in rows.dots), max(dot.at[0] for dot in rows.dots)) == (min(took), max(took))
    assert any("more than 500 runs" in note for note in rows.notes)


def test_a_wide_interval_of_few_runs_does_not_squeeze_the_others() -> None:
    runs = runs_that_took(90, 100, 70, 71)
    plot = drawn(runs, labels_of(runs, planners=["a", "a", "b", "b"]))
    assert 60 < plot.x.low < plot.x.high < 115
    assert any("beyond the axis: 1." in note for note in plot.notes)
    assert "The interval reaches beyond the axis." in drawn(runs_that_took(90, 100)).notes


def test_dots_of_equal_values_stand_apart_the_same_way_every_time() -> None:
    offsets = spread(20)
    assert abs(offsets).max() <= 1
    assert np.diff(np.sort(offsets)).min() > 0.02
    assert (spread(20) == offsets).all()
    assert evenly(7, 3).tolist() == [0, 3, 6]


def test_the_authors_planners_come_from_the_fastest_to_the_slowest(online: Runs) -> None:
    plot = drawn(runs_of(online.intervals), plan_labels(online.events))
    assert names(plot) == [
        "COMPLETE_SOLVER (50)",
        "RELAXED_HA_SOLVER (50)",
        "NOT_NEIGHBORING_TASKS (50)",
        "BASIC_SOLVER (50)",
    ]
    assert [round(dot.at[0], 1) for dot in means(plot)] == [77.0, 82.1, 88.4, 94.1]
    assert not plot.notes
