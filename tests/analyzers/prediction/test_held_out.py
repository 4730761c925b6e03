"""What a forecast of a held-out run may know, and which runs and executions are predicted at all."""

from __future__ import annotations

import math

import polars as pl
import pytest
from interval_frames import Row, frame, row

from hrclog.analyzers.prediction.held_out import FORECASTS, MAKESPANS, HeldOut
from hrclog.analyzers.projections.joint_states import AgentTask
from hrclog.analyzers.synergy.fit import TaskModel
from hrclog.analyzers.synergy.log_work import NormalLogWork, expected_work_s

S = 1_000_000_000
MODEL = TaskModel({("R", "r"): math.log(2)}, NormalLogWork(1.0, 0.2))
OTHER = TaskModel({("H", "h"): math.log(1.5)}, NormalLogWork(0.5, 0.2))


def model_of(key: AgentTask, _: str) -> TaskModel | None:
    return {("H", "h"): MODEL, ("R", "r"): OTHER}.get(key)


def run_of(**changes: object) -> list[Row]:
    """Return a run in which H does h twice and R does r twice; changes are of H's first."""
    return [
        row("H", "h", 0, 4 * S, execution_id="h0") | changes,
        row("H", "h", 5 * S, 8 * S, execution_id="h1"),
        row("R", "r", 1 * S, 3 * S, execution_id="r0"),
        row("R", "r", 4 * S, 9 * S, execution_id="r1"),
    ]


def forecasts(found: list[Row]) -> dict[str, dict[str, float]]:
    rows = pl.DataFrame(list(HeldOut(frame(found)).forecasts("aft", "run", model_of)), schema=FORECASTS, orient="row")
    quantiles = ("mean_s", "median_s", "low_s", "high_s")
    return {one["execution_id"]: {name: one[name] for name in quantiles} for one in rows.to_dicts()}


def lasting(end: int) -> dict[str, object]:
    return {"end_ns": end, "until_ns": end}


@pytest.mark.parametrize("end", [1, S, 5 * S, 1000 * S])
def test_a_forecast_does_not_know_how_long_its_execution_took(end: int) -> None:
    assert forecasts(run_of(**lasting(end)))["h0"] == pytest.approx(forecasts(run_of())["h0"], rel=1e-12)


def test_a_forecast_does_not_know_what_became_of_other_executions() -> None:
    expected = forecasts(run_of())
    for changes in ({"outcome": "failed"}, {"end_ns": None, "outcome": "unknown"}, lasting(4 * S + 5)):
        found = forecasts(run_of(**changes))
        assert found["h1"] == pytest.approx(expected["h1"], rel=1e-12)
        assert ("h0" in found) == (changes.get("outcome") is None)
    failed = [one | {"outcome": "failed"} if one["agent"] == "R" else one for one in run_of()]
    assert forecasts(failed)["h0"] == expected["h0"]


def test_a_forecast_does_know_what_the_others_do_and_when() -> None:
    found = [one for one in run_of() if one["execution_id"] != "r0"]
    assert forecasts(found)["h0"]["median_s"] < forecasts(run_of())["h0"]["median_s"]


def test_only_successful_executions_that_count_and_have_a_length_are_predicted() -> None:
    more = [
        row("H", "h", 20 * S, 20 * S, execution_id="nothing"),
        row("H", "h", 21 * S, None, until_ns=22 * S, outcome="unknown", execution_id="open"),
        row("H", "h", 23 * S, 24 * S, outcome="failed", execution_id="failed"),
        row("H", "h", 25 * S, 26 * S, role="auxiliary", execution_id="home"),
        row("H", "new", 27 * S, 28 * S, execution_id="new"),
        row("H", "h", 29 * S, 29 * S + 1, execution_id="short"),
    ]
    held_out = HeldOut(frame([*run_of(), *more]))
    assert set(forecasts([*run_of(), *more])) == {"h0", "h1", "r0", "r1", "short"}
    assert set(held_out.executions["execution_id"]) == {"h0", "h1", "r0", "r1", "short", "new"}


def test_an_execution_that_ends_as_another_begins_has_the_density_of_what_came_before() -> None:
    # instants that polars and numpy turn into different seconds
    for end in range(3_000_000_001, 3_000_000_400, 7):
        found = [row("H", "h", 0, end, execution_id="h0"), row("R", "r", end, 2 * end), row("H", "h", 3 * end, 4 * end)]
        [first, *_] = HeldOut(frame(found)).forecasts("aft", "run", model_of)
        log_w = math.log(end / 1e9)
        expected = float(MODEL.log_work.log_density(log_w)) - log_w  # type: ignore[arg-type] - numpy takes numbers
        assert first[-1] == pytest.approx(expected, rel=1e-9)


def test_runs_are_in_order_of_their_first_start() -> None:
    found = [
        row("H", "h", start, start + 1, run_id=run) for run, start in (("a", 5), ("b", 1), ("c", 9), ("a", 2), ("d", 1))
    ]
    assert HeldOut(frame(found)).runs == ["b", "d", "a", "c"]


def makespan(found: list[Row], gaps: dict[str, float] | None = None) -> pl.DataFrame:
    rows = list(HeldOut(frame(found)).makespan("aft", "run", model_of, gaps or {}))
    return pl.DataFrame(rows, schema=MAKESPANS, orient="row")


def test_a_makespan_is_predicted_from_the_order_of_tasks_and_the_gaps() -> None:
    work = expected_work_s(MODEL.log_work)
    alone = [row("H", "h", 7 * S, 9 * S), row("H", "h", 10 * S, 14 * S), row("H", "h", 20 * S, 21 * S)]
    assert makespan(alone, {"H": 0.5}).row(0) == ("aft", "run", 14.0, pytest.approx(3 * work + 2 * 0.5))
    assert makespan(alone).row(0)[3] == pytest.approx(3 * work)  # an agent whose gaps nobody has seen has none


def test_a_makespan_waits_for_planned_starts_and_does_not_know_durations() -> None:
    planned = [
        row("H", "h", 7 * S, 9 * S, planned_start_ns=7 * S),
        row("H", "h", 10 * S, 14 * S, planned_start_ns=30 * S),
    ]
    longer = [planned[0] | lasting(9 * S + 5), planned[1] | lasting(99 * S)]
    work = expected_work_s(MODEL.log_work)
    for found in (planned, longer):
        assert makespan(found, {"H": 0.25})["predicted_s"].item() == pytest.approx(30 - 7 + 0.25 + work)


def test_attempts_at_one_item_are_predicted_as_one_task() -> None:
    tries = [
        row("H", "h", 0, 2 * S, item_id="i", outcome="failed"),
        row("H", "h", 3 * S, 5 * S, item_id="i", attempt=2),
    ]
    assert makespan(tries).row(0)[2:] == (5.0, pytest.approx(expected_work_s(MODEL.log_work)))


def test_a_run_with_a_task_that_was_never_learnt_has_no_makespan() -> None:
    assert makespan([*run_of(), row("H", "new", 10 * S, 11 * S)]).is_empty()


def test_a_run_of_auxiliary_executions_has_nothing_to_predict() -> None:
    found = [row("R", "home", 0, S, role="auxiliary")]
    held_out = HeldOut(frame(found))
    assert held_out.runs == ["run"]
    assert forecasts(found) == {}
    assert makespan(found).is_empty()
