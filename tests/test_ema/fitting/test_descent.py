"""The search beneath the curve fit, which sees normal equations only, against the full problem."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import least_squares

from ema.fitting.variable_projection import descend

TIMES = np.linspace(0.0, 3.0, 40)


@dataclass(frozen=True)
class Decay:
    """A decaying oscillation held against samples: amplitude, rate, frequency, offset."""

    values: np.ndarray
    measured: np.ndarray

    @property
    def residual(self) -> np.ndarray:
        a, rate, omega, offset = self.values
        return a * np.exp(-rate * TIMES) * np.cos(omega * TIMES) + offset - self.measured

    @property
    def slope(self) -> np.ndarray:
        a, rate, omega, _ = self.values
        decay, phase = np.exp(-rate * TIMES), omega * TIMES
        columns = [
            decay * np.cos(phase),
            -a * TIMES * decay * np.cos(phase),
            -a * TIMES * decay * np.sin(phase),
            np.ones(TIMES.size),
        ]
        return np.column_stack(columns)

    @property
    def cost(self) -> float:
        return float(self.residual @ self.residual)

    def gradient(self) -> np.ndarray:
        return self.slope.T @ self.residual

    def normal_matrix(self) -> np.ndarray:
        return self.slope.T @ self.slope


TRUE = np.array([2.0, 0.8, 7.0, 0.3])
LOWER, UPPER = np.array([0.1, 0.1, 5.5, -1.0]), np.array([9.0, 3.0, 8.5, 1.0])


def search(measured: np.ndarray, start: np.ndarray, upper: np.ndarray = UPPER) -> np.ndarray:
    found, point = descend(
        lambda x: Decay(x, measured), start, LOWER, upper, size=np.ones(4), gain=1e-13, tries=100
    )
    np.testing.assert_array_equal(point.values, found)
    return found


@pytest.mark.parametrize("seed", range(20))
def test_it_ends_where_the_search_with_all_residuals_ends(seed: int) -> None:
    rng = np.random.default_rng(seed)
    measured = Decay(TRUE, np.zeros(TIMES.size)).residual + 0.05 * rng.normal(size=TIMES.size)
    start = np.clip(TRUE * rng.uniform(0.9, 1.1, 4), LOWER, UPPER)
    theirs = least_squares(
        lambda x: Decay(x, measured).residual,
        start,
        lambda x: Decay(x, measured).slope,
        bounds=(LOWER, UPPER),
        xtol=1e-12,
        ftol=1e-14,
        gtol=1e-12,
    ).x
    np.testing.assert_allclose(search(measured, start), theirs, rtol=1e-5)


def test_a_bound_in_the_way_is_met_and_the_others_are_best_there() -> None:
    measured = Decay(TRUE, np.zeros(TIMES.size)).residual
    upper = np.array([9.0, 0.5, 8.5, 1.0])
    found = search(measured, np.array([1.5, 0.4, 6.9, 0.0]), upper)
    assert found[1] == pytest.approx(0.5, abs=1e-4)
    free = Decay(found, measured).gradient()[[0, 2, 3]]
    np.testing.assert_allclose(free, 0, atol=1e-3)


def test_a_start_outside_the_box_is_brought_into_it() -> None:
    measured = Decay(TRUE, np.zeros(TIMES.size)).residual
    found = search(measured, np.array([20.0, 0.8, 7.0, 0.3]))
    np.testing.assert_allclose(found, TRUE, rtol=1e-6)


def test_a_parameter_that_nothing_depends_on_stays_where_it_is() -> None:
    measured = Decay(TRUE, np.zeros(TIMES.size)).residual
    blind = type(
        "Blind", (Decay,), {"slope": property(lambda s: Decay.slope.fget(s) * [1, 1, 1, 0])}
    )
    found, _ = descend(
        lambda x: blind(x, measured),
        np.array([1.9, 0.8, 7.0, 0.25]),
        LOWER,
        UPPER,
        size=np.ones(4),
        gain=1e-13,
        tries=100,
    )
    assert found[3] == pytest.approx(0.25, abs=1e-6)
