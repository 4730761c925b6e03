"""Folds of runs."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hrclog.analyzers.prediction.folds import folds


@given(st.sets(st.text(max_size=3), max_size=30), st.integers(1, 8), st.integers(0, 5))
def test_every_run_is_in_one_fold_and_folds_are_of_nearly_equal_size(runs: set[str], count: int, seed: int) -> None:
    parts = folds(runs, count, seed)
    assert sorted(run for part in parts for run in part) == sorted(runs)
    assert len(parts) == min(count, len(runs))
    sizes = [len(part) for part in parts]
    assert not sizes or max(sizes) - min(sizes) <= 1


def test_the_order_of_runs_does_not_matter_and_the_seed_does() -> None:
    runs = [f"run{n}" for n in range(20)]
    assert folds(runs, 5, 3) == folds(reversed(runs), 5, 3)
    assert folds(runs, 5, 3) != folds(runs, 5, 4)


@pytest.mark.parametrize("count", [2, 5, 30])
def test_a_fold_is_dealt_by_chance_and_not_by_order(count: int) -> None:
    runs = [f"run{n:02}" for n in range(40)]
    together = [
        part == sorted(part) and int(part[-1][3:]) - int(part[0][3:]) < len(part) for part in folds(runs, count, 0)
    ]
    assert not any(size for size, part in zip(together, folds(runs, count, 0), strict=True) if len(part) > 2)
