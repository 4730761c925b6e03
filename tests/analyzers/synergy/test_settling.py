"""What the first runs alone tell: nested, in order of time, and after all of them the analysis itself."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from interval_frames import frame, random_runs, row, rows, seconds
from run_frames import runs_of

from hrclog.analyzers.projections.durations import durations
from hrclog.analyzers.projections.mean_interval import mean_interval
from hrclog.analyzers.projections.overlaps import PAIR
from hrclog.analyzers.projections.schemas import SETTLING, SETTLING_DURATIONS, SYNERGIES
from hrclog.analyzers.synergy.estimators import ESTIMATORS
from hrclog.analyzers.synergy.observations import observe
from hrclog.analyzers.synergy.settling import MOST_STEPS, settle, settle_durations, steps

if TYPE_CHECKING:
    from conftest import Runs

NUMBERS = [name for name, kind in SYNERGIES.items() if kind == pl.Float64 and name != "overlap_s"]


def in_reverse(n_runs: int, **fields: int) -> pl.DataFrame:
    """Return runs of which the one with the largest id comes first."""
    executions = frame(random_runs(5, n_runs, **fields))
    names = executions["run_id"].unique().sort().to_list()
    hours = {name: (len(names) - number) * 3600 * 10**9 for number, name in enumerate(names)}
    shift = pl.col("run_id").replace_strict(hours, return_dtype=pl.Int64)
    return executions.with_columns(pl.col("start_ns", "end_ns", "until_ns") + shift)


def at(settling: pl.DataFrame, number: int) -> pl.DataFrame:
    return settling.filter(pl.col("runs") == number).drop("runs")


@given(st.integers(0, 5000), st.integers(2, 12))
def test_the_steps_rise_from_one_run_to_all(runs: int, most: int) -> None:
    found = steps(runs, most)
    assert found == sorted(set(found))
    assert len(found) <= most
    assert not found if runs == 0 else (found[0], found[-1]) == (1, runs)
    assert all(str(number).rstrip("0") in ("1", "2", "5") for number in found[:-1])


@pytest.mark.parametrize(
    ("runs", "numbers"),
    [
        (1, [1]),
        (2, [1, 2]),
        (6, [1, 2, 6]),  # 5 would be nearly all
        (51, [1, 2, 5, 10, 20, 51]),
        (200, [1, 2, 5, 10, 20, 50, 100, 200]),
        (1000, [1, 2, 10, 20, 50, 100, 500, 1000]),
    ],
)
def test_steps_are_one_two_five(runs: int, numbers: list[int]) -> None:
    assert steps(runs) == numbers


@pytest.mark.parametrize("estimator", ["aft", "ols", "paper"])
def test_the_last_step_is_the_analysis_and_the_others_are_that_of_their_runs_alone(estimator: str) -> None:
    executions = in_reverse(7)
    runs = runs_of(executions)
    settling = settle(executions, runs, estimator)
    assert settling.schema == SETTLING
    final = ESTIMATORS[estimator].fit(observe(executions), "none").synergies
    assert at(settling, 7).equals(final)
    for number in (1, 2, 5):
        first = runs["run_id"].head(number)
        assert first[0] == runs["run_id"].max(), "runs come in order of time"
        alone = ESTIMATORS[estimator].fit(observe(executions.filter(pl.col("run_id").is_in(first.to_list()))), "none")
        assert at(settling, number).join(alone.synergies, on=PAIR, how="semi").equals(alone.synergies)


def test_what_is_known_already_is_not_made_again() -> None:
    executions = in_reverse(4)
    runs, observations = runs_of(executions), observe(executions)
    final = ESTIMATORS["ols"].fit(observations, "none").synergies.with_columns(pl.lit(7.0).alias("synergy"))
    settling = settle(executions, runs, "ols", observations=observations, final=final)
    assert at(settling, 4).equals(final)
    assert at(settling, 2).equals(at(settle(executions, runs, "ols"), 2))


@pytest.mark.parametrize("estimator", ["aft", "ols"])
def test_the_order_of_rows_does_not_matter(estimator: str) -> None:
    executions = in_reverse(5)
    runs = runs_of(executions)
    shuffled = (executions.sample(fraction=1, shuffle=True, seed=3), runs.sample(fraction=1, shuffle=True, seed=4))
    assert settle(*shuffled, estimator).equals(settle(executions, runs, estimator))
    assert settle_durations(*shuffled).equals(settle_durations(executions, runs))


@given(rows(max_size=24, scale=10**9, runs="rstuv"))
@settings(max_examples=15)
def test_steps_hold_the_runs_before_them_and_what_was_not_seen_has_no_number(found: list[dict[str, object]]) -> None:
    executions = frame(found)
    runs = runs_of(executions)
    settling = settle(executions, runs, "ols")
    means = settle_durations(executions, runs)
    assert settling.group_by("runs").len()["len"].n_unique() <= 1
    learnt = settling.filter(pl.col("status") != "no_success")  # its n is of what was seen
    for counted, keys, frame_ in (("n", list(PAIR), learnt), ("count", ["agent", "task"], means)):
        grown = frame_.sort("runs").group_by(keys).agg(pl.col(counted).diff().min())[counted]
        assert (grown.drop_nulls() >= 0).all()
    unseen = settling.filter((pl.col("n") == 0) | (pl.col("status") == "unobserved"))
    assert unseen.select(pl.col(NUMBERS).is_null().all()).row(0) == (True,) * len(NUMBERS)
    numbers = means.select(pl.col("mean_s").is_null() == (pl.col("count") == 0)).to_series()
    assert numbers.all()


def test_mean_durations_end_as_those_of_the_analysis() -> None:
    executions = in_reverse(6)
    means = settle_durations(executions, runs_of(executions))
    assert means.schema == SETTLING_DURATIONS
    last = at(means, 6)
    expected = durations(executions)
    assert last.select("agent", "task", "count", "mean_s").equals(expected.select("agent", "task", "count", "mean_s"))


def test_the_interval_of_a_mean_is_students() -> None:
    from scipy.stats import t

    took = (3.0, 5.0, 4.5, 8.0)
    executions = frame(
        [one for number, s in enumerate(took) for one in seconds("H", (100.0 * number, s), run_id=f"r{number}")]
    )
    means = settle_durations(executions, runs_of(executions))
    for number in (2, 4):
        sample = np.array(took[:number])
        low, high = t.interval(0.95, number - 1, sample.mean(), sample.std(ddof=1) / np.sqrt(number))
        count, *found = at(means, number).select("count", "mean_s", "mean_low_s", "mean_high_s").row(0)
        assert count == number
        assert found == pytest.approx([sample.mean(), low, high])
        assert mean_interval(sample[::-1]) == pytest.approx((sample.mean(), low, high))
    assert at(means, 1).row(0) == ("H", "t0", 1, 3.0, None, None)


def test_one_run_is_one_step() -> None:
    executions = frame([*seconds("H", (0, 4), (5, 4)), *seconds("R", (1, 6))])
    settling = settle(executions, runs_of(executions), "aft")
    assert settling["runs"].unique().to_list() == [1]
    assert settle_durations(executions, runs_of(executions))["runs"].unique().to_list() == [1]


def test_without_runs_there_is_nothing() -> None:
    none = frame([])
    assert settle(none, runs_of(none), "aft").equals(SETTLING.to_frame())
    assert settle_durations(none, runs_of(none)).equals(SETTLING_DURATIONS.to_frame())


@pytest.mark.parametrize("estimator", list(ESTIMATORS))
def test_one_agent_alone_has_no_synergies_and_failures_teach_no_durations(estimator: str) -> None:
    alone = frame([one for run in "abc" for one in seconds("H", (0, 4), (5, 4), run_id=run)])
    assert settle(alone, runs_of(alone), estimator).is_empty()
    failed = frame(
        [
            row(agent, "x", 0, 10**9, run_id=run, outcome="failed", execution_id=run + agent)
            for run in "abc"
            for agent in "HR"
        ]
    )
    found = settle(failed, runs_of(failed), estimator)
    assert found["runs"].unique().sort().to_list() == [1, 2, 3]
    assert found.select(pl.col(NUMBERS).is_null().all()).row(0) == (True,) * len(NUMBERS)
    assert settle_durations(failed, runs_of(failed))["mean_s"].null_count() == 6


def test_runs_that_never_started_come_last() -> None:
    executions = in_reverse(3)
    idle = runs_of(executions).head(1).with_columns(
        pl.lit("0 idle").alias("run_id"), pl.lit(None, pl.Int64).alias("start_ns")
    )  # fmt: skip
    runs = pl.concat([idle, runs_of(executions)])
    means = settle_durations(executions, runs)
    assert means["runs"].unique().sort().to_list() == [1, 2, 4]
    first = runs_of(executions)["run_id"][0]
    expected = executions.filter((pl.col("run_id") == first) & (pl.col("outcome") == "succeeded"))
    assert at(means, 1)["count"].sum() == expected.height


@pytest.mark.slow
def test_a_thousand_runs_take_seconds() -> None:
    executions = frame(random_runs(1, 1000, per_agent=12, tasks=4))
    runs, observations = runs_of(executions), observe(executions)
    start = time.process_time()
    final = ESTIMATORS["aft"].fit(observations, "none").synergies
    once = time.process_time() - start
    start = time.process_time()
    settling = settle(executions, runs, "aft", observations=observations, final=final)
    settle_durations(executions, runs)
    assert time.process_time() - start < 8 * once + 4
    assert settling["runs"].n_unique() == MOST_STEPS


@pytest.mark.slow
def test_the_authors_runs_settle(offline: Runs) -> None:
    runs = runs_of(offline.intervals)
    settling = settle(offline.intervals, runs, "aft")
    assert settling["runs"].unique().sort().to_list() == [1, 2, 5, 10, 20, 51]
    known = settling.group_by("runs").agg(pl.col("synergy").count()).sort("runs")["synergy"]
    assert known.is_sorted()
    width = (pl.col("ci_high") / pl.col("ci_low")).log()
    early, last = (settling.filter(pl.col("runs") == number).select(width).to_series() for number in (5, 51))
    assert (last / early).median() < 0.6, "ten times as many runs, a third of the width if nothing else changed"
    means = settle_durations(offline.intervals, runs)
    half = means.with_columns((pl.col("mean_high_s") - pl.col("mean_s")).alias("half"))
    steps_ = half.group_by("runs").agg(pl.col("half").median()).sort("runs")
    assert steps_["half"][-1] < 0.5 * steps_["half"][2]
