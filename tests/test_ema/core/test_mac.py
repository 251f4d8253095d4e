"""Assurance criteria: bounds, symmetries and shapes whose answer is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ema.core.mac import auto_mac, frac, mac, mpc, mpd_deg

PARTS = st.floats(-10, 10).map(lambda x: x if abs(x) > 1e-3 else 0.0)


def shapes(rows, columns):
    return arrays(float, (2, rows, columns), elements=PARTS).map(lambda x: x[0] + 1j * x[1])


FACTORS = st.tuples(st.floats(0.01, 100), st.floats(0, 2 * np.pi)).map(
    lambda polar: polar[0] * np.exp(1j * polar[1])
)
ANGLES = np.deg2rad(np.arange(0, 360, 5))


@given(shapes(3, 5), shapes(2, 5))
def test_mac_lies_between_0_and_1_and_is_symmetric(first, second):
    values = mac(first, second)
    assert values.shape == (3, 2)
    assert np.all((values >= 0) & (values <= 1 + 1e-12))
    np.testing.assert_allclose(values, mac(second, first).T, atol=1e-12)


@given(shapes(3, 5), FACTORS)
def test_mac_does_not_see_scale_and_phase(rows, factor):
    np.testing.assert_allclose(mac(factor * rows, rows), mac(rows, rows), atol=1e-9)


@given(shapes(3, 5))
def test_auto_mac_has_ones_where_there_is_a_shape(rows):
    expected = np.any(rows != 0, axis=1).astype(float)
    np.testing.assert_allclose(np.diag(auto_mac(rows)), expected, atol=1e-9)


def test_orthogonal_shapes_have_no_mac():
    waves = [np.cos(3 * ANGLES), np.sin(3 * ANGLES), np.cos(4 * ANGLES)]
    np.testing.assert_allclose(auto_mac(waves), np.eye(3), atol=1e-12)


def test_mac_of_known_vectors():
    assert mac([1, 1], [1, 0])[0, 0] == pytest.approx(0.5)
    assert mac([1, 1j], [1, 0])[0, 0] == pytest.approx(0.5)
    assert mac([3, 4], [4, 3])[0, 0] == pytest.approx((24 / 25) ** 2)


def test_shapes_of_different_places_are_refused():
    with pytest.raises(ValueError, match="3 and 2 positions"):
        mac(np.ones(3), np.ones(2))


@given(shapes(3, 6), FACTORS)
def test_frac_lies_between_0_and_1_and_does_not_see_a_factor(rows, factor):
    other = rows + 0.3 * rows[:, ::-1]
    values = frac(rows, other)
    assert np.all((values >= 0) & (values <= 1 + 1e-12))
    np.testing.assert_allclose(frac(factor * rows, other), values, atol=1e-9)


def test_frac_compares_row_by_row():
    first = np.array([[1, 1j], [1, 1], [0, 0]])
    second = np.array([[2, 2j], [1, -1], [1, 1]])
    np.testing.assert_allclose(frac(first, second), [1, 0, 0], atol=1e-12)


@given(arrays(float, 6, elements=PARTS), FACTORS)
def test_a_real_mode_is_collinear_at_any_phase(values, factor):
    shape = factor * values
    if np.any(values):
        assert mpc(shape) == pytest.approx(1)
        assert mpd_deg(shape) == pytest.approx(0, abs=1e-4)


@given(shapes(1, 6), FACTORS)
def test_collinearity_does_not_see_scale_and_phase(row, factor):
    shape = row[0]
    assert 0 <= mpc(shape) <= 1 + 1e-12
    assert 0 <= mpd_deg(shape) <= 90
    assert mpc(factor * shape) == pytest.approx(mpc(shape), abs=1e-9)


def test_a_travelling_wave_is_as_complex_as_can_be():
    wave = np.exp(1j * ANGLES)
    assert mpc(wave) == pytest.approx(0, abs=1e-12)
    assert mpd_deg(wave) == pytest.approx(45, abs=1)


@pytest.mark.parametrize("ratio", [0.1, 0.5, 0.9])
def test_a_mixed_wave_has_the_phase_collinearity_of_its_ellipse(ratio):
    """cos θ + j·ratio·sin θ: λ2/λ1 = ratio², MPC = ((1 − ratio²)/(1 + ratio²))²."""
    shape = np.cos(ANGLES) + 1j * ratio * np.sin(ANGLES)
    assert mpc(shape) == pytest.approx(((1 - ratio**2) / (1 + ratio**2)) ** 2)


def test_the_mean_phase_deviation_is_weighted_by_amplitude():
    """Two large parts on the axis and a small one at a right angle."""
    assert mpd_deg([10, -10, 1j]) == pytest.approx(90 * 1 / 21, rel=1e-6)


def test_nothing_is_neither_alike_nor_real():
    zero = np.zeros(4)
    assert mac(zero, np.ones(4))[0, 0] == 0
    assert frac(zero, np.ones(4))[0] == 0
    assert mpc(zero) == 0
    assert mpd_deg(zero) == 90
