"""Measured modes against the ring: which modes stand for an order, and how shapes are compared."""

from dataclasses import replace

import numpy as np
import pytest
import systems
from results import FREQUENCIES_HZ, ORDERS, ring_modes, tyre_result

from ema.core.mac import mac
from ema.core.modes import Mode
from model.tuning import tune_ring
from pipelines.process.ring import tune
from pipelines.process.validate import aligned_shape, ring_orders, validate
from pipelines.results.options import Options

POSITION_DEG = np.arange(72) * 5.0


def mode_of(order, frequency_hz, size=1.0, turned_deg=0.0, **changes):
    shape = np.cos(order * np.deg2rad(POSITION_DEG - turned_deg))
    pole = complex(systems.pole(frequency_hz, 0.02))
    mode = Mode(
        pole,
        0.01,
        1e-4,
        size * shape * systems.residue(pole),
        np.zeros(72),
        order=order,
        order_purity=1.0,
    )
    return replace(mode, **changes)


@pytest.fixture(scope="module")
def model():
    return ring_modes(POSITION_DEG)


@pytest.fixture(scope="module")
def tuning():
    return tune_ring(ORDERS, FREQUENCIES_HZ, mean_radius_m=0.33, inflation_pressure_pa=2.2e5)


def test_each_order_of_the_ring_is_taken_once(model):
    orders = ring_orders(model)
    assert [order.order for order in orders] == list(ORDERS)
    np.testing.assert_allclose([order.frequency_hz for order in orders], FREQUENCIES_HZ)


def test_a_weak_mode_of_the_same_order_elsewhere_is_not_the_rings(model):
    """A resonance of rim or stinger that shakes the belt a little."""
    stranger = mode_of(3, 210.0, size=0.02)
    modes = tuple(sorted([*model.modes, stranger], key=lambda mode: mode.frequency_hz))
    with_stranger = ring_orders(replace(model, modes=modes))
    assert [order.frequency_hz for order in with_stranger] == pytest.approx(list(FREQUENCIES_HZ))


def test_a_shape_that_is_none_of_the_rings_is_left_out(model):
    mixed = replace(model.modes[2], order_purity=0.3)
    modes = (*model.modes[:2], mixed, *model.modes[3:])
    assert 3 not in [order.order for order in ring_orders(replace(model, modes=modes))]


@pytest.mark.parametrize("turned_deg", [0.0, 7.0, 22.5, 30.0])
def test_the_rings_shape_is_turned_to_the_measured_one(turned_deg):
    mode = mode_of(4, 145.0, turned_deg=turned_deg)
    expected = aligned_shape(mode, POSITION_DEG)
    assert mac(mode.residues, expected)[0, 0] == pytest.approx(1)


def test_aligning_does_not_make_other_orders_alike():
    mode = mode_of(4, 145.0, turned_deg=11.0)
    other = aligned_shape(mode_of(5, 170.0, turned_deg=3.0), POSITION_DEG)
    assert mac(mode.residues, other)[0, 0] == pytest.approx(0, abs=1e-12)


def test_an_impure_shape_shows_in_its_mac():
    """Half of the power in another order leaves a MAC of one half."""
    pure = mode_of(4, 145.0)
    mixed = replace(pure, residues=pure.residues + mode_of(9, 145.0).residues)
    expected = aligned_shape(mixed, POSITION_DEG)
    assert mac(mixed.residues, expected)[0, 0] == pytest.approx(0.5)


def test_errors_are_those_of_the_tuned_ring(model, tuning):
    validation = validate(model, ring_orders(model), tuning, None)
    np.testing.assert_array_equal(validation.order, ORDERS)
    expected = 100 * (tuning.model_hz / FREQUENCIES_HZ - 1)
    np.testing.assert_allclose(validation.error_percent, expected)
    assert np.all(np.isnan(validation.model_damping))


def test_pure_orders_give_identity_matrices(model, tuning):
    validation = validate(model, ring_orders(model), tuning, None)
    np.testing.assert_allclose(validation.mac, np.eye(7), atol=1e-9)
    np.testing.assert_allclose(validation.auto_mac, np.eye(7), atol=1e-9)


def test_order_1_has_no_say_in_the_damping_where_the_rim_moves():
    whole = tyre_result()
    modes = (mode_of(1, 40.0), *whole.modal_model.modes)
    found = tune(replace(whole, modal_model=replace(whole.modal_model, modes=modes)), Options())
    assert found.tuning.verdict.orders_left_out == (1,)
    assert list(found.damping.orders) == list(ORDERS[1:])
    assert list(found.validation.order) == list(ORDERS)
    np.testing.assert_allclose(found.validation.model_damping[1:], found.damping.model)
