"""Estimates against a known truth, by hand and on simulated runs."""

from __future__ import annotations

import math

import polars as pl
import pytest
from interval_frames import frame, row
from simulated_frames import simulated_frame

from hrclog.analyzers.prediction.score_truth import pair_errors, true_pairs, truth_figures
from hrclog.analyzers.projections.schemas import SYNERGIES
from hrclog.analyzers.synergy.aft import aft
from hrclog.analyzers.synergy.fit import Fit
from hrclog.analyzers.synergy.mean import mean
from hrclog.analyzers.synergy.observations import Observations, observe
from hrclog.errors import HrclogError

S = 1_000_000_000


def fit(*rows: dict[str, object]) -> Fit:
    table = pl.DataFrame([dict.fromkeys(SYNERGIES.names()) | one for one in rows], schema=SYNERGIES)
    return Fit(table, {})


def pair(agent: str, task: str, other: str, other_task: str) -> dict[str, object]:
    return {"agent": agent, "task": task, "other_agent": other, "other_task": other_task}


def durations() -> Observations:
    """Return observations in which a takes 4 s on average, and b 10 s."""
    return observe(frame([row("H", "a", 0, 3 * S), row("H", "a", 9 * S, 14 * S), row("R", "b", 0, 10 * S)]))


TRUTH = true_pairs(
    [("H", "a", math.log(2), 0.0), ("R", "b", math.log(8), 0.5)],
    [("H", "a", "R", "b", 2.5), ("R", "b", "H", "a", 1.25), ("H", "a", "R", "stop", None)],
)


def test_a_truth_is_the_factor_and_the_mean_duration_beside_the_other() -> None:
    assert TRUTH["s"].to_list() == [2.5, 1.25]  # without the full stop
    assert TRUTH["beside_s"].to_list() == pytest.approx([5.0, 8 * math.exp(0.125) * 1.25])


def test_errors_are_relative_to_the_duration_beside_and_to_the_factor() -> None:
    found = pair_errors(
        fit(
            pair("H", "a", "R", "b")
            | {"synergy": 1.5, "ci_low": 1.2, "ci_high": 1.3}
            | {"synergy_free": 2.0, "free_ci_low": 1.8, "free_ci_high": 2.4},
            pair("R", "b", "H", "a") | {"synergy": 1.0},
        ),
        durations(),
        TRUTH,
    )
    rows = {(one["kind"], one["agent"]): one for one in found.to_dicts()}
    assert set(rows) == {("beside", "H"), ("beside", "R"), ("free", "H")}
    assert rows["beside", "H"]["error"] == pytest.approx(1.5 * 4 / 5 - 1)
    assert rows["beside", "H"]["covered"] is True  # 4.8 to 5.2 s holds 5 s
    assert rows["free", "H"]["error"] == pytest.approx(2 / 2.5 - 1)
    assert rows["free", "H"]["covered"] is False
    assert rows["beside", "R"]["error"] == pytest.approx(10 / (10 * math.exp(0.125)) - 1)
    assert rows["beside", "R"]["covered"] is None


def errors(*rows: tuple[float, str, float, bool | None]) -> pl.DataFrame:
    return pl.DataFrame(
        rows, schema={"s": pl.Float64, "kind": pl.String, "error": pl.Float64, "covered": pl.Boolean}, orient="row"
    )


def test_bias_spread_and_coverage_by_hand() -> None:
    found = truth_figures(
        errors(
            (1.0, "beside", 0.3, True),
            (1.8, "beside", -0.1, False),
            (3.0, "beside", -0.5, None),
            (1.0, "free", 0.2, None),
        )
    )
    assert found["beside"] == {
        "bias": pytest.approx(-0.1),
        "rmse": pytest.approx(math.sqrt((0.09 + 0.01 + 0.25) / 3)),
        "coverage95": 0.5,
        "n": 3,
    }
    assert found["beside_strong"] == {
        "bias": pytest.approx(-0.3),
        "rmse": pytest.approx(math.sqrt(0.26 / 2)),
        "coverage95": 0.0,
        "n": 2,
    }
    assert found["free"] == {"bias": pytest.approx(0.2), "rmse": pytest.approx(0.2), "coverage95": None, "n": 1}
    assert found["free_strong"] == {"bias": None, "rmse": None, "coverage95": None, "n": 0}


def test_a_truth_of_other_tasks_is_an_error() -> None:
    strange = TRUTH.with_columns(task=pl.lit("strange"))
    with pytest.raises(HrclogError, match=r"knows none of the pairs .*'H', 'R'.* expected the truth.json"):
        pair_errors(fit(pair("H", "a", "R", "b") | {"synergy": 1.0}, pair("R", "b", "H", "a")), durations(), strange)


def test_runs_of_one_agent_have_no_pairs_and_no_error() -> None:
    observations = observe(frame([row("H", "a", 0, S), row("H", "a", 2 * S, 3 * S)]))
    found = pair_errors(aft(observations), observations, TRUTH)
    assert found.is_empty()
    assert truth_figures(found)["beside"]["n"] == 0


def test_a_factor_of_a_task_without_its_work_is_an_error() -> None:
    with pytest.raises(HrclogError, match="'b' by 'R' without its work"):
        true_pairs([("H", "a", 0.0, 0.1)], [("R", "b", "H", "a", 1.0)])


def test_tasks_and_pairs_that_nobody_has_seen_are_left_out() -> None:
    found = true_pairs(
        [("H", "a", 0.0, 0.0), ("R", "b", None, None)],
        [("H", "a", "R", "b", 2.0), ("R", "b", "H", "a", 1.5), ("H", "a", "R", "c", None)],
    )
    assert found.rows() == [("H", "a", "R", "b", 2.0, 2.0)]


def test_on_simulated_runs_the_default_is_near_the_truth_and_the_mean_is_not() -> None:
    work = {"H": {"a": (1.5, 0.15), "b": (1.2, 0.15)}, "R": {"c": (1.6, 0.1), "d": (1.4, 0.1)}}
    factors = {("R", "c", "H", "a"): 2.5, ("R", "d", "H", "a"): 1.8, ("H", "b", "R", "d"): 1.2}
    keys = [(agent, task) for agent, tasks in work.items() for task in tasks]
    truth = true_pairs(
        [(agent, task, *work[agent][task]) for agent, task in keys],
        [(*key, *other, factors.get((*key, *other), 1.0)) for key in keys for other in keys if key[0] != other[0]],
    )
    observations = observe(simulated_frame(5, 60, work, factors))
    found = truth_figures(pair_errors(aft(observations), observations, truth))
    assert (found["beside"]["n"], found["beside_strong"]["n"]) == (8, 2)
    assert abs(found["beside"]["bias"]) < 0.03
    assert found["beside"]["rmse"] < 0.06
    assert found["beside"]["coverage95"] >= 6 / 8
    assert abs(found["free_strong"]["bias"]) < 0.08
    blind = truth_figures(pair_errors(mean(observations), observations, truth))
    assert blind["free_strong"]["bias"] == pytest.approx((1 / 2.5 + 1 / 1.8) / 2 - 1)
