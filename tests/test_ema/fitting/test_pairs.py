"""One mode of a pair or both: the verdict on FRFs of one order with a known answer."""

from dataclasses import replace

import numpy as np
import pytest
import systems
from hypothesis import given, settings
from hypothesis import strategies as st

from ema.core.modes import Pair
from ema.fitting.mode_pairs import OrderFrf, judge_pair

LINES_HZ = np.arange(200, 400) / 2
HZ, ZETA = 145.45, 0.022


def order_frf(split_percent, place_deg=45.0, *, snr=300.0, seed=0):
    """A pair with the shaker at an angle n·ψ from the antinode of its lower member."""
    poles = true_poles(split_percent)
    cosine, sine = np.cos(np.deg2rad(place_deg)), np.sin(np.deg2rad(place_deg))
    amplitudes = systems.residue(poles) * np.array(
        [[cosine**2, sine**2], [cosine * sine, -cosine * sine]]
    )
    clean = systems.inertance(LINES_HZ, poles, amplitudes)
    std = np.abs(clean).max() / snr
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((2, *clean.shape))
    values = clean + std * (noise[0] + 1j * noise[1])
    return OrderFrf(4, LINES_HZ, values, np.full(clean.shape, std))


def true_poles(split_percent):
    return systems.pole(HZ * (1 + np.array([-1, 1]) * split_percent / 200), [ZETA, ZETA])


def one_pole():
    return systems.pole([HZ], [ZETA])


@pytest.mark.parametrize("place_deg", [20, 45, 70])
@pytest.mark.parametrize("split_percent", [1.5, 2.5, 4.0])
def test_a_driven_pair_is_resolved_from_a_single_pole(split_percent, place_deg):
    verdict, poles = judge_pair(order_frf(split_percent, place_deg), one_pole(), 1.0)
    assert verdict.verdict == Pair.RESOLVED
    assert verdict.chance < 1e-4
    true = true_poles(split_percent)
    np.testing.assert_allclose(
        systems.frequency_hz_of(poles), systems.frequency_hz_of(true), rtol=2e-3
    )
    np.testing.assert_allclose(systems.damping_of(poles), ZETA, rtol=0.1)


def test_two_poles_found_before_are_kept_apart():
    verdict, poles = judge_pair(order_frf(2.5), true_poles(2.4)[::-1], 1.0)
    assert verdict.verdict == Pair.RESOLVED
    assert np.all(np.diff(np.abs(poles)) > 0)


@settings(max_examples=20)
@given(st.integers(0, 10_000))
def test_noise_is_not_taken_for_a_second_mode(seed):
    verdict, poles = judge_pair(order_frf(0.0, 0.0, snr=100, seed=seed), one_pole(), 1.0)
    assert verdict.verdict == Pair.ONE_SEEN
    assert poles.size == 1
    np.testing.assert_allclose(poles, one_pole(), rtol=2e-3)


def test_a_pair_that_is_not_driven_is_not_resolvable():
    verdict, poles = judge_pair(order_frf(2.5, 0.0), one_pole(), 1.0)
    assert (verdict.verdict, poles.size) == (Pair.ONE_SEEN, 1)
    np.testing.assert_allclose(systems.frequency_hz_of(poles), HZ * (1 - 0.0125), rtol=1e-4)


def test_two_poles_where_one_explains_everything_become_one():
    verdict, poles = judge_pair(order_frf(0.0, snr=100), true_poles(1.0), 1.0)
    assert (verdict.verdict, poles.size) == (Pair.ONE_SEEN, 1)
    assert "one pole explains the order" in verdict.evidence
    assert systems.damping_of(poles)[0] == pytest.approx(ZETA, rel=0.02)


def test_a_split_far_below_the_noise_does_not_inflate_damping():
    verdict, poles = judge_pair(order_frf(0.1, snr=50), one_pole(), 1.0)
    assert verdict.verdict == Pair.ONE_SEEN
    assert systems.damping_of(poles)[0] == pytest.approx(ZETA, rel=0.02)


def test_correlated_lines_count_as_fewer():
    frf = order_frf(0.6, snr=60)
    alone = judge_pair(frf, one_pole(), 1.0)[0].chance
    together = judge_pair(frf, one_pole(), 2.0)[0].chance
    assert alone < together


def test_the_clearer_the_split_the_smaller_the_chance():
    chances = [judge_pair(order_frf(s, snr=60), one_pole(), 1.0)[0].chance for s in (0.2, 0.5, 1.0)]
    assert np.all(np.diff(chances) < 0)


@pytest.mark.parametrize(("poles", "verdict"), [(1, Pair.NOT_SEPARABLE), (2, Pair.RESOLVED)])
def test_with_unknown_noise_nothing_is_tested(poles, verdict):
    frf = order_frf(2.5)
    frf = replace(frf, std=np.full(frf.std.shape, np.nan))
    given_poles = one_pole() if poles == 1 else true_poles(2.5)
    judged, kept = judge_pair(frf, given_poles, 1.0)
    assert judged.verdict == verdict
    assert np.isnan(judged.chance)
    np.testing.assert_array_equal(kept, given_poles)


def test_too_few_lines_leave_the_verdict_open():
    frf = order_frf(2.5)
    few = OrderFrf(4, frf.frequency_hz[:10], frf.values[:, :10], frf.std[:, :10])
    verdict, poles = judge_pair(few, one_pole(), 1.0)
    assert verdict.verdict == Pair.NOT_SEPARABLE
    assert "lines around order 4" in verdict.evidence
    np.testing.assert_array_equal(poles, one_pole())
