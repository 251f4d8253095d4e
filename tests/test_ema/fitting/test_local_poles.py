"""Poles that differ from position to position: their mean, and what it leaves open."""

import numpy as np
import pytest
import systems

from ema.fitting.evidence import at_mean_of_positions, std_over_positions
from ema.fitting.pole_fit import N_DRIFT, Lines, evaluate

LINES_HZ = np.arange(80, 600) / 4
POLES = systems.pole([40.0, 75.0, 110.0], [0.02, 0.02, 0.02])
STAND_INS = systems.pole([160.0, 170.0], [0.02, 0.02])
SHAPES = np.sin(np.outer(np.arange(1, 13), np.arange(1, 4)) * 0.4)


def fit_at(poles, states, shapes=SHAPES):
    """A fit at given poles to positions that see the structure in states of their own."""
    values = [
        systems.inertance(LINES_HZ, POLES * state, (shape * systems.residue(POLES))[None])[0]
        for state, shape in zip(states, shapes, strict=True)
    ]
    n_positions, ones = len(values), np.ones(LINES_HZ.size)
    rows = np.ones(n_positions), np.zeros(n_positions, dtype=int)
    lines = Lines(LINES_HZ, np.array(values), ones, *rows, ones)
    return evaluate(lines, np.append(poles, STAND_INS), np.zeros((1, N_DRIFT)))


@pytest.mark.parametrize("off", [1.0, 1.001, 1 + 1e-3j])
def test_positions_that_agree_lead_to_their_pole(off):
    fit = at_mean_of_positions(fit_at(POLES * off, np.ones(12)))
    np.testing.assert_allclose(fit.poles[:3], POLES, rtol=3e-5)
    assert np.all(std_over_positions(fit, 1.0)[:3] < 1e-2)


def test_the_mean_is_weighted_by_what_the_positions_show():
    """A fiftieth of a half-width more at every second position."""
    states = 1 + 4e-4 * (np.arange(12) % 2)
    weight = SHAPES**2 / np.sum(SHAPES**2, axis=0)
    mean = POLES * (weight.T @ states)
    fit = at_mean_of_positions(fit_at(POLES, states))
    np.testing.assert_allclose(fit.poles[:3], mean, rtol=2e-5)
    std_hz = std_over_positions(fit, 1.0)[:3, 0]
    scatter = 2e-4 * systems.frequency_hz_of(mean) / np.sqrt(12)
    np.testing.assert_allclose(std_hz, scatter, rtol=0.6)


def test_few_positions_leave_more_open_than_their_scatter():
    states = np.array([1.0, 1.0004])
    fit = at_mean_of_positions(fit_at(POLES, states, np.ones((2, 3))))
    apart_hz = 4e-4 * systems.frequency_hz_of(POLES)
    assert np.all(std_over_positions(fit, 1.0)[:3, 0] > 2 * apart_hz)


def test_one_position_has_no_mean():
    fit = fit_at(POLES * 1.001, np.ones(1), np.ones((1, 3)))
    np.testing.assert_array_equal(at_mean_of_positions(fit).poles, fit.poles)
    np.testing.assert_array_equal(std_over_positions(fit, 1.0), 0)


@pytest.mark.parametrize("frequency_hz", [1.0, 40.0])
def test_a_pole_that_hardly_swings_stays_in_its_half_plane(frequency_hz):
    """Its half-width is larger than its frequency: a step of half of it would be too far."""
    slow = 2 * np.pi * frequency_hz * (-6 + 0.3j)
    states = 1 + 0.01 * np.sin(np.arange(12))
    fit = at_mean_of_positions(fit_at(np.append(POLES, slow), states))
    assert np.all(fit.poles.imag > 0)
