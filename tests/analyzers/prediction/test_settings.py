"""The three settings: what is learnt from, what is predicted, and in which order."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import polars as pl
import pytest
from interval_frames import Row, frame, random_runs, row
from polars.testing import assert_frame_equal
from simulated_frames import simulated, simulated_frame

from hrclog.analyzers.prediction.held_out import FORECASTS, MAKESPANS
from hrclog.analyzers.prediction.score import score
from hrclog.analyzers.prediction.settings import (
    SCORED,
    Predictions,
    cross_validate,
    predict_prequential,
    predict_static,
)
from hrclog.analyzers.synergy.estimators import ESTIMATORS
from hrclog.errors import HrclogError

pytestmark = pytest.mark.slow

S = 1_000_000_000
DAY = 86_400 * S
WORK = {"H": {"a": (1.5, 0.15), "b": (1.0, 0.3)}, "R": {"c": (1.6, 0.1), "d": (1.2, 0.2)}}
FACTORS = {("R", "c", "H", "a"): 2.5, ("H", "b", "R", "d"): 1.6}
BOTH = ("aft", "mean")

Split = Callable[[pl.DataFrame, pl.DataFrame], Predictions]
Whole = Callable[[Split], Predictions]


def static(train: pl.DataFrame, test: pl.DataFrame) -> Predictions:
    return predict_static(train, test, BOTH)


def prequential(train: pl.DataFrame, test: pl.DataFrame) -> Predictions:
    return predict_prequential(train, test, BOTH)


def cv(train: pl.DataFrame, test: pl.DataFrame) -> Predictions:
    return cross_validate(pl.concat([train, test]), estimators=BOTH)


def days(seed: int, n_runs: int, name: str = "run", first: int = 0) -> pl.DataFrame:
    """Return simulated runs, one a day, in which agents work through six tasks each."""
    frames = simulated_frame(seed, n_runs, WORK, FACTORS, per_agent=6)
    shift = (pl.col("run_id").str.slice(3).cast(pl.Int64) + first) * DAY
    return frames.with_columns(
        *((pl.col(column) + shift).alias(column) for column in ("start_ns", "end_ns", "until_ns")),
        (name + pl.col("run_id").str.slice(3)).alias("run_id"),
    )


@pytest.fixture(scope="module")
def train() -> pl.DataFrame:
    return days(1, 15, "train")


@pytest.fixture(scope="module")
def test() -> pl.DataFrame:
    return days(2, 8, "test", 100)


@pytest.fixture(scope="module")
def whole(train: pl.DataFrame, test: pl.DataFrame) -> Whole:
    """Return what a split predicts of all these runs, made when it is first asked for."""
    return cache(lambda split: split(train, test))


def key(predictions: Predictions) -> list[tuple[str, ...]]:
    return predictions.executions.select("estimator", "run_id", "execution_id").rows()


@pytest.mark.parametrize("split", [static, prequential, cv])
def test_frames_keep_to_their_schemas_and_are_in_order(
    split: Split, whole: Whole, train: pl.DataFrame, test: pl.DataFrame
) -> None:
    found = whole(split)
    assert (found.executions.schema, found.makespans.schema) == (FORECASTS, MAKESPANS)
    assert found.setting == split.__name__ if split is not cv else found.setting == "cv"
    place = {run: number for number, run in enumerate(found.runs)}
    order = [(BOTH.index(name), place[run]) for name, run, _ in key(found)]
    assert order == sorted(order)
    of = pl.concat([train, test]) if split is cv else test
    starts = dict(of.group_by("run_id").agg(pl.col("start_ns").min()).iter_rows())
    assert found.runs == sorted(starts, key=starts.__getitem__)
    for _, part in found.executions.join(of, on=["run_id", "execution_id"], maintain_order="left").group_by(
        "estimator", "run_id"
    ):
        assert part["start_ns"].is_sorted()


@pytest.mark.parametrize("split", [static, prequential, cv])
def test_every_successful_execution_is_predicted_once_by_each_estimator(
    split: Split, whole: Whole, train: pl.DataFrame, test: pl.DataFrame
) -> None:
    found = whole(split)
    of = pl.concat([train, test]) if split is cv else test
    expected = [(name, *one) for name in BOTH for one in of.select("run_id", "execution_id").rows()]
    assert sorted(key(found)) == sorted(expected)
    assert found.n_executions == of.height
    assert sorted(found.makespans.select("estimator", "run_id").rows()) == sorted({one[:2] for one in expected})
    assert found.n_train_runs == (18 if split is cv else 15)


@pytest.mark.parametrize("split", [static, prequential, cv])
def test_the_order_of_rows_and_runs_changes_nothing(
    split: Split, whole: Whole, train: pl.DataFrame, test: pl.DataFrame
) -> None:
    expected = whole(split)
    mixed = split(*(part.sample(fraction=1.0, shuffle=True, seed=n) for n, part in enumerate((train, test))))
    assert_frame_equal(mixed.executions, expected.executions, check_exact=True)
    assert_frame_equal(mixed.makespans, expected.makespans, check_exact=True)


def test_names_of_runs_do_not_decide_their_order(whole: Whole, train: pl.DataFrame, test: pl.DataFrame) -> None:
    names = {name: f"test{9 - int(name[-1])}" for name in test["run_id"].unique()}
    renamed = test.with_columns(pl.col("run_id").replace(names))
    one, other = whole(prequential), prequential(train, renamed)
    assert other.runs == [names[run] for run in one.runs]
    assert_frame_equal(other.executions, one.executions.with_columns(pl.col("run_id").replace(names)), check_exact=True)


@pytest.mark.parametrize("kept", [1, 3, 7])
def test_earlier_predictions_know_nothing_of_later_runs(
    kept: int, whole: Whole, train: pl.DataFrame, test: pl.DataFrame
) -> None:
    every = whole(prequential)
    runs = every.runs[:kept]
    cut = prequential(train, test.filter(pl.col("run_id").is_in(runs)))
    for name in ("executions", "makespans"):
        expected = getattr(every, name).filter(pl.col("run_id").is_in(runs))
        assert_frame_equal(getattr(cut, name), expected, check_exact=True)


def test_a_run_is_predicted_before_it_is_learnt(whole: Whole, train: pl.DataFrame, test: pl.DataFrame) -> None:
    last = pl.col("run_id") == "test0007"
    longer = test.with_columns(
        (pl.col(name) + pl.when(last & (pl.col("agent") == "R")).then(3 * S).otherwise(0)).alias(name)
        for name in ("end_ns", "until_ns")
    )
    quantiles = ("execution_id", "median_s", "low_s", "high_s")
    one, other = (
        predictions.executions.filter(last & (pl.col("agent") == "R")).select(quantiles)
        for predictions in (whole(prequential), prequential(train, longer))
    )
    assert_frame_equal(one, other, rel_tol=1e-12)  # of R: what H sees of R is another timeline


def test_static_predictions_do_not_learn(whole: Whole, train: pl.DataFrame, test: pl.DataFrame) -> None:
    every = whole(static)
    for run in every.runs:
        alone = static(train, test.filter(run_id=run))
        assert_frame_equal(alone.executions, every.executions.filter(run_id=run), check_exact=True)
        assert_frame_equal(alone.makespans, every.makespans.filter(run_id=run), check_exact=True)


def test_prequential_predictions_do_learn(train: pl.DataFrame) -> None:
    slow = days(5, 30, "test", 100).with_columns(
        (pl.col("start_ns") + 3 * (pl.col(name) - pl.col("start_ns"))).alias(name) for name in ("end_ns", "until_ns")
    )
    slow = slow.filter(agent="H")
    once, learnt = (split(train, slow).executions.filter(estimator="aft") for split in (static, prequential))
    late = pl.col("run_id") > "test0005"
    assert learnt.filter(late)["crps_s"].mean() < 0.4 * once.filter(late)["crps_s"].mean()
    first = pl.col("run_id") == "test0000"
    assert learnt.filter(first)["median_s"].to_list() == pytest.approx(
        once.filter(first)["median_s"].to_list(), rel=0.05
    )


def test_folds_depend_on_the_seed_and_on_nothing_else(train: pl.DataFrame) -> None:
    one, same, other = (cross_validate(train, 5, seed, ["mean"]).executions for seed in (1, 1, 2))
    assert_frame_equal(one, same, check_exact=True)
    assert not one.equals(other)


def test_with_cv_a_run_is_predicted_without_itself() -> None:
    # without the slow run, nobody could expect it
    found = [row("H", "h", n * DAY, n * DAY + (100 if n == 3 else 1) * S, run_id=f"r{n}") for n in range(6)]
    rows = cross_validate(frame(found), 6, estimators=["mean"]).executions
    assert rows.filter(run_id="r3")["mean_s"].item() == pytest.approx(1.0)
    assert rows.filter(pl.col("run_id") != "r3")["mean_s"].min() > 1.5  # type: ignore[operator] - a number


def unhurried(gaps: list[int], first: int = 0) -> pl.DataFrame:
    """Return runs of two executions of a second, these many seconds apart."""
    return frame(
        [
            row("H", "h", (first + n) * DAY + start * S, (first + n) * DAY + (start + 1) * S, run_id=f"r{first + n:03}")
            for n, gap in enumerate(gaps)
            for start in (0, 1 + gap)
        ]
    )


def test_with_cv_gaps_are_those_of_the_other_runs() -> None:
    found = cross_validate(unhurried([2, 2, 50, 2]), 4, estimators=["mean"]).makespans
    assert found.filter(run_id="r002").row(0)[2:] == (52.0, pytest.approx(4.0))
    assert found.filter(run_id="r000")["predicted_s"].item() == pytest.approx(20.0)


def test_gaps_of_a_session_are_learnt() -> None:
    train, test = unhurried([2] * 5), unhurried([10] * 100, 10)
    found = predict_prequential(train, test, ["mean"]).makespans["predicted_s"]
    assert found[0] == pytest.approx(4.0)
    assert found[1] == pytest.approx(4.0 + 0.05 * 8)
    assert found[99] == pytest.approx(12.0, abs=0.1)
    assert predict_static(train, test, ["mean"]).makespans["predicted_s"].to_list() == pytest.approx([4.0] * 100)


def test_more_folds_than_runs_leave_one_run_out() -> None:
    intervals = frame(random_runs(1, n_runs=4))
    assert cross_validate(intervals, 50, estimators=["mean"]).n_train_runs == 3
    assert cross_validate(intervals, 2, estimators=["mean"]).n_train_runs == 2


@pytest.mark.parametrize("split", [static, prequential])
def test_a_run_on_both_sides_is_an_error(split: Split, train: pl.DataFrame) -> None:
    with pytest.raises(HrclogError, match=r"1 run is among both .* 'train0003'"):
        split(train, train.filter(run_id="train0003"))


@pytest.mark.parametrize("split", [static, prequential])
def test_an_empty_side_is_an_error(split: Split, train: pl.DataFrame) -> None:
    with pytest.raises(HrclogError, match="the training runs hold no executions"):
        split(train.clear(), train)
    with pytest.raises(HrclogError, match="the test runs hold no executions"):
        split(train, train.clear())


@pytest.mark.parametrize("n_runs", [0, 1])
def test_one_run_cannot_be_cross_validated(n_runs: int) -> None:
    with pytest.raises(HrclogError, match=rf"found {n_runs} runs? and"):
        cross_validate(frame(random_runs(1, n_runs=n_runs)))


@pytest.mark.parametrize("deviation", [-0.1, math.nan, math.inf, 1e3])
def test_a_transfer_deviation_out_of_range_is_an_error(
    deviation: float, train: pl.DataFrame, test: pl.DataFrame
) -> None:
    with pytest.raises(HrclogError, match="transfer deviation: found"):
        predict_static(train, test, BOTH, transfer_deviation=deviation)


def test_a_transfer_deviation_widens(train: pl.DataFrame, test: pl.DataFrame) -> None:
    widths = [
        predict_static(train, test, BOTH, transfer_deviation=deviation)
        .executions.group_by("estimator", maintain_order=True)
        .agg((pl.col("high_s").log() - pl.col("low_s").log()).mean())["high_s"]
        for deviation in (0.0, 0.3, 1.0)
    ]
    assert (widths[0] < widths[1]).all()
    assert (widths[1] < widths[2]).all()


def test_what_is_calibrated_is_said(whole: Whole) -> None:
    assert [whole(split).calibrated for split in (static, prequential, cv)] == [(), BOTH, ("aft",)]


def test_tasks_that_were_never_learnt_are_counted_and_not_predicted(train: pl.DataFrame, test: pl.DataFrame) -> None:
    new = pl.when((pl.col("run_id") == "test0002") & (pl.col("task") == "a")).then(pl.lit("new")).otherwise("task")
    changed = test.with_columns(task=new)
    count = changed.filter(task="new").height
    assert count
    for split in (static, prequential):
        found = split(train, changed)
        assert found.n_executions == test.height
        assert found.executions.height == len(BOTH) * (test.height - count)
        assert "new" not in found.executions["task"]
        assert "test0002" not in found.makespans["run_id"]
        assert found.makespans.height == len(BOTH) * 7


def test_a_single_training_run_is_enough(train: pl.DataFrame, test: pl.DataFrame) -> None:
    one = train.filter(run_id="train0000")
    for split in (static, prequential):
        assert split(one, test).n_train_runs == 1
        assert split(one[:1], test).executions["task"].unique().to_list() == [one["task"][0]]


def test_where_everything_failed_there_is_nothing_to_score(train: pl.DataFrame, test: pl.DataFrame) -> None:
    failed = [part.with_columns(outcome=pl.lit("failed")) for part in (train, test)]
    for found in (static(failed[0], test), prequential(failed[0], test), prequential(train, failed[1]), cv(*failed)):
        assert found.executions.is_empty()
        with pytest.raises(HrclogError, match="successful executions could be predicted"):
            score(found)


@pytest.mark.parametrize(("agents", "itself"), [("H", True), ("HR", False), ("HR", True), ("HRS", True)])
def test_any_number_of_agents_may_work_and_overlap_themselves(agents: str, itself: bool) -> None:
    runs = frame(random_runs(3, n_runs=4, per_agent=4, agents=agents, tasks=2, overlap_itself=agents if itself else ""))
    first = pl.col("run_id") < "run002"
    for found in (
        cross_validate(runs, 2),
        predict_static(runs.filter(first), runs.filter(~first)),
        predict_prequential(runs.filter(first), runs.filter(~first)),
    ):
        assert list(dict.fromkeys(found.executions["estimator"])) == list(SCORED)
        assert found.executions.select(pl.col(pl.Float64).is_finite().all()).row(0) == (True,) * 8
        assert found.makespans.select(pl.col(pl.Float64).is_finite().all()).row(0) == (True, True)
        score(found).to_json()


def hostile(kind: str) -> list[Row]:
    source = {"same": [3 * S], "nanosecond": [1], "wild": [1, 10**3, 10**9, 10**15]}[kind]
    found = []
    for number in range(10):
        now = number * 10**17 if kind == "wild" else number * DAY
        for agent in ("H", "机器人 ☃"):
            start = now
            for k in range(4):
                length = source[(number * 7 + k * 3 + len(agent)) % len(source)]
                name = f"{number}{agent}{k}"
                found.append(
                    row(agent, f"tâche {k % 2}", start, start + length, run_id=f"r{number}", execution_id=name)
                )
                start += length + (0 if k % 2 else S)
    extra = [
        row("H", "home", 5, 9, run_id="only home", role="auxiliary"),
        row("H", "tâche 0", 5, 5, run_id="nothing"),
        row("H", "tâche 0", 7, 7 + 3 * S, run_id="alone"),
        row("H", "tâche 1", DAY + 7, None, until_ns=DAY + 8, run_id="r1", outcome="unknown", execution_id="open"),
        row("H", "tâche 1", DAY + 9, None, until_ns=DAY + 9, run_id="r1", outcome="unknown", execution_id="open too"),
    ]
    return [*found, *extra]


@pytest.mark.parametrize("kind", ["same", "nanosecond", "wild"])
def test_hostile_runs_give_finite_numbers(kind: str) -> None:
    intervals = frame(hostile(kind))
    some = pl.col("run_id").is_in([f"r{n}" for n in range(5)])
    train, test = intervals.filter(some), intervals.filter(~some)
    for found in (cross_validate(intervals), predict_static(train, test), predict_prequential(train, test)):
        assert found.executions.select(pl.col(pl.Float64).is_finite().all()).row(0) == (True,) * 8
        assert "only home" in found.runs
        assert score(found).n_test_runs == len(found.runs)


def test_factors_of_a_thousand_are_no_trouble() -> None:
    work = {"H": {"a": (0.5, 0.1)}, "R": {"c": (-3.0, 0.1), "d": (0.0, 0.1)}}
    runs = simulated(1, 12, work, {("R", "c", "H", "a"): 1e3, ("R", "d", "H", "a"): 1e-3}, per_agent=5, idle_s=0.5)
    found = cross_validate(frame(runs), estimators=["aft", "bayes", "ols", "paper"])
    assert found.executions.select(pl.col(pl.Float64).is_finite().all()).row(0) == (True,) * 8
    assert score(found).estimators["aft"]["n"] == found.n_executions


def test_progress_is_told_once_per_step(train: pl.DataFrame, test: pl.DataFrame) -> None:
    steps: list[int] = []
    cross_validate(train, 3, 0, BOTH, on_step=lambda: steps.append(1))
    assert len(steps) == 6
    predict_prequential(train, test, BOTH, on_step=lambda: steps.append(1))
    predict_static(train, test, BOTH, on_step=lambda: steps.append(1))
    assert len(steps) == 10


def test_all_estimators_and_the_mean_are_scored_the_default_first() -> None:
    assert list(SCORED) == [*ESTIMATORS, "mean"]
    assert next(iter(SCORED)) == "aft"
