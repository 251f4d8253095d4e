"""Circumferential orders: pure waves, mixtures, and positions that are missing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ema.circumference.orders import circle_basis, highest_order, label_modes, order_content
from ema.core.modes import Mode

FULL_DEG = np.arange(72) * 5.0


def wave(order, position_deg=FULL_DEG, turned_deg=0.0):
    return np.cos(order * np.deg2rad(position_deg - turned_deg))


def mode_of(shape):
    return Mode(-10 + 500j, 0.01, 0.001, shape, np.zeros(len(shape)))


@given(st.integers(0, 35), st.floats(0, 360), st.floats(0, 2 * np.pi))
def test_a_standing_wave_has_one_order_wherever_its_antinode(order, turned_deg, phase):
    shape = np.exp(1j * phase) * (wave(order, turned_deg=turned_deg))
    content = order_content(shape, FULL_DEG)
    assert content.order == order
    assert content.purity == pytest.approx(1)


@pytest.mark.parametrize("order", [1, 4, 7])
def test_a_travelling_wave_has_one_order_too(order):
    content = order_content(np.exp(1j * order * np.deg2rad(FULL_DEG)), FULL_DEG)
    assert (content.order, content.purity) == (order, pytest.approx(1))
    assert abs(content.cosine[order]) == pytest.approx(abs(content.sine[order]))


def test_a_mixture_shares_its_power():
    content = order_content(wave(2) + 0.5 * wave(3, turned_deg=17.0) + 0.2, FULL_DEG)
    np.testing.assert_allclose(content.power[:4], [0.04, 0, 0.5, 0.125], atol=1e-12)
    assert content.purity == pytest.approx(0.5 / 0.665)


@given(st.floats(0, 360), st.integers(0, 1000))
def test_turning_the_zero_does_not_change_the_orders(turned_deg, seed):
    rng = np.random.default_rng(seed)
    shape = rng.standard_normal((72, 2)) @ [1, 1j]
    power = order_content(shape, FULL_DEG).power
    turned = order_content(shape, FULL_DEG + turned_deg).power
    np.testing.assert_allclose(turned, power, atol=1e-9)


def test_order_zero_alone_has_a_basis():
    np.testing.assert_array_equal(circle_basis(FULL_DEG, 0), np.ones((72, 1)))


def test_power_is_the_mean_square_of_the_shape():
    shape = np.random.default_rng(0).standard_normal(71)
    content = order_content(shape, np.arange(71) * 360 / 71)
    assert content.power.sum() == pytest.approx(np.mean(shape**2))


@pytest.mark.parametrize(
    ("positions", "highest"), [(72, 35), (71, 35), (13, 6), (12, 5), (5, 2), (4, 1), (3, 1)]
)
def test_equidistant_positions_tell_orders_below_half_their_number(positions, highest):
    position_deg = np.arange(positions) * 360 / positions
    assert highest_order(position_deg) == highest
    assert order_content(wave(highest, position_deg), position_deg).order == highest


def test_missing_positions_cost_orders_but_not_the_right_answer():
    kept = np.setdiff1d(np.arange(72), [3, 20, 21, 40, 41, 42])
    position_deg = FULL_DEG[kept]
    assert 15 < highest_order(position_deg) < 35
    for order in range(1, 8):
        content = order_content(wave(order, position_deg, turned_deg=11.0), position_deg)
        assert (content.order, content.purity) == (order, pytest.approx(1))


def test_positions_on_half_a_circle_tell_no_high_orders():
    assert highest_order(np.arange(37) * 5.0) < 5


def test_the_sequence_of_positions_does_not_matter():
    mixed = np.random.default_rng(0).permutation(72)
    content = order_content(wave(5)[mixed], FULL_DEG[mixed])
    assert (content.order, content.purity) == (5, pytest.approx(1))


def test_a_shape_of_zeros_has_no_purity():
    assert np.isnan(order_content(np.zeros(72), FULL_DEG).purity)


def test_modes_get_their_order_and_purity():
    labelled = label_modes([mode_of(wave(3)), mode_of(wave(1) + wave(2))], FULL_DEG)
    assert [mode.order for mode in labelled] == [3, 1]
    assert [mode.order_purity for mode in labelled] == pytest.approx([1, 0.5])


@pytest.mark.parametrize("position_deg", [np.full(72, np.nan), np.array([0.0, 180.0])])
def test_without_a_circle_there_are_no_orders(position_deg):
    (mode,) = label_modes([mode_of(np.ones(position_deg.size))], position_deg)
    assert mode.order is None
    assert np.isnan(mode.order_purity)


def at(frequency_hz, order, position_deg):
    shape = wave(order, position_deg) + 0j
    return Mode(2j * np.pi * frequency_hz - 10, 0.01, 0.001, shape, np.zeros(len(shape)))


def test_few_positions_leave_higher_orders_unknown():
    angles = np.arange(12) * 30.0
    modes = [
        at(frequency_hz, order, angles)
        for order, frequency_hz in ((3, 120.0), (4, 145.0), (5, 171.0), (5, 174.0), (7, 224.0))
    ]
    labelled = label_modes(modes, angles)
    assert [mode.order for mode in labelled] == [3, 4, 5, 5, None]
    assert np.isnan(labelled[-1].order_purity)


def test_an_odd_mode_below_does_not_end_the_orders():
    angles = np.arange(12) * 30.0
    modes = [
        at(frequency_hz, order, angles)
        for order, frequency_hz in ((5, 60.0), (1, 80.0), (2, 100.0))
    ]
    assert [mode.order for mode in label_modes(modes, angles)] == [5, 1, 2]
