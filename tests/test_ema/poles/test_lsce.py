"""Least-squares complex exponentials: sums of exponentials come back exactly."""

import numpy as np
import pytest
import systems
from hypothesis import given
from hypothesis import strategies as st

from ema.poles.estimators import (
    impulse_responses,
    normal_matrix,
    poles_of_order,
    shapes_of_poles,
    useful_length,
)

STEP_S = 1e-3
LOWEST_HZ = 20.0


def decays(poles, amplitudes, n_samples=200, step_s=STEP_S):
    """Σ_r a_ir e^{(s_r − jω₁)t}, one row per response."""
    times_s = step_s * np.arange(n_samples)
    return amplitudes @ np.exp((poles[:, None] - 2j * np.pi * LOWEST_HZ) * times_s)


def sorted_by_frequency(poles):
    return poles[np.argsort(poles.imag)]


def amplitudes_of(n_rows, n_poles, seed=0):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((n_rows, n_poles)) + 1j * rng.standard_normal((n_rows, n_poles))


@st.composite
def pole_sets(draw):
    """One to four poles, apart from each other, with damping ratios of tyres and of steel."""
    count = draw(st.integers(1, 4))
    slots = draw(st.permutations(range(8)))[:count]
    frequency_hz = [60 + 100 * slot + draw(st.floats(0, 40)) for slot in slots]
    damping = [draw(st.floats(0.002, 0.05)) for _ in slots]
    return sorted_by_frequency(systems.pole(frequency_hz, damping))


@given(pole_sets(), st.integers(0, 1000))
def test_as_many_poles_as_the_model_order_come_back(truth, seed):
    responses = decays(truth, amplitudes_of(6, truth.size, seed))
    found = poles_of_order(normal_matrix(responses, truth.size), truth.size, STEP_S, LOWEST_HZ)
    np.testing.assert_allclose(sorted_by_frequency(found), truth, rtol=1e-6)


def test_one_matrix_serves_every_order():
    """The leading block of the highest order's matrix is the problem of a lower order."""
    rng = np.random.default_rng(3)
    responses = decays(systems.pole([100.0, 300.0], [0.02, 0.03]), amplitudes_of(4, 2))
    responses += 0.1 * rng.standard_normal(responses.shape)
    highest, n_rows = 12, responses.shape[1] - 12
    matrix = normal_matrix(responses, highest)
    for order in range(1, highest + 1):
        past = np.concatenate([[r[j : j + order + 1] for j in range(n_rows)] for r in responses])
        later = np.linalg.lstsq(past[:, 1:], -past[:, 0], rcond=None)[0]
        roots = np.roots(np.append(later[::-1], 1))
        expected = np.log(np.abs(roots)) / STEP_S
        found = poles_of_order(matrix, order, STEP_S, LOWEST_HZ)
        np.testing.assert_allclose(np.sort(found.real), np.sort(expected), rtol=1e-6)


def test_an_order_too_low_cannot_hold_all_poles_and_a_higher_one_holds_them_among_others():
    truth = systems.pole([100.0, 300.0, 420.0], [0.02, 0.03, 0.01])
    matrix = normal_matrix(decays(truth, amplitudes_of(6, 3)), 8)
    low = poles_of_order(matrix, 2, STEP_S, LOWEST_HZ)
    assert low.size == 2
    assert np.abs(low[:, None] - truth[None, :]).min() > 1
    noisy = decays(truth, amplitudes_of(6, 3)) + 1e-6 * amplitudes_of(6, 200, seed=1)
    high = poles_of_order(normal_matrix(noisy, 8), 8, STEP_S, LOWEST_HZ)
    assert high.size == 8
    assert np.abs(high[:, None] - truth[None, :]).min(axis=0).max() < 1e-2


def test_roots_of_noise_show_as_unstable():
    """Predicting backwards drives them out of the unit circle (Kumaresan & Tufts 1982)."""
    truth = systems.pole([100.0, 300.0, 420.0], [0.02, 0.03, 0.01])
    noisy = decays(truth, amplitudes_of(6, 3)) + 1e-3 * amplitudes_of(6, 200, seed=1)
    found = poles_of_order(normal_matrix(noisy, 20), 20, STEP_S, LOWEST_HZ)
    stable = sorted_by_frequency(found[found.real < 0])
    np.testing.assert_allclose(stable, truth, rtol=1e-3)


def test_amplitudes_come_back():
    truth, amplitudes = systems.pole([100.0, 300.0], [0.02, 0.03]), amplitudes_of(5, 2)
    found = shapes_of_poles(decays(truth, amplitudes), truth, STEP_S, LOWEST_HZ)
    np.testing.assert_allclose(found, amplitudes.T, rtol=1e-9)


@pytest.mark.parametrize("lowest_hz", [0.5, 20.0, 50.0, 333.0])
def test_the_time_step_follows_the_inverted_band(lowest_hz):
    """A band of half the width has twice the step, wherever it lies."""
    for width_hz in (200.0, 100.0):
        lines_hz = lowest_hz + 0.5 * np.arange(round(2 * width_hz))
        responses, step_s = impulse_responses(lines_hz, np.ones((1, lines_hz.size)))
        assert step_s == pytest.approx(1 / width_hz)
        assert responses.shape == (1, lines_hz.size)


@pytest.mark.parametrize("lowest_hz", [20.0, 35.0, 50.0])
def test_poles_do_not_depend_on_the_lower_band_limit(lowest_hz):
    lines_hz = np.arange(lowest_hz, 300, 0.25)
    values = systems.inertance(
        lines_hz, systems.table_3_poles(), systems.tyre_residues(np.arange(12) * 30.0)
    )
    responses, step_s = impulse_responses(lines_hz, values)
    matrix = normal_matrix(responses[:, 1:400], 24)
    poles = poles_of_order(matrix, 24, step_s, lines_hz[0])
    truth = systems.table_3_poles()[:7]
    nearest = poles[np.abs(poles[None, :] - truth[:, None]).argmin(axis=1)]
    np.testing.assert_allclose(nearest, truth, rtol=1e-6)


def test_the_useful_length_ends_with_the_decay():
    """Energy falls as e^{−2σt}: all but 0.2 % has come by ln(500)/2σ."""
    decay_rate = 20.0
    power_gone_s = np.log(500) / (2 * decay_rate)
    clean = decays(np.array([-decay_rate + 600j]), np.ones((12, 1)), n_samples=2000)
    assert useful_length(clean, shortest=10) * STEP_S == pytest.approx(power_gone_s, rel=0.01)
    noisy = clean + 0.01 * amplitudes_of(12, 2000)
    assert useful_length(noisy, shortest=10) * STEP_S == pytest.approx(power_gone_s, rel=0.1)


@given(st.integers(100, 1000), st.integers(1, 2000), st.integers(0, 100))
def test_the_useful_length_leaves_the_end_alone(n_samples, shortest, seed):
    length = useful_length(amplitudes_of(2, n_samples, seed), shortest)
    assert min(shortest, n_samples * 9 // 10) <= length <= n_samples * 9 // 10
