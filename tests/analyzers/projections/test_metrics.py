"""Metrics against Hoffman's figures, the authors' online runs, and hand-made ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import polars as pl
import pytest
from hypothesis import given, settings
from interval_frames import Row, frame, row, rows, seconds

from hrclog.analyzers.projections.metrics import metrics, nested
from hrclog.analyzers.projections.runs import runs
from hrclog.analyzers.projections.schemas import METRICS, SIGNALS

if TYPE_CHECKING:
    from conftest import Runs

SECOND = 1_000_000_000


def of(found: list[Row], **others: object) -> dict[str, Any]:
    return nested(metrics(frame(found), **others))["run"]


def test_hoffmans_turn_taking_without_a_wait() -> None:
    found = of([*seconds("H", (0, 5), (10, 5), (20, 5)), *seconds("R", (5, 5), (15, 5))])
    assert found["makespan_s"] == 25
    assert found["idle"] == pytest.approx({"H": 0.4, "R": 0.6})
    assert found["concurrent_activity"] == {"H|R": 0}
    assert found["functional_delay"] == {"H>R": 0, "R>H": 0}


def test_hoffmans_turn_taking_with_an_early_human_and_a_late_robot() -> None:
    found = of([*seconds("H", (0, 6), (12, 6), (24, 6)), *seconds("R", (8, 6), (20, 6))])
    assert found["makespan_s"] == 30
    assert found["idle"] == pytest.approx({"H": 0.4, "R": 0.6})
    assert found["concurrent_activity"] == pytest.approx({"H|R": 4 / 30})
    # robot delay sums the robot's waits after human actions, human delay the human's
    assert found["functional_delay"] == pytest.approx({"H>R": 4 / 30, "R>H": -4 / 30})


PLANNERS = {  # T s, human idle, robot idle, concurrent
    "BASIC_SOLVER": (94.1, 0.236, 0.063, 0.714),
    "NOT_NEIGHBORING_TASKS": (88.4, 0.292, 0.067, 0.667),
    "RELAXED_HA_SOLVER": (82.1, 0.125, 0.128, 0.778),
    "COMPLETE_": (77.0, 0.096, 0.155, 0.755),
}


def test_the_means_of_each_planner_are_the_published_ones(online: Runs) -> None:
    names = runs(online.events, online.intervals).select("run_id", "name")
    found = metrics(online.intervals, online.events).join(names, on="run_id")
    columns = (("makespan_s", ""), ("idle", "human_right_arm"), ("idle", "ur5_on_guide"))
    columns += (("concurrent_activity", "human_right_arm|ur5_on_guide"),)
    for planner, expected in PLANNERS.items():
        of_planner = found.filter(pl.col("name").str.starts_with(planner))
        assert of_planner["run_id"].n_unique() == 50
        for (metric, key), value, digits in zip(columns, expected, (1, 3, 3, 3), strict=True):
            mean = of_planner.filter((pl.col("metric") == metric) & (pl.col("key") == key))["value"].mean()
            assert round(mean, digits) == value


def test_one_agent_has_idle_time_and_nothing_of_two() -> None:
    found = of(seconds("H", (0, 5), (10, 5)))
    assert found == {"makespan_s": 15, "idle": {"H": pytest.approx(1 / 3)}, "critical_path_s": 10}


def test_a_run_of_no_length_has_a_makespan_of_zero_and_no_fractions() -> None:
    assert of([row("H", "x", 7, 7), row("R", "y", 7, 7)]) == {"makespan_s": 0, "critical_path_s": 0}


def test_three_agents_have_every_pair_and_direction() -> None:
    found = of([*seconds("A", (0, 5)), *seconds("B", (1, 5)), *seconds("C", (2, 5))])
    assert set(found["concurrent_activity"]) == {"A|B", "A|C", "B|C"}
    assert set(found["functional_delay"]) == {"A>B", "B>A", "A>C", "C>A", "B>C", "C>B"}
    # A and B end before C's start is over: the other's first start after this action's start
    assert found["functional_delay"]["A>C"] == pytest.approx((2 - 5) / 7)
    assert found["functional_delay"]["C>A"] == 0


def test_an_agent_that_overlaps_itself_is_busy_once() -> None:
    found = of([*seconds("H", (0, 6), (2, 6)), *seconds("R", (0, 10))])
    assert found["idle"] == pytest.approx({"H": 0.2, "R": 0})
    assert found["concurrent_activity"] == pytest.approx({"H|R": 0.8})


def test_auxiliary_executions_count_and_steps_of_a_sequence_do_not() -> None:
    home = row("R", "home", 5 * SECOND, 10 * SECOND, role="auxiliary")
    step = row("R", "step", 0, 50 * SECOND, parent_execution_id="x0")
    found = of([*seconds("H", (0, 5)), home, step])
    assert (found["makespan_s"], found["idle"]) == (10, {"H": 0.5, "R": 0.5})


def test_lateness_compares_only_starts_that_were_planned() -> None:
    found = of([
        row("H", "x", 3 * SECOND, 4 * SECOND, planned_start_ns=2 * SECOND),
        row("H", "y", 5 * SECOND, 6 * SECOND, planned_start_ns=8 * SECOND),
        row("H", "z", 7 * SECOND, 8 * SECOND),
        row("R", "z", 7 * SECOND, 8 * SECOND),
    ])  # fmt: skip
    assert found["start_lateness_mean_s"] == {"H": -1}
    assert found["start_lateness_max_s"] == {"H": 1}


def test_the_critical_path_follows_the_precedences_it_is_given() -> None:
    found = [row("H", "x", 0, 5 * SECOND, item_id="i"), row("R", "y", 5 * SECOND, 9 * SECOND, item_id="j")]
    assert of(found)["critical_path_s"] == 5
    assert of(found, precedences=[("i", "j")])["critical_path_s"] == 9


def test_the_minimum_distance_is_that_of_the_finite_samples() -> None:
    values = [0.5, 0.4, float("nan"), float("-inf"), 0.9, *[1.0] * 96]
    samples = [("run", "min_distance", n, value) for n, value in enumerate(values)]
    samples.append(("run", "another", 0, 0.0))
    found = of(seconds("H", (0, 5)), signals=pl.DataFrame(samples, schema=SIGNALS, orient="row"))
    assert found["min_distance_m"] == 0.4
    assert found["min_distance_p5_m"] == 1.0


def test_a_signal_without_a_finite_sample_says_nothing() -> None:
    samples = pl.DataFrame([("run", "min_distance", 0, float("nan"))], schema=SIGNALS, orient="row")
    assert "min_distance_m" not in of(seconds("H", (0, 5)), signals=samples)


@settings(max_examples=60)
@given(rows(scale=SECOND))
def test_fractions_are_fractions_and_each_run_has_a_makespan(found: list[Row]) -> None:
    table = metrics(frame(found))
    assert table.schema == METRICS
    assert table["value"].is_finite().all()
    fractions = table.filter(pl.col("metric").is_in(["idle", "concurrent_activity"]))["value"]
    assert fractions.is_between(-1e-12, 1 + 1e-12).all()
    top = {one["run_id"] for one in found if not one["parent_execution_id"]}
    assert set(table.filter(pl.col("metric") == "makespan_s")["run_id"]) == top


@settings(max_examples=60)
@given(rows(scale=SECOND))
def test_the_critical_path_is_no_longer_than_the_makespan(found: list[Row]) -> None:
    for run in nested(metrics(frame(found))).values():
        assert run["critical_path_s"] <= run["makespan_s"]
