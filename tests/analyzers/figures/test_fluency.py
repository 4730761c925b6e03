"""Fluency metrics: a row per metric and key in the plot of its unit, a dot per run."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from interval_frames import frame, seconds
from plot_marks import check, names
from run_frames import runs_of

from hrclog.analyzers.figures.fluency import fluency_plots
from hrclog.analyzers.figures.plot import Plot
from hrclog.analyzers.figures.rows import MAX_DOTS, MAX_ROWS
from hrclog.analyzers.projections.metrics import metrics
from hrclog.analyzers.projections.schemas import METRICS

if TYPE_CHECKING:
    from conftest import Runs

EVERY_METRIC = (
    *(("idle", "H"), ("concurrent_activity", "H|R"), ("functional_delay", "H>R"), ("mean_speed_scale", "R")),
    *(("start_lateness_mean_s", "H"), ("start_lateness_max_s", "H"), ("lost_time_s", "R"), ("safety_stop_s", "R")),
    *(("safety_stop_longest_s", "R"), ("safety_stop_count", "R"), ("min_distance_m", ""), ("min_distance_p5_m", "")),
)


def table(*rows: tuple[str, str, str, float]) -> pl.DataFrame:
    return pl.DataFrame(rows, schema=METRICS, orient="row")


def by_unit(found: pl.DataFrame) -> dict[str, Plot]:
    plots = fluency_plots(found)
    for plot in plots:
        check(plot)
    return {plot.path[1]: plot for plot in plots}


def values(plot: Plot, row: int) -> list[float]:
    return sorted(dot.at[0] for dot in plot.dots if row <= dot.at[1] < row + 1 and dot.rim is None)


def test_each_metric_has_a_row_in_the_plot_of_its_unit() -> None:
    plots = by_unit(table(*((run, *key, 0.5) for run in "ab" for key in EVERY_METRIC)))
    assert {unit: names(plot) for unit, plot in plots.items()} == {
        "share": ["idle: H (2)", "concurrent: H, R (2)", "delay: R after H (2)"],
        "seconds": [
            "in safety stops: R (2)",
            "longest safety stop: R (2)",
            "lost time: R (2)",
            "mean start lateness: H (2)",
            "largest start lateness: H (2)",
        ],
        "speed": ["mean speed scale: R (2)"],
        "count": ["safety stops: R (2)"],
        "distance": ["smallest distance (2)", "5th percentile of the distance (2)"],
    }


def test_every_documented_metric_is_drawn_but_the_makespan_and_the_critical_path() -> None:
    page = (Path(__file__).parents[3] / "docs" / "metrics.md").read_text(encoding="utf-8")
    columns = [line.split("|")[1] for line in page.splitlines() if line.startswith("| `")]
    documented = {name for column in columns for name in re.findall(r"`(\w+)`", column)}
    assert documented == {metric for metric, _ in EVERY_METRIC} | {"makespan_s", "critical_path_s"}


def test_distances_of_agents_are_named_by_them() -> None:
    keys = [(metric, key) for metric in ("min_distance_m", "min_distance_p5_m") for key in ("", "left", "right")]
    assert names(by_unit(table(*(("a", *key, 0.5) for key in keys)))["distance"]) == [
        *("smallest distance (1)", "smallest distance: left (1)", "smallest distance: right (1)"),
        "5th percentile of the distance (1)",
        *("5th percentile of the distance: left (1)", "5th percentile of the distance: right (1)"),
    ]


def test_agents_with_long_names_are_told_apart() -> None:
    north, south = (f"robot_arm_station_{side}_side_01_left_gripper_a" for side in ("north", "south"))
    keys = [("idle", north), ("idle", south), ("concurrent_activity", f"{north}|{south}")]
    keys += [("functional_delay", f"{north}>{south}"), ("functional_delay", f"{south}>{north}")]
    found = names(by_unit(table(*(("a", *key, 0.5) for key in keys)))["share"])
    called = {side: next(name for name in found if side in name).removeprefix("idle: ") for side in ("north", "south")}
    assert len(set(found)) == len(keys)
    assert found[3] == f"delay: {called['south'].removesuffix(' (1)')} after {called['north']}"


def test_only_what_is_drawn_is_explained() -> None:
    late = by_unit(table(("a", "start_lateness_mean_s", "H", 1.0), ("a", "safety_stop_s", "H", math.nan)))["seconds"]
    assert "lateness" in late.reading
    assert "afety stop" not in late.reading
    stops = by_unit(table(("a", "safety_stop_s", "R", 1.0), ("a", "safety_stop_longest_s", "R", 1.0)))["seconds"]
    assert stops.reading.count("Safety stop:") == 1
    assert "lateness" not in stops.reading
    assert "Idle" not in by_unit(table(("a", "functional_delay", "H>R", 1.0)))["share"].reading


def test_what_was_not_logged_has_no_plot() -> None:
    executions = frame([*seconds("H", (0, 5), (7, 2)), *seconds("R", (2, 4))])
    assert list(by_unit(metrics(executions))) == ["share"]
    assert fluency_plots(METRICS.to_frame()) == []
    assert fluency_plots(table(("a", "min_distance_m", "", math.nan), ("a", "makespan_s", "", 3.0))) == []


def test_one_run_has_dots_and_no_intervals() -> None:
    plot = by_unit(table(("a", "idle", "H", 0.25)))["share"]
    assert values(plot, 0) == [0.25]
    assert plot.strokes == ()
    assert plot.x.low == 0


def test_values_that_are_all_nothing_have_an_axis_too() -> None:
    plot = by_unit(table(*((run, "safety_stop_count", "R", 0.0) for run in "abc")))["count"]
    assert (plot.x.low, plot.x.high) == (0, 1)


def test_dots_are_called_by_their_runs() -> None:
    (plot,) = fluency_plots(table(("a", "idle", "H", 0.25), ("b", "idle", "H", 0.5)), {"a": "first"})
    assert [dot.label for dot in plot.dots[:2]] == ["first: 0.250", "b: 0.500"]


@given(st.lists(st.tuples(st.sampled_from("HRX"), st.floats(-1, 1)), max_size=20))
@settings(max_examples=40)
def test_every_value_is_in_its_row_and_the_order_of_rows_does_not_matter(found: list[tuple[str, float]]) -> None:
    rows = table(*((f"r{number}", "functional_delay", f"{a}>Z", value) for number, (a, value) in enumerate(found)))
    assert fluency_plots(rows.reverse()) == fluency_plots(rows)
    groups = {agent: sorted(value for name, value in found if name == agent) for agent, _ in sorted(found)}
    plots = by_unit(rows)
    assert len(plots) == bool(groups)
    for plot in plots.values():
        assert [values(plot, row) for row in range(len(groups))] == list(groups.values())
        drawn_means = [dot.at[0] for dot in plot.dots if dot.rim is not None]
        assert drawn_means == pytest.approx([np.mean(group) for group in groups.values()], abs=1e-12)


def test_many_runs_are_thinned_and_their_statistics_are_of_all() -> None:
    value = np.random.default_rng(3).normal(0.4, 0.1, 1000)
    plot = by_unit(table(*((f"r{n}", "idle", "H", float(one)) for n, one in enumerate(value))))["share"]
    assert len(values(plot, 0)) == MAX_DOTS
    assert (values(plot, 0)[0], values(plot, 0)[-1]) == (value.min(), value.max())
    assert names(plot) == ["idle: H (1,000)"]
    assert plot.dots[-1].at[0] == pytest.approx(value.mean())
    assert any("means are of all" in note for note in plot.notes)


def test_too_many_rows_are_said() -> None:
    agents = [f"agent{number:02}" for number in range(MAX_ROWS + 5)]
    plot = by_unit(table(*(("a", "idle", agent, 0.5) for agent in agents)))["share"]
    assert len(names(plot)) == MAX_ROWS
    assert "5 further rows are not drawn." in plot.notes


def test_the_authors_metrics_are_drawn(online: Runs) -> None:
    found = metrics(online.intervals)
    plots = by_unit(found)
    assert list(plots) == ["share", "seconds"]
    idle = found.filter(metric="idle", key="ur5_on_guide")["value"].sort().to_list()
    assert names(plots["share"])[1] == "idle: ur5_on_guide (200)"
    assert values(plots["share"], 1) == idle
    assert runs_of(online.intervals).height == 200
