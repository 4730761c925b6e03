"""`ols` and `paper` against dense least squares on matrices built by plain loops."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import polars as pl
import pytest
from hypothesis import assume, given, settings
from interval_frames import Row, frame, random_runs, row, rows
from polars.testing import assert_frame_equal

from hrclog.analyzers.projections.schemas import SYNERGIES
from hrclog.analyzers.synergy.estimators import ESTIMATORS
from hrclog.analyzers.synergy.observations import observe
from hrclog.analyzers.synergy.outlier_methods import Outliers
from hrclog.analyzers.synergy.regression import Regression as Matrices
from hrclog.analyzers.synergy.regression import concurrent_shares, own_shares

if TYPE_CHECKING:
    from conftest import Runs

SECOND = 1_000_000_000

Key = tuple[str, str, str, str]
Regression = tuple[list[Key], np.ndarray, np.ndarray]

both = pytest.mark.parametrize("name", ["ols", "paper"])


def estimated(name: str, intervals: pl.DataFrame, outliers: Outliers = "none") -> pl.DataFrame:
    return ESTIMATORS[name].fit(observe(intervals), outliers).synergies


def union_length(spans: list[tuple[int, int]]) -> int:
    total, reach = 0, -(10**30)
    for start, end in sorted(spans):
        total += max(0, end - max(start, reach))
        reach = max(reach, end)
    return total


def naive(found: list[Row], name: str) -> Iterator[Regression]:
    """Yield (rows of the synergy table, X, y) of each regression, straight from the formulas."""
    counting = [
        one
        for one in found
        if one["until_ns"] > one["start_ns"] and one["role"] == "primary" and not one["parent_execution_id"]
    ]
    good = [one for one in counting if one["outcome"] == "succeeded" and one["end_ns"] is not None]
    tasks = sorted({(one["agent"], one["task"]) for one in good})
    length = {one["execution_id"]: (one["until_ns"] - one["start_ns"]) / 1e9 for one in counting}
    mean = {
        key: np.mean([length[one["execution_id"]] for one in good if (one["agent"], one["task"]) == key])
        for key in tasks
    }
    for agent, task in sorted({(one["agent"], one["task"]) for one in counting}):
        for other in sorted({key[0] for key in tasks} - {agent}):
            matrix, left = [], []
            names = [key[1] for key in tasks if key[0] == other]
            for k in [one for one in counting if (one["agent"], one["task"]) == (agent, task)]:
                shares, met, total = dict.fromkeys(names, 0.0), [], 0.0
                for c in [one for one in good if one["agent"] == other and one["run_id"] == k["run_id"]]:
                    low, high = max(k["start_ns"], c["start_ns"]), min(k["until_ns"], c["end_ns"])
                    if high > low:
                        overlap = (high - low) / 1e9
                        met.append((low, high))
                        total += overlap
                        divisor = length[c["execution_id"]] if name == "ols" else length[k["execution_id"]]
                        shares[c["task"]] += overlap / divisor * mean[other, c["task"]]
                if met:
                    matrix.append([shares[one] for one in names])
                    left.append(total if name == "ols" else union_length(met) / 1e9)
            if matrix:
                x = np.array(matrix)
                seen = x.any(axis=0)
                keys = [(other, one, agent, task) for one, used in zip(names, seen, strict=True) if used]
                yield keys, x[:, seen], np.array(left)


def by_key(table: pl.DataFrame) -> dict[Key, Row]:
    assert table.schema == SYNERGIES
    found = {(one["agent"], one["task"], one["other_agent"], one["other_task"]): one for one in table.to_dicts()}
    assert len(found) == table.height
    return found


def agrees(found: list[Row], name: str, rtol: float = 1e-9) -> int:
    """Assert that an estimator equals the naive regressions; return how many coefficients were compared."""
    table, compared, expected_keys = by_key(estimated(name, frame(found))), 0, set()
    for keys, x, y in naive(found, name):
        expected_keys |= set(keys)
        n, p = x.shape
        unit = x / np.linalg.norm(x, axis=0)
        rank = np.linalg.matrix_rank(unit, tol=1e-9)
        coefficients = np.linalg.lstsq(x, y)[0]
        residual = y - x @ coefficients
        for column, key in enumerate(keys):
            ours = table[key]
            if p > 1 and np.linalg.matrix_rank(np.delete(unit, column, axis=1), tol=1e-9) == rank:
                assert (ours["status"], ours["synergy"], ours["std_err"]) == ("weakly_identified", None, None)
                continue
            assert ours["status"] == ("sparse" if ours["n"] < 5 else "ok")
            if rank < p or np.linalg.cond(unit) > 1e4:
                continue  # lstsq itself is no reference there
            assert ours["synergy"] == pytest.approx(coefficients[column], rel=rtol)
            compared += 1
            if n > p:
                error = np.sqrt(residual @ residual / (n - p) * np.linalg.inv(x.T @ x)[column, column])
                assert ours["std_err"] == pytest.approx(error, rel=rtol * 10, abs=1e-12)
                assert ours["ci_low"] <= ours["synergy"] <= ours["ci_high"]
            else:
                assert (ours["std_err"], ours["ci_low"], ours["ci_high"]) == (None, None, None)
    for key, ours in table.items():
        if key not in expected_keys:
            assert (ours["status"], ours["synergy"]) == ("no_success" if ours["n"] else "unobserved", None)
            assert (ours["n"] == 0) == (ours["overlap_s"] == 0.0)
            assert (ours["std_err"], ours["ci_low"], ours["ci_high"]) == (None, None, None)
    return compared


@both
@pytest.mark.parametrize(("agents", "overlap_itself"), [("HR", ""), ("HRS", ""), ("HR", "R"), ("HRS", "HS")])
def test_random_runs_agree_with_dense_least_squares(name: str, agents: str, overlap_itself: str) -> None:
    found = random_runs(7, n_runs=15, agents=agents, overlap_itself=overlap_itself)
    assert agrees(found, name) > 20


@both
def test_the_real_runs_agree_with_dense_least_squares(name: str, offline: Runs) -> None:
    assert agrees(offline.intervals.to_dicts(), name) == 32


@pytest.mark.slow
@both
@settings(max_examples=60)
@given(found=rows(max_size=12, scale=SECOND))
def test_any_few_executions_agree_with_dense_least_squares(name: str, found: list[Row]) -> None:
    agrees(found, name)


@both
def test_published_counters_are_n_exactly(name: str, offline: Runs, data_dir: Path) -> None:
    published = json.loads((data_dir / "safety_areas" / "task_synergies.json").read_text())
    counters = {
        (one["agent"], one["agent_skill"], one["concurrent_agent"], one["concurrent_skill"]): one["counter"]
        for one in published
    }
    found = {key: one["n"] for key, one in by_key(estimated(name, offline.intervals)).items() if one["n"]}
    assert found == counters


@both
def test_every_ordered_pair_of_tasks_of_different_agents_is_one_row(name: str) -> None:
    found = random_runs(2, n_runs=3, per_agent=3, agents="HRS")
    tasks = {(one["agent"], one["task"]) for one in found}
    expected = sorted(one + other for one in tasks for other in tasks if one[0] != other[0])
    assert list(by_key(estimated(name, frame(found)))) == expected


@both
def test_executions_that_did_not_succeed_are_company_and_no_more(name: str) -> None:
    found = random_runs(4)
    assert any(one["agent"] == "R" and one["outcome"] == "failed" for one in found)
    of_r = [one for one in found if one["agent"] == "H" or one["outcome"] == "succeeded"]
    tables = [estimated(name, frame(rows_)).filter(agent="R") for rows_ in (found, of_r)]
    assert_frame_equal(*tables, check_exact=True)


@both
def test_a_single_pair_has_a_coefficient_without_an_error(name: str) -> None:
    found = [row("H", "h", 0, 10 * SECOND), row("R", "r", 5 * SECOND, 15 * SECOND)]
    one = by_key(estimated(name, frame(found)))["R", "r", "H", "h"]
    assert (one["n"], one["status"], one["std_err"], one["overlap_s"]) == (1, "sparse", None, 5.0)
    assert one["synergy"] == pytest.approx(1.0)


@both
def test_designs_that_cannot_tell_two_tasks_apart_say_so(name: str) -> None:
    found = []
    for run in range(6):  # r1 and r2 always come together, in equal shares
        found += [row("H", "h", 0, 8 * SECOND, run_id=f"{run}"), row("R", "r1", 0, 4 * SECOND, run_id=f"{run}")]
        found.append(row("R", "r2", 4 * SECOND, 8 * SECOND, run_id=f"{run}"))
    table = by_key(estimated(name, frame(found)))
    for task in ("r1", "r2"):
        one = table["R", task, "H", "h"]
        assert (one["status"], one["n"], one["synergy"], one["std_err"]) == ("weakly_identified", 6, None, None)


def test_the_left_side_of_the_paper_is_a_union_and_that_of_ols_a_sum() -> None:
    # R does r1 in 0..6 and again in 2..8, both within h
    found = [row("H", "h", 0, 10 * SECOND), row("R", "r", 0, 6 * SECOND), row("R", "r", 2 * SECOND, 8 * SECOND)]
    # ols: y = 12, X = 6 (1 + 1); paper: y = 8, X = 6 (0.6 + 0.6)
    assert by_key(estimated("ols", frame(found)))["R", "r", "H", "h"]["synergy"] == pytest.approx(12 / 12)
    assert by_key(estimated("paper", frame(found)))["R", "r", "H", "h"]["synergy"] == pytest.approx(8 / 7.2)


@pytest.mark.slow
@both
def test_the_isolation_forest_gives_the_same_answer_each_time_and_another_than_none(name: str) -> None:
    found = frame(random_runs(8, n_runs=10, tasks=2))
    first = estimated(name, found, "isolation-forest")
    assert_frame_equal(first, estimated(name, found, "isolation-forest"), check_exact=True)
    none = estimated(name, found)
    assert first["n"].to_list() == none["n"].to_list()
    assert first["synergy"].to_list() != none["synergy"].to_list()


@both
@pytest.mark.parametrize("outliers", ["none", "isolation-forest"])
def test_one_agent_alone_or_none_has_no_synergies(name: str, outliers: str) -> None:
    for found in (random_runs(1, agents="H"), []):
        table = estimated(name, frame(found), outliers)
        assert (table.height, table.schema) == (0, SYNERGIES)


def test_synergy_free_is_not_known_to_a_regression() -> None:
    assert (
        estimated("ols", frame(random_runs(1)))["synergy_free"].null_count()
        == estimated("ols", frame(random_runs(1))).height
    )


@settings(max_examples=30)
@given(rows(max_size=10, scale=SECOND))
def test_the_order_of_the_executions_does_not_matter(found: list[Row]) -> None:
    assume(found)
    assert_frame_equal(estimated("ols", frame(found)), estimated("ols", frame(found[::-1])), check_exact=True)


@pytest.mark.slow
@both
def test_hundreds_of_tasks_take_seconds(name: str) -> None:
    found = frame(random_runs(1, n_runs=40, per_agent=250, tasks=250))
    assert estimated(name, found).height == 2 * 250 * 250


@pytest.mark.slow
@pytest.mark.parametrize("shares", [concurrent_shares, own_shares])
def test_a_task_that_only_outliers_met_has_no_column(shares: Callable[..., Iterator[Matrices]]) -> None:
    observations = observe(frame(random_runs(8, n_runs=6, tasks=6)))
    every, kept = list(shares(observations, "none")), list(shares(observations, "isolation-forest"))
    assert sum(len(one.keys) for one in kept) < sum(len(one.keys) for one in every)
    for one in every + kept:
        assert one.x.shape == (len(one.y), len(one.keys))
        assert one.x.any(axis=0).all()
