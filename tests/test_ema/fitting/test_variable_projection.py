"""Variable projection: its derivatives against finite differences, its limits against truth."""

import numpy as np
import pytest
import systems

from ema.fitting.pole_fit import Lines, evaluate, fit_poles
from ema.fitting.variable_projection import project, stacked

TRUE_POLES = systems.pole([60.0, 85.0], [0.03, 0.02])
FREQUENCY_HZ = np.linspace(40, 110, 60)
OMEGA = 2 * np.pi * FREQUENCY_HZ
N_POSITIONS = 4
WEIGHT = np.linspace(1, 2, FREQUENCY_HZ.size)
SCALE = np.array([1.0, 0.5, 2.0, 1.5])


def measured(noise=0.0, seed=0):
    rng = np.random.default_rng(seed)
    shape = (N_POSITIONS, 2)
    residues = (rng.standard_normal(shape) + 0.2j * rng.standard_normal(shape)) * systems.residue(
        TRUE_POLES
    )
    values = systems.inertance(FREQUENCY_HZ, TRUE_POLES, residues)
    values += noise * (rng.standard_normal(values.shape) + 1j * rng.standard_normal(values.shape))
    return values, residues


def lines_of(values, run=None):
    run = np.zeros(N_POSITIONS, dtype=int) if run is None else run
    return Lines(FREQUENCY_HZ, values, WEIGHT, SCALE, run, np.ones(FREQUENCY_HZ.size))


def residuals(values, parameters):
    """Weighted residuals at poles given as (Re s, Im s) one after the other."""
    solution = project(
        OMEGA, stacked(values, WEIGHT), WEIGHT, parameters[0::2] + 1j * parameters[1::2]
    )
    return np.ravel(solution.misfit * SCALE)


def parameters_of(poles):
    return np.ravel(np.column_stack([poles.real, poles.imag]))


def central_differences(function, at, step=1e-3):
    shifts = step * np.eye(at.size)
    return np.stack([(function(at + s) - function(at - s)) / (2 * step) for s in shifts], axis=-1)


def test_linear_parameters_are_exact_at_the_true_poles():
    values, residues = measured()
    lower, upper = np.array([0.1, -0.2, 0.3, 0.0]), np.array([1e-6, 2e-6, -1e-6, 0.0])
    values = values + lower[:, None] - OMEGA**2 * upper[:, None]
    solution = project(OMEGA, stacked(values, WEIGHT), WEIGHT, TRUE_POLES)
    np.testing.assert_allclose(solution.residues, residues, rtol=1e-9)
    np.testing.assert_allclose(solution.lower, lower, atol=1e-9)
    np.testing.assert_allclose(solution.upper, upper, atol=1e-14)
    assert np.abs(solution.misfit).max() < 1e-9


def test_the_gradient_is_that_of_the_cost():
    """Kaufman's shortcut leaves the gradient exact, however large the residuals."""
    values, _ = measured(noise=0.02)
    at = parameters_of(TRUE_POLES * (1.01 - 0.002j))

    def cost(parameters):
        return 0.5 * np.sum(residuals(values, parameters) ** 2)

    poles = at[0::2] + 1j * at[1::2]
    found = project(OMEGA, stacked(values, WEIGHT), WEIGHT, poles).gradient(SCALE)
    np.testing.assert_allclose(found, central_differences(cost, at), rtol=1e-5)


def test_the_normal_matrix_is_that_of_the_residuals():
    """Without residuals Kaufman's Jacobian is the full one."""
    values, _ = measured()
    at = parameters_of(TRUE_POLES)
    jacobian = central_differences(lambda x: residuals(values, x), at)
    found = project(OMEGA, stacked(values, WEIGHT), WEIGHT, TRUE_POLES).normal_matrix(SCALE)
    expected = jacobian.T @ jacobian
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


