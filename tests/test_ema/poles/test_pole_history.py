"""Poles followed through the model orders: one-to-one matches and honest steps between them."""

import numpy as np
import pytest
import systems

from ema.core.mac import mac
from ema.poles.estimators import impulse_responses, normal_matrix
from ema.poles.tracking import pole_history

LINES_HZ = np.arange(80, 560) / 2
ORDER = 30


def history_of(snr_db, max_damping=0.2):
    frf = systems.tyre_frf(snr_db, positions=24, frequency_hz=LINES_HZ)
    responses, step_s = impulse_responses(LINES_HZ, frf.values)
    piece = responses[:, 1:200]
    return pole_history(normal_matrix(piece, ORDER), piece, step_s, LINES_HZ[0], max_damping)


@pytest.fixture(scope="module")
def history():
    return history_of(30)


def test_orders_ascend_to_the_highest_and_only_damped_poles_are_followed(history):
    """Orders too low for the modes may have none."""
    orders = np.unique(history.model_order)
    np.testing.assert_array_equal(orders, np.arange(orders[0], ORDER + 1))
    assert orders[0] < 10
    assert np.all(np.diff(history.model_order) >= 0)
    damping = systems.damping_of(history.poles)
    assert np.all((damping > 0) & (damping < 0.2))
    assert np.all(history.poles.imag > 0)
    assert history.shapes.shape == (history.poles.size, 24)


def test_strongly_damped_poles_can_be_left_out():
    assert np.all(systems.damping_of(history_of(30, 0.05).poles) < 0.05)


def test_a_match_is_one_pole_of_the_order_before(history):
    matched = np.flatnonzero(history.match >= 0)
    before = history.match[matched]
    np.testing.assert_array_equal(history.model_order[before], history.model_order[matched] - 1)
    assert np.unique(before).size == before.size


def test_the_lowest_order_has_nothing_to_match(history):
    first = history.model_order == history.model_order[0]
    np.testing.assert_array_equal(history.match[first], -1)
    for name in ("step_frequency", "step_damping", "step_total"):
        step = getattr(history, name)
        assert np.all(np.isinf(step[first]))
        np.testing.assert_array_equal(np.isfinite(step), history.match >= 0)


def test_steps_are_the_changes_from_the_match(history):
    for row in np.flatnonzero(history.match >= 0)[::7]:
        new, old = history.poles[row], history.poles[history.match[row]]
        frequency = abs(systems.frequency_hz_of(new) / systems.frequency_hz_of(old) - 1)
        damping = abs(systems.damping_of(new) / systems.damping_of(old) - 1)
        shapes = history.shapes[[history.match[row], row]]
        total = abs(new - old) / max(abs(new), abs(old)) + 1 - mac(shapes[:1], shapes[1:])[0, 0]
        assert history.step_frequency[row] == pytest.approx(frequency)
        assert history.step_damping[row] == pytest.approx(damping)
        assert history.step_total[row] == pytest.approx(total, abs=1e-9)


def test_modes_are_followed_through_the_upper_orders(history):
    for frequency_hz in systems.TABLE_3_HZ:
        near = np.abs(systems.frequency_hz_of(history.poles) / frequency_hz - 1) < 0.005
        upper = near & (history.model_order > ORDER // 2)
        assert np.unique(history.model_order[upper]).size > 0.9 * (ORDER - ORDER // 2)
        assert np.median(history.step_total[upper]) < 0.01


def test_noise_free_steps_are_tiny_once_the_order_suffices():
    history = history_of(np.inf)
    for frequency_hz in systems.TABLE_3_HZ:
        near = np.abs(systems.frequency_hz_of(history.poles) / frequency_hz - 1) < 1e-3
        assert np.min(history.step_total[near & (history.model_order > 25)]) < 1e-4
