"""What sensors mix of the waves: none on an ideal ring whose pairs are split, all that there is."""

import numpy as np
import pytest

from ema.core.frf import FRF
from ema.core.settings import IDENTIFICATION
from ema.fitting.joint_orders import _pooled
from ema.fitting.order_pair import OrderDecomposition
from ema.fitting.pole_fit import evaluate, lines_to_fit, with_stand_ins
from ema.fitting.wave_mixing import WaveMixing
from pipelines.simulate.truth import TruthMode, modal_sum

BAND_HZ = (60.0, 160.0)
LINES_HZ = np.arange(1, 1201) / 4
ANGLES_DEG = np.arange(0.0, 360.0, 15.0)
RING = ((1, 79.0, 0.03), (2, 100.0, 0.028), (3, 121.0, 0.024), (4, 145.0, 0.022))
MODES = tuple(
    TruthMode(order, member, hz * (1 + sign * 0.005), ratio, 4.0, 17.0 * order + turn)
    for order, hz, ratio in RING
    for member, sign, turn in (("a", -1, 0.0), ("b", 1, 90.0 / order))
)


def strays(mixed, *, pairs_known, noise=1e-3):
    """Of orders 1 to 4, in one wave of another and in all, where sensors mix a share of them."""
    omega, random = 2 * np.pi * LINES_HZ, np.random.default_rng(3)
    system = modal_sum(MODES, ANGLES_DEG, 5.0)
    exact = np.array([system.inertance(row, omega) for row in range(ANGLES_DEG.size)])
    gains = random.normal(1.0, mixed, (ANGLES_DEG.size, 1)) if mixed else 1.0
    std = noise * np.sqrt(np.mean(np.abs(exact) ** 2))
    error = random.normal(0.0, std, (2, *exact.shape))
    values = gains * exact + error[0] + 1j * error[1]
    known = np.full(exact.shape, std)
    frf = FRF.from_arrays(LINES_HZ, values, angles_deg=ANGLES_DEG, std=known)
    lines = lines_to_fit(frf, BAND_HZ)
    members = [
        np.array([2 * np.pi * m.frequency_hz * (-m.damping_ratio + 1j) for m in MODES[k : k + 2]])
        for k in range(0, len(MODES), 2)
    ]
    poles = with_stand_ins(np.array([each.mean() for each in members]), lines)
    fit = evaluate(lines, poles, np.zeros((1, 4)))
    pairs = [((k,), both) for k, both in enumerate(members)] if pairs_known else []
    orders = [(order, [k]) for k, (order, _, _) in enumerate(RING)]
    std_of_lines = np.full((ANGLES_DEG.size, lines.frequency_hz.size), std)
    given = fit, poles, std_of_lines, OrderDecomposition(frf), orders, pairs, 1.0, IDENTIFICATION
    mixing = WaveMixing(*given)
    return np.array([mixing.stray(order, found) for order, found in orders])


def test_split_pairs_in_place_are_not_taken_for_mixing():
    one_pole_each, pairs = (strays(0.0, pairs_known=known)[:, 1] for known in (False, True))
    assert np.median(one_pole_each) > 5 * np.median(pairs)
    assert np.max(pairs) < 1e-3


@pytest.mark.parametrize("share", [0.01, 0.03])
def test_what_gains_mix_is_seen_beside_pairs(share):
    # White errors of 24 gains spread their power over 24 waves.
    expected = share / np.sqrt(ANGLES_DEG.size)
    assert np.median(strays(share, pairs_known=True)[:, 0]) == pytest.approx(expected, rel=0.5)


def test_orders_tell_of_a_force_what_each_of_them_does_not_know_beforehand():
    prior, told = np.array([0.5]), np.array([0.3])
    values = np.array([[0.2], [0.4], [0.6]])
    std = np.full((3, 1), 1 / np.sqrt(prior**-2 + told**-2))
    found = values * std**2 / told**2  # each drawn to zero by what was known
    given = found, std, np.full((3, 1), prior), np.zeros((3, 1)), prior
    mean, mean_std = _pooled(*given)
    assert mean_std == pytest.approx(1 / np.sqrt(3 * told**-2 + prior**-2))
    assert mean == pytest.approx(0.4 * 3 * told**-2 * mean_std**2)
