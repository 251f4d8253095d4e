"""The pair of one order with a known answer: poles, orientation, error bars, verdict."""

from dataclasses import replace

import numpy as np
import pytest
import systems

from ema.core.modes import Pair
from ema.core.settings import IDENTIFICATION
from ema.fitting.order_pair import (
    OrderFrf,
    RingOrder,
    contradicted,
    fit_pair,
    order_report,
    settled,
    with_curvature,
)
from ema.fitting.ring_pair import Known

LINES_HZ = np.arange(200, 400) / 2
HZ, ZETA = 145.45, 0.022
FORCE_STD, WAVE_STD = np.deg2rad(2.0), 0.004


def true_poles(split_percent, ratio=(ZETA, ZETA)):
    return systems.pole(HZ * (1 + np.array([-1, 1]) * split_percent / 200), ratio)


def order_frf(split_percent, angle_deg=35.0, *, snr=1e3, seed=0, crosstalk=0.0, ratio=(ZETA, ZETA)):
    """A pair whose lower member has its antinode at an angle from the force, in (cos, sin)."""
    poles = true_poles(split_percent, ratio)
    cosine, sine = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    residues = systems.residue(poles) * np.array(
        [[cosine**2, sine**2], [cosine * sine, -cosine * sine]]
    )
    rng = np.random.default_rng(seed)
    mixed = np.eye(2) + crosstalk * rng.standard_normal((2, 2))
    clean = systems.inertance(LINES_HZ, poles, mixed @ residues)
    std = np.abs(clean).max() / snr
    noise = std * (rng.standard_normal(clean.shape) + 1j * rng.standard_normal(clean.shape))
    return OrderFrf(4, LINES_HZ, clean + noise, np.full(clean.shape, std))


def fitted(frf, start=None):
    start = complex(systems.pole([HZ * 1.002], [1.1 * ZETA])[0]) if start is None else start
    return fit_pair(frf.frequency_hz, frf.values, frf.std, start, Known(FORCE_STD, WAVE_STD, 1.0))


def as_listed(pair):
    return with_curvature(
        RingOrder(4, (0,), pair, order_report(4, pair), None, True), IDENTIFICATION
    )


def relative(pair, poles):
    true = [systems.frequency_hz_of(poles), systems.damping_of(poles)]
    return pair.numbers[:4] / np.array(true).T.ravel() - 1


@pytest.mark.parametrize("angle_deg", [20, 45, 70, 110, 160])
@pytest.mark.parametrize("split_percent", [0.2, 0.5, 1.5, 4.0])
def test_both_members_come_back(split_percent, angle_deg):
    pair = fitted(order_frf(split_percent, angle_deg, snr=5e3))
    damping = 0.012 if split_percent < 0.5 else 5e-3
    assert np.all(np.abs(relative(pair, true_poles(split_percent))) < [2e-4, damping] * 2)
    directions = np.rad2deg(np.arctan2(pair.residues[:, 1].imag, pair.residues[:, 0].imag)) % 180
    assert directions[0] == pytest.approx(angle_deg, abs=3)
    if split_percent >= 0.5:  # below, it hangs on the noise whether both are determined
        assert order_report(4, pair).pair.verdict is Pair.RESOLVED


def test_members_that_are_damped_differently_are_told():
    ratio = (0.021, 0.023)
    pair = fitted(order_frf(0.5, 45.0, ratio=ratio))
    assert np.all(np.abs(relative(pair, true_poles(0.5, ratio))) < [4e-4, 1e-2] * 2)


def test_unlike_damping_is_believed_of_members_with_peaks_of_their_own():
    """Within a half-width of each other an error of the FRFs looks like unlike damping."""
    ratio = (0.0245, 0.0205)
    near, apart = (fitted(order_frf(split, 45.0, snr=5e3, ratio=ratio)) for split in (0.3, 4.0))
    stds = [np.sqrt(np.diag(pair.covariance)).reshape(3, 2)[:2] for pair in (near, apart)]
    assert np.all(stds[0] > (0.001 * HZ, 0.001)) and np.all(stds[1] < (0.0002 * HZ, 0.0002))
    verdicts = [order_report(4, pair).pair.verdict for pair in (near, apart)]
    assert verdicts == [Pair.NOT_SEPARABLE, Pair.RESOLVED]


def test_a_member_that_is_not_driven_may_lie_on_either_side_in_other_frfs():
    """The driven one was compared with the other, 22 Hz away, and not listed any more."""
    pair = fitted(order_frf(1.0, 90.0))
    across = [2, 3, 0, 1, 4, 5]
    numbers = pair.numbers.copy()
    driven, other = 2 * pair.stronger, 2 - 2 * pair.stronger
    numbers[other] = 2 * numbers[driven] - numbers[other]
    mirrored = replace(pair, numbers=numbers[across], share=pair.share[::-1])
    known = RingOrder(4, (0,), pair, order_report(4, pair), None, True)
    held = contradicted(known, replace(known, pair=mirrored), IDENTIFICATION).pair
    before, after = (np.sqrt(np.diag(each.covariance)) for each in (pair, held))
    assert after[driven] == pytest.approx(before[driven])
    assert after[other] > abs(numbers[other] - pair.numbers[other]) / 2


