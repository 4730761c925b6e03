"""Least squares against numpy's, and what it says of designs that do not identify everything."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from hrclog.analyzers.synergy import least_squares as module
from hrclog.analyzers.synergy.least_squares import fit
from hrclog.arrays import FloatArray


def problem(seed: int, n: int = 30, p: int = 4) -> tuple[FloatArray, FloatArray]:
    source = np.random.default_rng(seed)
    x = source.gamma(2.0, 1.0, (n, p)) * (source.random((n, p)) < 0.7)
    return x, x @ source.uniform(0.5, 2.0, p) + source.normal(0, 0.3, n)


@pytest.mark.parametrize("seed", range(5))
def test_coefficients_and_standard_errors_are_those_of_the_textbook(seed: int) -> None:
    x, y = problem(seed)
    found = fit(x, y)
    expected, residual, *_ = np.linalg.lstsq(x, y)
    errors = np.sqrt(residual[0] / (30 - 4) * np.diag(np.linalg.inv(x.T @ x)))
    np.testing.assert_allclose(found.coefficients, expected, rtol=1e-9)
    np.testing.assert_allclose(found.std_errors, errors, rtol=1e-9)
    np.testing.assert_allclose(found.high - found.coefficients, stats.t.ppf(0.975, 26) * found.std_errors, rtol=1e-9)
    np.testing.assert_allclose(found.coefficients - found.low, found.high - found.coefficients, rtol=1e-9)
    assert found.identified.all()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("unit", [1e-9, 1e6])
def test_a_column_in_other_units_changes_its_own_coefficient_only(seed: int, unit: float) -> None:
    x, y = problem(seed)
    scale = np.array([1.0, unit, 1.0, 1.0])
    found, scaled = fit(x, y), fit(x * scale, y)
    np.testing.assert_allclose(scaled.coefficients * scale, found.coefficients, rtol=1e-9)
    np.testing.assert_allclose(scaled.std_errors * scale, found.std_errors, rtol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_the_quick_way_and_the_careful_way_agree(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    x, y = problem(seed)
    quick = fit(x, y)
    monkeypatch.setattr(module, "_by_qr", lambda *_: None)
    careful = fit(x, y)
    for name in ("coefficients", "std_errors", "low", "high"):
        np.testing.assert_allclose(getattr(quick, name), getattr(careful, name), rtol=1e-9)


def test_only_the_coefficients_that_share_a_blind_direction_are_not_identified() -> None:
    x, y = problem(1)
    x[:, 2] = 3 * x[:, 0]
    found = fit(x, y)
    assert found.identified.tolist() == [False, True, False, True]
    for values in (found.coefficients, found.std_errors, found.low, found.high):
        assert np.isnan(values).tolist() == [True, False, True, False]
    alone = fit(x[:, [0, 1, 3]], y)
    np.testing.assert_allclose(found.coefficients[[1, 3]], alone.coefficients[1:], rtol=1e-9)
    np.testing.assert_allclose(found.std_errors[[1, 3]], alone.std_errors[1:], rtol=1e-9)


def test_nearly_collinear_columns_are_not_identified_either() -> None:
    x, y = problem(2)
    x[:, 2] = x[:, 0] * (1 + 1e-13 * np.arange(30))
    assert fit(x, y).identified.tolist() == [False, True, False, True]


def test_one_row_and_one_column_have_a_coefficient_and_no_error() -> None:
    found = fit(np.array([[2.0]]), np.array([3.0]))
    assert found.coefficients.tolist() == [1.5]
    assert np.isnan([found.std_errors[0], found.low[0], found.high[0]]).all()


def test_fewer_rows_than_columns_identify_only_what_stands_alone() -> None:
    found = fit(np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 2.0]]), np.array([1.0, 3.0]))
    assert found.identified.tolist() == [False, False, True]
    assert found.coefficients[2] == pytest.approx(1.5)


def test_a_perfect_fit_has_no_error() -> None:
    x, _ = problem(3)
    found = fit(x, x @ np.array([1.0, 2.0, 3.0, 4.0]))
    np.testing.assert_allclose(found.coefficients, [1.0, 2.0, 3.0, 4.0], rtol=1e-9)
    assert (found.std_errors < 1e-9).all()
