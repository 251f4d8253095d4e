"""FRFs of one circumferential order: exact amplitudes, their noise, and the poles they show."""

from dataclasses import replace

import numpy as np
import pytest
import systems

from ema.circumference.orders import highest_order
from ema.core.modes import Pair
from ema.fitting.order_pair import OrderDecomposition
from ema.identify import fit_modes
from ema.poles.tracking import PoleSelection

LINES_HZ = np.arange(100, 560) / 2
POLES = systems.table_3_poles()
EVERY = np.arange(72)
KEPT = np.setdiff1d(EVERY, [3, 20, 21, 40, 41, 42])


def tyre(rows=EVERY, std=1e-3):
    position_deg = np.arange(72) * 5.0
    values = systems.inertance(LINES_HZ, POLES, systems.tyre_residues(position_deg))
    frf = systems.noise_free_frf(LINES_HZ, values, position_deg=position_deg)
    return replace(frf, std=np.full(values.shape, std)).rows(rows)


def drive_point(order):
    """Inertance of one order at the shaker: the amplitude of cos nθ."""
    pole = POLES[[order - 1]]
    return systems.inertance(LINES_HZ, pole, systems.residue(pole)[None, :])[0]


@pytest.mark.parametrize("rows", [EVERY, KEPT, np.random.default_rng(0).permutation(72)])
@pytest.mark.parametrize("order", [1, 4, 7])
def test_each_order_is_one_oscillator(order, rows):
    part = OrderDecomposition(tyre(rows)).order(order, slice(None))
    np.testing.assert_allclose(part.values[0], drive_point(order), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(part.values[1], 0, atol=1e-12)


def test_orders_that_are_not_there_are_empty():
    decomposition = OrderDecomposition(tyre())
    for order in (0, 12, 35):
        np.testing.assert_allclose(decomposition.order(order, slice(None)).values, 0, atol=1e-12)


def test_all_orders_together_are_the_frfs():
    rng = np.random.default_rng(0)
    random = rng.standard_normal((71, LINES_HZ.size)) + 1j
    angles = np.arange(71) * 360 / 71
    frf = replace(
        systems.noise_free_frf(LINES_HZ, random, position_deg=angles), std=np.ones(random.shape)
    )
    decomposition = OrderDecomposition(frf)
    assert decomposition.highest == 35
    total = np.zeros_like(random)
    for order in range(36):
        waves = np.deg2rad(order * angles)
        part = decomposition.order(order, slice(None)).values
        total += np.outer(np.cos(waves), part[0])
        if order:
            total += np.outer(np.sin(waves), part[1])
    np.testing.assert_allclose(total, random, rtol=1e-9)


def test_noise_averages_over_the_circle():
    """Cosine and sine amplitudes of N positions have σ √(2/N), the mean has σ/√N."""
    decomposition = OrderDecomposition(tyre(std=1.0))
    np.testing.assert_allclose(decomposition.order(3, slice(None)).std, np.sqrt(2 / 72))
    np.testing.assert_allclose(decomposition.order(0, slice(None)).std, np.sqrt(1 / 72))


def test_noise_is_what_repeated_measurements_scatter_by():
    frf, rng = tyre(KEPT, std=0.5), np.random.default_rng(0)
    decomposition = OrderDecomposition(frf)
    noise = 0.5 * rng.standard_normal((KEPT.size, 20_000))
    found = decomposition.order(5, slice(0, 1), noise).values
    expected = decomposition.order(5, slice(0, 1)).std[:, 0]
    np.testing.assert_allclose(found.std(axis=1), expected, rtol=0.02)


def test_lines_and_other_values_can_be_chosen():
    decomposition = OrderDecomposition(tyre())
    part = decomposition.order(2, slice(10, 20), 2 * tyre().values[:, 10:20])
    np.testing.assert_allclose(part.frequency_hz, LINES_HZ[10:20])
    np.testing.assert_allclose(part.values[0], 2 * drive_point(2)[10:20], rtol=1e-9)


def test_missing_positions_limit_the_orders():
    assert OrderDecomposition(tyre(KEPT)).highest == highest_order(np.arange(72)[KEPT] * 5.0) < 35


def split_tyre(position_deg, split=0.002, turn_rad=0.6):
    """FRFs of a tyre whose orders are pairs, the force between their members."""
    values = 0
    turns = np.broadcast_to(turn_rad, POLES.size)
    for n, (pole, turn) in enumerate(zip(POLES, turns, strict=True), 1):
        wave = n * np.deg2rad(position_deg) - turn
        a, b = np.cos(turn) * np.cos(wave), -np.sin(turn) * np.sin(wave)
        pair = np.array([pole, pole * (1 + split)])
        values += systems.inertance(LINES_HZ, pair, np.stack([a, b], 1) * systems.residue(pair))
    rng = np.random.default_rng(0)
    noise = 1e-5 * rng.standard_normal((*values.shape, 2)) @ [1, 1j]
    frf = systems.noise_free_frf(LINES_HZ, values + noise, position_deg=position_deg)
    return replace(frf, std=np.full(values.shape, 1e-5), excitation_deg=0.0)


def test_pairs_of_orders_beyond_the_positions_are_one_row_with_error_bars_that_hold():
    """Twelve sensors see order 7 as order 5, and order 6 by its cosine only."""
    modes = fit_modes(split_tyre(np.arange(12) * 30.0), PoleSelection(POLES, (60.0, 250.0))).modes
    beyond = [mode for mode in modes if mode.order is None]
    assert len(beyond) == 2
    for mode, pole in zip(beyond, POLES[5:7], strict=True):
        hz, ratio = systems.frequency_hz_of(pole), systems.damping_of(pole)
        mean_hz = hz * (1 + 0.002 * np.sin(0.6) ** 2)
        assert abs(mode.frequency_hz - mean_hz) < 3 * mode.frequency_std_hz < 2e-3 * hz
        assert abs(mode.damping_ratio - ratio) < 3 * mode.damping_std < 0.05 * ratio


def test_two_poles_of_one_order_beyond_the_positions_become_one_row():
    poles = np.sort_complex(np.append(POLES, POLES[6] * 1.015))
    frf = split_tyre(np.arange(12) * 30.0, split=0.02)
    modes = fit_modes(frf, PoleSelection(poles[np.argsort(abs(poles))], (60.0, 250.0))).modes
    assert len([mode for mode in modes if mode.order is None]) == 2


@pytest.mark.parametrize(("turn_rad", "is_sure"), [(0.01, False), (0.06, True)])
def test_a_member_that_hardly_shows_may_be_elsewhere(turn_rad, is_sure):
    """A share of 10⁻⁴ is as small as errors of FRFs: the true member may be elsewhere."""
    turns = np.full(POLES.size, 0.6)
    turns[2] = turn_rad
    frf = split_tyre(np.arange(72) * 5.0, split=0.003, turn_rad=turns)
    modes = fit_modes(frf, PoleSelection(POLES, (60.0, 250.0))).modes
    (third,) = [mode for mode in modes if mode.order == 3]
    assert third.pair is Pair.ONE_SEEN
    half_width_hz = third.damping_ratio * third.frequency_hz
    assert (third.frequency_std_hz < 0.002 * half_width_hz) == is_sure
    assert third.frequency_std_hz < 0.006 * half_width_hz