def test_the_derivatives_hold_for_runs_that_drifted():
    values, _ = measured(noise=0.02)
    lines = lines_of(values, run=np.array([0, 1, 0, 1]))
    state = [0.004, 0.002, -0.001, 0.03]
    at = np.append(parameters_of(TRUE_POLES * (1.01 - 0.002j)), state)

    def fit(parameters):
        poles = parameters[0:-4:2] + 1j * parameters[1:-4:2]
        return evaluate(lines, poles, np.stack([np.zeros(4), parameters[-4:]]))

    slope = central_differences(lambda x: 0.5 * fit(x).chi_square, at, step=1e-5)
    np.testing.assert_allclose(fit(at).gradient(), slope, rtol=1e-4)


def bounds_around(start, reach):
    centre = np.ravel(np.column_stack([-start.real, start.imag]))
    return centre * (1 - reach), centre * (1 + reach)


def test_the_fit_finds_the_true_poles_from_beside_them():
    values, residues = measured()
    start = TRUE_POLES * (1.004 + 0.005j)
    fit = fit_poles(lines_of(values), start, *bounds_around(start, 0.5))
    np.testing.assert_allclose(fit.poles, TRUE_POLES, rtol=1e-8)
    np.testing.assert_allclose(fit.residues, residues, rtol=1e-6)
    assert not np.any(fit.at_bound)
    assert fit.chi_square < 1e-12


def test_a_start_that_would_grow_is_brought_inside_the_bounds():
    """States of runs, carried on beyond the lines, can turn the damping of a stand-in over."""
    values, _ = measured()
    start = TRUE_POLES.copy()
    start[-1] = -start[-1].conjugate()
    fit = fit_poles(lines_of(values), start, *bounds_around(TRUE_POLES, 0.5))
    np.testing.assert_allclose(fit.poles, TRUE_POLES, rtol=1e-5)


def test_parameters_on_their_bound_are_flagged():
    """The first pole's decay rate and the second one's frequency are kept from the truth."""
    values, _ = measured()
    lower, upper = bounds_around(TRUE_POLES, 0.5)
    upper[0] = -0.9 * TRUE_POLES[0].real
    lower[3] = 1.005 * TRUE_POLES[1].imag
    fit = fit_poles(lines_of(values), TRUE_POLES, lower, upper)
    np.testing.assert_array_equal(fit.at_bound, [True, False, False, True])
    assert -fit.poles[0].real == pytest.approx(upper[0], rel=1e-3)
    assert fit.poles[1].imag == pytest.approx(lower[3], rel=1e-5)


def test_a_drift_between_runs_comes_back():
    run, drift = np.array([0, 1, 0, 1]), 0.003
    values, residues = measured()
    moved = systems.inertance(FREQUENCY_HZ, TRUE_POLES * (1 + drift), residues)
    values[run == 1] = moved[run == 1]
    bounds = bounds_around(TRUE_POLES, 0.5)
    fit = fit_poles(lines_of(values, run), TRUE_POLES, *bounds, np.zeros((2, 4)))
    for pole, moved in zip(fit.poles, fit.in_run(1), strict=True):
        assert moved == pytest.approx(pole * (1 + drift), rel=1e-8)
    np.testing.assert_allclose(fit.poles, TRUE_POLES, rtol=1e-8)
    np.testing.assert_allclose(fit.residues, residues, rtol=1e-6)


def test_the_misfit_is_one_where_the_weights_are_the_noise():
    noise = 0.02
    values, _ = measured(noise=noise)
    lines = Lines(
        FREQUENCY_HZ,
        values,
        np.full(FREQUENCY_HZ.size, 1 / noise),
        np.ones(N_POSITIONS),
        np.zeros(N_POSITIONS, dtype=int),
        np.ones(FREQUENCY_HZ.size),
    )
    fit = fit_poles(lines, TRUE_POLES, *bounds_around(TRUE_POLES, 0.5))
    n_data = 2 * values.size
    assert fit.misfit == pytest.approx(1, abs=4 * np.sqrt(2 / n_data))
