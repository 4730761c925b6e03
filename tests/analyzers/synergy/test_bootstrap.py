"""The bootstrap over runs: seeded, independent of the workers, and of the size of the estimator's own errors."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from interval_frames import frame, random_runs, row
from polars.testing import assert_frame_equal
from simulated_frames import Key, simulated_frame

from hrclog.analyzers.projections.overlaps import PAIR
from hrclog.analyzers.projections.schemas import SYNERGIES
from hrclog.analyzers.synergy.bootstrap import bootstrap, drawn_runs, with_bootstrap
from hrclog.analyzers.synergy.estimators import ESTIMATORS
from hrclog.analyzers.synergy.observations import Observations, observe
from hrclog.errors import HrclogError

pytestmark = pytest.mark.slow

SECOND = 1_000_000_000
WORK = {"H": {"a": (1.5, 0.2), "b": (1.2, 0.2)}, "R": {"x": (1.5, 0.2), "y": (1.2, 0.2)}}
FACTORS: dict[Key, float] = {("H", "a", "R", "x"): 1.8, ("R", "y", "H", "b"): 0.7}
NUMBERS = ("synergy", "std_err", "ci_low", "ci_high")
FREE_NUMBERS = ("synergy_free", "free_std_err", "free_ci_low", "free_ci_high")


@pytest.fixture(scope="module")
def observations() -> Observations:
    """Return runs whose executions are independent of each other."""
    return observe(simulated_frame(1, 40, WORK, FACTORS))


def errors(table: pl.DataFrame, name: str) -> np.ndarray:
    return table[name].to_numpy()


@pytest.mark.parametrize("name", ["ols", "aft"])
def test_errors_of_independent_executions_are_those_of_the_estimator(name: str, observations: Observations) -> None:
    fit = ESTIMATORS[name].fit(observations, "none")
    table = with_bootstrap(fit, observations, ESTIMATORS[name], "none", 60, 0, 1).synergies
    pairs = (("std_err", "synergy"), ("free_std_err", "synergy_free")) if name == "aft" else (("std_err", "synergy"),)
    for error, value in pairs:
        ratio = errors(table, error) / errors(fit.synergies, error)
        assert 0.75 < np.exp(np.log(ratio).mean()) < 1.33
        assert (ratio > 0.5).all()
        assert (ratio < 2.0).all()
        assert_frame_equal(table.select(value), fit.synergies.select(value), check_exact=True)
        low, high = ("ci_low", "ci_high") if value == "synergy" else ("free_ci_low", "free_ci_high")
        assert (table[low] < table[value]).all()
        assert (table[value] < table[high]).all()


def test_executions_that_run_together_widen_the_errors() -> None:
    # each run is there six times over: the estimator believes in six times as much, the bootstrap does not
    found = random_runs(1, n_runs=15, tasks=2)
    copies = []
    for copy in range(6):
        for one in found:
            shift = copy * 10**12
            moved = {name: one[name] + shift for name in ("start_ns", "end_ns", "until_ns")}
            copies.append(one | moved | {"execution_id": f"{copy}-{one['execution_id']}"})
    once, often = observe(frame(found)), observe(frame(copies))
    own = [errors(ESTIMATORS["ols"].fit(one, "none").synergies, "std_err") for one in (once, often)]
    drawn = [
        errors(
            with_bootstrap(ESTIMATORS["ols"].fit(one, "none"), one, ESTIMATORS["ols"], "none", 60, 3, 1).synergies,
            "std_err",
        )
        for one in (once, often)
    ]
    assert (own[1] < 0.5 * own[0]).all()
    np.testing.assert_allclose(drawn[1], drawn[0], rtol=1e-6)


def test_the_seed_makes_the_draws_and_the_workers_do_not(observations: Observations) -> None:
    few = observations.only(observations.runs[:10])
    first = bootstrap(few, ESTIMATORS["ols"], "none", 45, 7)
    assert_frame_equal(first, bootstrap(few, ESTIMATORS["ols"], "none", 45, 7, workers=2), check_exact=True)
    assert first["replicate"].unique().sort().to_list() == list(range(45))
    assert first.columns == ["replicate", *PAIR, "synergy", "synergy_free"]
    other = bootstrap(few, ESTIMATORS["ols"], "none", 45, 8)
    assert first["synergy"].to_list() != other["synergy"].to_list()
    # more draws are the same ones, and further ones
    assert_frame_equal(
        bootstrap(few, ESTIMATORS["ols"], "none", 30, 7), first.filter(pl.col("replicate") < 30), check_exact=True
    )


def test_two_workers_give_the_same_aft(observations: Observations) -> None:
    few = observations.only(observations.runs[:4])
    fit = ESTIMATORS["aft"].fit(few, "none")
    alone, together = (
        with_bootstrap(fit, few, ESTIMATORS["aft"], "none", 24, 1, workers).synergies for workers in (1, 2)
    )
    assert_frame_equal(alone, together, check_exact=True)


def test_progress_is_told(observations: Observations) -> None:
    told: list[int] = []
    few = observations.only(observations.runs[:3])
    with_bootstrap(ESTIMATORS["ols"].fit(few, "none"), few, ESTIMATORS["ols"], "none", 45, 1, 1, told.append)
    assert sum(told) == 45
    assert len(told) > 1


def test_a_draw_is_of_runs_with_repetition() -> None:
    runs = [f"run{number}" for number in range(50)]
    draws = [drawn_runs(runs, 3, number) for number in range(40)]
    assert all(len(draw) == 50 and set(draw) <= set(runs) for draw in draws)
    assert np.mean([len(set(draw)) for draw in draws]) == pytest.approx(50 * (1 - (1 - 1 / 50) ** 50), rel=0.05)
    assert len({tuple(draw) for draw in draws}) == 40
    assert drawn_runs(runs, 3, 5) == draws[5]


def test_a_replicate_is_the_estimate_from_the_runs_it_drew(observations: Observations) -> None:
    few = observations.only(observations.runs[:6])
    table = bootstrap(few, ESTIMATORS["aft"], "none", 3, 11)
    for number in range(3):
        drawn = few.drawn(drawn_runs(few.runs, 11, number))
        expected = ESTIMATORS["aft"].fit(drawn, "none").synergies.select(*PAIR, "synergy", "synergy_free")
        found = table.filter(pl.col("replicate") == number).drop("replicate")
        assert_frame_equal(found, expected, check_exact=True)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_what_has_no_number_gets_no_interval(name: str) -> None:
    # x is met in every run, y in one, z never
    found = []
    for run in range(6):
        start = 10**8 * run
        found += [
            row("H", "h", 0, (4 + run % 3) * SECOND, run_id=f"{run}", execution_id=f"h{run}"),
            row("R", "x", 2 * SECOND - start, 5 * SECOND + start, run_id=f"{run}", execution_id=f"x{run}"),
            row("R", "z", 50 * SECOND, 51 * SECOND, run_id=f"{run}", execution_id=f"z{run}"),
        ]
    found.append(row("R", "y", 0, SECOND, run_id="3", execution_id="y"))
    some = observe(frame(found))
    fit = ESTIMATORS[name].fit(some, "none")
    table = with_bootstrap(fit, some, ESTIMATORS[name], "none", 25, 1, 1).synergies
    assert table.schema == SYNERGIES
    assert_frame_equal(
        table.select(*PAIR, "synergy", "synergy_free", "n", "status"),
        fit.synergies.select(*PAIR, "synergy", "synergy_free", "n", "status"),
        check_exact=True,
    )
    assert any(one["synergy"] is not None for one in table.to_dicts())
    for one in table.to_dicts():
        for value, *others in (NUMBERS, FREE_NUMBERS):
            assert one[value] is not None or [one[other] for other in others] == [None] * 3
        if "z" in (one["task"], one["other_task"]):
            assert [one[other] for other in NUMBERS] == [None] * 4


def test_one_run_and_one_draw_are_errors(observations: Observations) -> None:
    one = observations.only(observations.runs[:1])
    with pytest.raises(HrclogError, match="found 1, expected at least 2; record more runs"):
        bootstrap(one, ESTIMATORS["ols"], "none", 10, 0)
    with pytest.raises(HrclogError, match="number of bootstrap draws is 1, expected at least 2"):
        bootstrap(observations, ESTIMATORS["ols"], "none", 1, 0)
    with pytest.raises(HrclogError, match="found 0, expected at least 2"):
        bootstrap(observations.only([]), ESTIMATORS["ols"], "none", 10, 0)