@pytest.mark.parametrize(
    ("share", "grown", "verdict"),
    [(0.3, 1.1, Pair.NOT_SEPARABLE), (0.3, 0.9, Pair.RESOLVED), (0.05, 1.1, Pair.RESOLVED)],
)
def test_members_that_change_places_while_their_misfit_grows_are_not_believed(
    share, grown, verdict
):
    """Sensors of 10 g on an uneven tyre: what is compensated moves the pair it is taken from."""
    pair = fitted(order_frf(1.0, 45.0))
    a, b = pair.share
    before = replace(pair, share=(a + share, b - share), misfit=pair.misfit / grown)
    known = RingOrder(4, (0,), pair, order_report(4, pair), None, True)
    assert settled(known, replace(known, pair=before)).report.pair.verdict is verdict


@pytest.mark.parametrize("angle_deg", [0.0, 90.0])
def test_one_member_is_seen_where_the_force_is_on_a_node_of_the_other(angle_deg):
    pair = fitted(order_frf(1.0, angle_deg))
    seen = true_poles(1.0)[[0 if angle_deg == 0 else 1]]
    report = order_report(4, pair)
    assert report.pair.verdict is Pair.ONE_SEEN
    assert report.frequency_hz == pytest.approx(systems.frequency_hz_of(seen)[0], rel=1e-4)
    assert report.damping_ratio == pytest.approx(ZETA, rel=3e-3)


@pytest.mark.parametrize("seed", range(8))
def test_a_pair_without_a_split_is_not_resolved(seed):
    report = order_report(4, fitted(order_frf(0.0, snr=200, seed=seed)))
    assert report.pair.verdict is not Pair.RESOLVED
    assert abs(report.frequency_hz - HZ) < 4 * report.frequency_std_hz
    assert abs(report.damping_ratio - ZETA) < 4 * report.damping_std


@pytest.mark.parametrize("seed", range(4))
def test_sensors_a_little_out_of_place_do_not_make_a_second_mode(seed):
    report = order_report(4, fitted(order_frf(0.0, snr=1e4, crosstalk=0.004, seed=seed)))
    assert report.pair.verdict is not Pair.RESOLVED
    assert report.damping_ratio == pytest.approx(ZETA, rel=2e-3)


def test_the_error_bars_cover_the_truth():
    true = np.array(
        [systems.frequency_hz_of(true_poles(0.6)), systems.damping_of(true_poles(0.6))]
    ).T.ravel()
    z = []
    for seed in range(40):
        pair = fitted(order_frf(0.6, 40.0, snr=150, seed=seed))
        z.append((pair.numbers[:4] - true) / np.sqrt(np.diag(pair.covariance))[:4])
    inside = np.mean(np.abs(z) < 1.96)
    assert 0.85 < inside <= 1.0
    assert np.max(np.abs(z)) < 5


def test_noise_that_hides_a_split_does_not_make_it_certain():
    """Where noise puts the split along the force near 0, its slope there says that it is known."""
    poles, z = true_poles(0.1), []
    true = np.array([systems.frequency_hz_of(poles), systems.damping_of(poles)]).T.ravel()
    for seed in range(40):
        listed = as_listed(fitted(order_frf(0.1, 45.0, snr=2e3, seed=seed)))
        assert listed.report.pair.verdict is not Pair.RESOLVED
        assert listed.pair is not None
        z.append((listed.pair.numbers[:4] - true) / np.sqrt(np.diag(listed.pair.covariance))[:4])
    assert np.mean(np.abs(z) < 1.96) > 0.9
    assert np.max(np.abs(z)) < 5.5


def test_unknown_noise_does_not_stop_the_fit():
    frf = order_frf(1.5)
    pair = fitted(OrderFrf(4, frf.frequency_hz, frf.values, np.full(frf.std.shape, np.nan)))
    assert np.all(np.abs(relative(pair, true_poles(1.5))) < [2e-4, 1e-2] * 2)


def test_too_few_lines_give_no_pair_and_a_verdict():
    frf = order_frf(1.0)
    few = OrderFrf(4, frf.frequency_hz[:10], frf.values[:, :10], frf.std[:, :10])
    assert fitted(few) is None
    assert order_report(4, None).pair.verdict is Pair.NOT_SEPARABLE


def test_damping_whose_axes_are_not_those_of_the_stiffness():
    """Two degrees of freedom with any symmetric K and D: complex modes, the poles known exactly."""
    omega, decay = 2 * np.pi * HZ, 2 * np.pi * HZ * ZETA
    stiffness = omega**2 * (np.eye(2) + 0.004 * np.array([[0.6, 0.8], [0.8, -0.6]]))
    damping = 2 * decay * (np.eye(2) + 0.02 * np.array([[-0.3, 0.9], [0.9, 0.3]]))
    state = np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -damping]])
    true = np.linalg.eigvals(state)
    true = true[true.imag > 0][np.argsort(np.abs(true[true.imag > 0]))]
    s = 2j * np.pi * LINES_HZ[:, None, None]
    receptance = np.linalg.inv(stiffness + s * damping + s**2 * np.eye(2))
    clean = (s[:, 0, 0] ** 2 * receptance[:, :, 0].T).astype(complex)
    std = np.abs(clean).max() / 1e4
    rng = np.random.default_rng(1)
    noise = std * (rng.standard_normal(clean.shape) + 1j * rng.standard_normal(clean.shape))
    pair = fitted(OrderFrf(4, LINES_HZ, clean + noise, np.full(clean.shape, std)))
    error = (
        pair.numbers[:4] / np.array([[abs(p) / 2 / np.pi, -p.real / abs(p)] for p in true]).ravel()
    )
    assert np.all(np.abs(error - 1) < [3e-4, 1e-2] * 2)
