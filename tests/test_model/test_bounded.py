"""Our bounded least squares against scipy's, on random problems."""

import numpy as np
import pytest
from scipy.optimize import least_squares, lsq_linear, nnls

from model.tuning_problem import descend_within, solve_within


@pytest.mark.parametrize("seed", range(40))
def test_linear_problems_have_scipys_solution(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n_rows, n = int(rng.integers(5, 12)), int(rng.integers(1, 6))
    matrix = rng.normal(size=(n_rows, n)) * 10.0 ** rng.uniform(-4, 4, n)
    right = rng.normal(size=n_rows)
    size = 1 / np.linalg.norm(matrix, axis=0)
    lower, upper = -size * rng.uniform(0, 1, n), size * rng.uniform(0, 1, n)
    ours = solve_within(matrix, right, lower, upper)
    theirs = lsq_linear(matrix, right, (lower, upper), method="bvls", tol=1e-14).x
    assert np.all(ours >= lower * (1 + 1e-12))
    assert np.all(ours <= upper * (1 + 1e-12))
    np.testing.assert_allclose(ours / size, theirs / size, atol=1e-9)


@pytest.mark.parametrize("seed", range(40))
def test_one_sided_bounds_are_those_of_nnls(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    matrix, right = rng.normal(size=(9, 4)), rng.normal(size=9)
    np.testing.assert_allclose(
        solve_within(matrix, right, 0.0, np.inf), nnls(matrix, right)[0], atol=1e-12
    )


def test_without_bounds_in_reach_it_is_plain_least_squares() -> None:
    rng = np.random.default_rng(5)
    matrix, right = rng.normal(size=(9, 4)), rng.normal(size=9)
    np.testing.assert_allclose(
        solve_within(matrix, right, -np.inf, np.inf), np.linalg.lstsq(matrix, right)[0], rtol=1e-12
    )


def test_columns_that_say_the_same_do_not_stop_it() -> None:
    column = np.arange(1.0, 6.0)
    found = solve_within(np.column_stack([column, column]), 3 * column, 0.0, 1.0)
    np.testing.assert_allclose(found, [1.0, 1.0])


@pytest.mark.parametrize("seed", range(20))
def test_curved_problems_end_no_higher_than_scipys_search(seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = np.linspace(0.1, 2.0, 15)
    measured = 3 * np.exp(-1.5 * times) + 0.4 + 0.01 * rng.normal(size=times.size)
    lower, upper = np.array([0.0, 0.0, 0.0]), np.array([10.0, 1.2, 1.0])  # the rate is cut off

    def residual(x: np.ndarray) -> np.ndarray:
        return x[0] * np.exp(-x[1] * times) + x[2] - measured

    def slope(x: np.ndarray) -> np.ndarray:
        decay = np.exp(-x[1] * times)
        return np.column_stack([decay, -x[0] * times * decay, np.ones(times.size)])

    start = rng.uniform(lower, upper)
    ours = descend_within(residual, slope, start, lower, upper, tolerance=1e-14, tries=200)
    theirs = least_squares(residual, start, slope, (lower, upper), xtol=1e-14, ftol=1e-14).x
    assert np.sum(residual(ours) ** 2) <= np.sum(residual(theirs) ** 2) * (1 + 1e-9)
    assert ours[1] == upper[1]
