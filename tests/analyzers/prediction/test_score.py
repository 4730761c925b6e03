"""Scores of predictions: figures by hand, intervals by runs, and the authors' runs."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import polars as pl
import pytest
from interval_frames import frame, random_runs

from hrclog.analyzers.prediction.held_out import FORECASTS, MAKESPANS
from hrclog.analyzers.prediction.score import Score, score
from hrclog.analyzers.prediction.settings import Predictions, cross_validate, predict_prequential, predict_static
from hrclog.cli.score_text import score_text
from hrclog.errors import HrclogError

FIGURES = {"mae_s", "rmse_s", "crps_s", "coverage90", "interval_score_s", "log_likelihood", "n"}

Forecast = tuple[str, str, str, float, float, float, float, float, float, float, float]


def forecast(run: str, agent: str = "H", estimator: str = "aft", **values: float) -> tuple[Any, ...]:
    numbers = {
        "observed": 3.0,
        "mean": 3.5,
        "median": 3.2,
        "low": 2.0,
        "high": 4.0,
        "crps": 0.4,
        "width": 2.0,
        "density": -1.0,
    }
    return (estimator, run, agent, "t", "e", *(numbers | values).values())


def predictions(
    rows: list[tuple[Any, ...]],
    setting: Any = "cv",  # noqa: ANN401 - any setting
    runs: list[str] | None = None,
    makespans: list[tuple[Any, ...]] | None = None,
) -> Predictions:
    return Predictions(
        setting,
        pl.DataFrame(rows, schema=FORECASTS, orient="row"),
        pl.DataFrame(makespans or [], schema=MAKESPANS, orient="row"),
        runs or sorted({row[1] for row in rows}),
        7,
        99,
        ("aft",),
    )


ROWS = [
    forecast("a", observed=3.0, mean=3.5, median=3.2, crps=0.4, width=2.0, density=-1.0),
    forecast("a", agent="R", observed=5.0, mean=3.0, median=3.0, crps=1.2, width=22.0, density=-4.0),
    forecast("b", observed=2.0, mean=2.0, median=2.5, crps=0.2, width=2.0, density=0.5),
]


def test_figures_are_means_over_executions() -> None:
    found = score(predictions(ROWS)).estimators["aft"]
    assert found["mae_s"] == pytest.approx((0.2 + 2.0 + 0.5) / 3)
    assert found["rmse_s"] == pytest.approx(math.sqrt((0.25 + 4.0 + 0.0) / 3))
    assert found["crps_s"] == pytest.approx(0.6)
    assert found["coverage90"] == pytest.approx(2 / 3)  # 2.0 lies on the end of its interval
    assert found["interval_score_s"] == pytest.approx(26 / 3)
    assert found["log_likelihood"] == pytest.approx(-1.5)
    assert (found["n"], found["calibrated"]) == (3, True)
    assert {agent: rows["n"] for agent, rows in found["agents"].items()} == {"H": 2, "R": 1}
    assert found["agents"]["R"]["mae_s"] == 2.0
    assert found["agents"]["H"]["crps_s"] == pytest.approx(0.3)


def test_makespans_have_their_own_errors() -> None:
    makespans = [("aft", "a", 10.0, 12.0), ("aft", "b", 10.0, 7.0), ("mean", "a", 1.0, 99.0)]
    found = score(predictions(ROWS, makespans=makespans)).estimators["aft"]
    assert (found["makespan_mae_s"], found["makespan_bias_s"], found["makespan_n"]) == (2.5, -0.5, 2)
    found = score(predictions(ROWS)).estimators["aft"]
    assert (found["makespan_mae_s"], found["makespan_bias_s"], found["makespan_n"]) == (None, None, 0)


def test_the_result_has_its_documented_parts() -> None:
    found = score(cross_validate(frame(random_runs(2, n_runs=5, tasks=1)), estimators=["aft", "mean"])).to_dict()
    assert list(found) == ["setting", "estimators", "comparisons", "n_train_runs", "n_test_runs", "n_executions"]
    assert (found["setting"], found["n_train_runs"], found["n_test_runs"]) == ("cv", 4, 5)
    assert list(found["estimators"]) == ["aft", "mean"]
    for figures in found["estimators"].values():
        more = {"crps_low_s", "crps_high_s", "makespan_mae_s", "makespan_bias_s", "makespan_n", "calibrated", "agents"}
        assert set(figures) == FIGURES | more
        assert all(set(agent) == FIGURES for agent in figures["agents"].values())
        assert figures["crps_low_s"] < figures["crps_s"] < figures["crps_high_s"]
    assert json.loads(json.dumps(found, allow_nan=False)) == found


def test_a_truth_is_in_the_result_only_if_there_is_one() -> None:
    found = score(predictions(ROWS))
    assert "truth" not in found.to_dict()
    known = Score("cv", {}, [], 1, 1, 1, {"aft": {"beside": {"n": 0}}})
    assert json.loads(known.to_json())["truth"] == {"aft": {"beside": {"n": 0}}}


def two(first: list[float], other: list[float]) -> Predictions:
    """Return predictions of two estimators, one execution a run, with these CRPS."""
    rows = [
        forecast(f"r{n:03}", estimator=name, crps=value)
        for name, values in (("aft", first), ("bayes", other))
        for n, value in enumerate(values)
    ]
    return predictions(rows)


def test_a_comparison_is_one_minus_the_ratio_with_an_interval_by_runs() -> None:
    source = np.random.default_rng(1)
    other = source.uniform(1, 3, 60)
    [found] = score(two((other * source.uniform(0.7, 0.9, 60)).tolist(), other.tolist())).comparisons
    assert (found["estimator"], found["other"]) == ("aft", "bayes")
    assert 0.15 < found["low"] < found["crps_reduction"] < found["high"] < 0.25
    [tie] = score(two(source.uniform(1, 3, 60).tolist(), other.tolist())).comparisons
    assert tie["low"] < 0 < tie["high"]
    [same] = score(two([1.0, 2.0], [1.0, 2.0])).comparisons
    assert (same["crps_reduction"], same["low"], same["high"]) == (0, 0, 0)


def test_draws_are_of_whole_runs() -> None:
    # the executions of a run err alike: single executions would give a much narrower interval
    rows = [forecast(f"r{n}", crps=1.0 + n % 2) for n in range(8) for _ in range(50)]
    found = score(predictions(rows)).estimators["aft"]
    assert found["crps_s"] == pytest.approx(1.5)
    assert found["crps_high_s"] - found["crps_low_s"] > 0.5


def test_runs_without_executions_do_not_shift_the_interval() -> None:
    rows = [forecast("a", crps=5.0), forecast("a", crps=7.0)]
    found = score(predictions(rows, runs=["a", "nothing", "nothing either"])).estimators["aft"]
    assert (found["crps_low_s"], found["crps_high_s"]) == (6.0, 6.0)


def test_a_single_run_has_no_interval() -> None:
    rows = [forecast("a"), forecast("a", estimator="mean")]
    found = score(predictions(rows))
    assert found.estimators["aft"]["crps_low_s"] is None
    assert found.comparisons[0]["low"] is None
    assert "n/a" in score_text(found)


def test_forecasts_without_error_can_be_compared() -> None:
    [found] = score(two([0.0, 0.0], [0.0, 0.0])).comparisons
    assert found["crps_reduction"] == 0
    [found] = score(two([0.0, 0.0], [1.0, 2.0])).comparisons
    assert found["crps_reduction"] == 1


def test_the_worst_five_runs_in_a_row_are_of_the_order_in_time() -> None:
    covered = [1, 1, 0, 0, 1, 1, 0, 1, 1, 1]
    rows = [forecast(f"r{n}", observed=3.0 if hit else 9.0) for n, hit in enumerate(covered)]
    runs = [f"r{n}" for n in range(10)]
    found = score(predictions(rows, "prequential", runs)).estimators["aft"]
    assert found["coverage90_worst_five_runs"] == pytest.approx(2 / 5)
    mixed = [f"r{n}" for n in (0, 2, 1, 3, 4, 6, 5, 7, 8, 9)]
    found = score(predictions(rows, "prequential", mixed)).estimators["aft"]
    assert found["coverage90_worst_five_runs"] == pytest.approx(2 / 5)
    worse = [f"r{n}" for n in (0, 2, 3, 6, 1, 4, 5, 7, 8, 9)]
    found = score(predictions(rows, "prequential", worse)).estimators["aft"]
    assert found["coverage90_worst_five_runs"] == pytest.approx(2 / 5)
    assert "coverage90_worst_five_runs" not in score(predictions(rows, "static", runs)).estimators["aft"]
    assert "coverage90_worst_five_runs" not in score(predictions(rows[:4], "prequential")).estimators["aft"]


@pytest.mark.slow
def test_results_are_the_same_every_time() -> None:
    intervals = frame(random_runs(2, n_runs=6, tasks=1))
    one, other = (
        score(cross_validate(intervals, seed=4, estimators=["aft", "ols", "mean"])).to_json() for _ in range(2)
    )
    assert one == other


def test_nothing_predicted_is_an_error() -> None:
    with pytest.raises(HrclogError, match="none of 99 successful executions could be predicted"):
        score(predictions([]))


def test_the_text_says_what_was_not_predicted_and_what_is_not_calibrated() -> None:
    text = score_text(score(predictions(ROWS, "static")))
    assert "Not calibrated" in text
    assert "96 executions are of tasks that no run to learn from had finished" in text
    assert "Not calibrated" not in score_text(score(predictions(ROWS)))


def compared(found: Score) -> dict[str, dict[str, Any]]:
    return {row["other"]: row for row in found.comparisons}


@pytest.mark.slow
def test_within_the_authors_offline_session_the_default_beats_the_published_way_and_covers(offline: Any) -> None:  # noqa: ANN401 - Runs, of a conftest that cannot be imported
    found = score(cross_validate(offline.intervals, estimators=["aft", "bayes", "mean"]))
    assert (found.n_test_runs, found.n_executions) == (51, 1224)
    assert compared(found)["bayes"]["crps_reduction"] > 0.15
    assert compared(found)["bayes"]["low"] > 0
    assert compared(found)["mean"]["low"] > 0
    assert 0.88 < found.estimators["aft"]["coverage90"] < 0.925
    assert found.estimators["aft"]["calibrated"]
    assert found.estimators["aft"]["crps_s"] < 0.77
    assert found.estimators["aft"]["makespan_mae_s"] < 2


@pytest.mark.slow
def test_from_the_authors_offline_session_to_the_online_one(offline: Any, online: Any) -> None:  # noqa: ANN401 - Runs, of a conftest that cannot be imported
    found = score(predict_prequential(offline.intervals, online.intervals, ["aft", "bayes"]))
    assert (found.n_train_runs, found.n_test_runs, found.n_executions) == (51, 200, 4800)
    figures = found.estimators["aft"]
    assert 0.87 < figures["coverage90"] < 0.95
    assert figures["crps_s"] < 0.70
    assert figures["calibrated"]
    assert figures["coverage90_worst_five_runs"] > 0.5
    assert compared(found)["bayes"]["low"] > 0
    once = score(predict_static(offline.intervals, online.intervals, ["aft"]))
    assert not once.estimators["aft"]["calibrated"]
    assert once.estimators["aft"]["crps_s"] > 1.3 * figures["crps_s"]
    assert "Not calibrated" in score_text(once)
