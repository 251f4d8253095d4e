"""Inertance of the damped ring against the paper, limits and symmetries."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import find_peaks

from model import (
    ForcedRing,
    ParameterError,
    RingDamping,
    Wheel,
    damping_ratios,
    displacement_ratio,
    inertance,
    inextensional_inertance,
    modal_mass_kg,
    natural_frequencies_hz,
)
from model.parameters import REFITTED_DAMPING, TABLE_4_RING, TABLE_5_DAMPING

SPEED = 67.3
AT_100_DEG = np.deg2rad(100.0)
FREQUENCY = np.arange(30.0, 305.0, 0.1)
FORCED = ForcedRing(TABLE_4_RING, TABLE_5_DAMPING)
ROLLING = replace(FORCED, speed_rad_s=SPEED)
PEAKS_AT_REST = (
    [75.4, 103.8, 116.4, 148.6, 168.1, 222.6, 283.8],
    [0.041, 0.253, 0.233, 0.305, 0.339, 0.489, 0.590],
)
PEAKS_ROLLING = (
    [68.7, 93.7, 119.4, 144.1, 175.5, 200.5, 233.9, 258.2, 299.6],
    [0.082, 0.134, 0.280, 0.165, 0.389, 0.240, 0.507, 0.284, 0.584],
)


def peaks(forced):
    size = np.abs(inertance(forced, FREQUENCY, AT_100_DEG, per_width=True))
    found = find_peaks(size)[0]
    return FREQUENCY[found], size[found]


@pytest.mark.parametrize(
    ("forced", "expected"), [(FORCED, PEAKS_AT_REST), (ROLLING, PEAKS_ROLLING)]
)
def test_peaks_at_100_degrees_with_table_5(forced, expected):
    frequency, size = peaks(forced)
    np.testing.assert_allclose(frequency, expected[0], atol=0.11)
    np.testing.assert_allclose(size, expected[1], atol=6e-4)


def test_refitted_damping_shows_the_split_pairs_at_80_km_h():
    frequency, _ = peaks(replace(ROLLING, damping=REFITTED_DAMPING))
    for pair in (84.6, 93.4, 118.2, 130.0, 145.1, 158.5, 173.2, 180.1):
        assert np.abs(frequency - pair).min() < 0.11


@pytest.mark.parametrize("damping", [TABLE_5_DAMPING, REFITTED_DAMPING])
@pytest.mark.parametrize("speed", [0.0, SPEED])
def test_inextensional_form_is_close_to_the_exact_one(damping, speed):
    forced = ForcedRing(TABLE_4_RING, damping, speed)
    exact = inertance(forced, FREQUENCY, AT_100_DEG)
    close = inextensional_inertance(forced, FREQUENCY, AT_100_DEG)
    misfit = np.abs(exact - close).max() / np.abs(exact).max()
    assert 1e-3 < misfit < 0.0171


def test_inextensional_form_is_the_limit_of_a_stiff_belt():
    stiff = replace(TABLE_4_RING, axial_stiffness_n_m=2.52e12, inflation_pressure_pa=2.2e5)
    forced = ForcedRing(stiff, RingDamping(700.0, 800.0, 0.0), SPEED)
    exact = inertance(forced, FREQUENCY, AT_100_DEG)
    close = inextensional_inertance(forced, FREQUENCY, AT_100_DEG)
    np.testing.assert_allclose(close, exact, rtol=0, atol=1e-4 * np.abs(exact).max())


@pytest.mark.parametrize(
    ("angle", "highest", "error"),
    [(AT_100_DEG, 30, 8e-4), (AT_100_DEG, 50, 1e-4), (0.0, 50, 0.0136), (0.0, 100, 0.002)],
)
def test_sum_over_harmonics_converges(angle, highest, error):
    full = inertance(replace(FORCED, highest_order=800), FREQUENCY, angle)
    cut = inertance(replace(FORCED, highest_order=highest), FREQUENCY, angle)
    assert np.abs(cut - full).max() / np.abs(full).max() == pytest.approx(error, rel=0.05)


@given(
    angle=st.floats(0.0, 2 * np.pi),
    force=st.floats(0.0, 2 * np.pi),
    speed=st.floats(0.0, 200.0),
    frame=st.sampled_from(["rotating", "absolute"]),
)
def test_mirrored_ring_turns_the_other_way(angle, force, speed, frame):
    """H(θ, Ω) = H(−θ, −Ω)."""
    forced = ForcedRing(TABLE_4_RING, REFITTED_DAMPING, speed, highest_order=30, frame=frame)
    lines = [40.0, 100.0, 250.0]
    left = inertance(forced, lines, angle, force)
    right = inertance(replace(forced, speed_rad_s=-speed), lines, -angle, -force)
    np.testing.assert_allclose(left, right, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("pair", [("radial", "circumferential"), ("circumferential", "radial")])
def test_reciprocity_at_rest(pair):
    there = inertance(
        FORCED, FREQUENCY, 1.2, 0.3, response_direction=pair[0], force_direction=pair[1]
    )
    back = inertance(
        FORCED, FREQUENCY, 0.3, 1.2, response_direction=pair[1], force_direction=pair[0]
    )
    np.testing.assert_allclose(there, back, rtol=1e-9, atol=1e-12)


def test_frames_agree_at_rest_and_on_the_modes_seen_from_space():
    still = replace(FORCED, frame="absolute")
    np.testing.assert_allclose(
        inertance(still, FREQUENCY, 1.0), inertance(FORCED, FREQUENCY, 1.0), rtol=1e-9
    )
    light = ForcedRing(
        TABLE_4_RING, RingDamping(30.0, 30.0, 0.0), SPEED, frame="absolute", highest_order=40
    )
    size = np.abs(inertance(light, np.arange(60.0, 120.0, 0.02), 2.0))
    found = np.arange(60.0, 120.0, 0.02)[find_peaks(size)[0]]
    shifted = 110.13074 - 2 * SPEED / (2 * np.pi)  # order 2, regressive, seen from space
    assert np.abs(found - shifted).min() < 0.1


@pytest.mark.parametrize("order", [1, 2, 4])
def test_near_a_resonance_one_mode_with_the_modal_mass_answers(order):
    damping = RingDamping(5.0, 5.0, 0.0)
    forced = ForcedRing(TABLE_4_RING, damping)
    natural = float(natural_frequencies_hz(TABLE_4_RING, order))
    ratio = float(damping_ratios(TABLE_4_RING, damping, order))
    peak = inertance(forced, natural, 0.0)[0]
    alone = 1j / (2.0 * ratio * float(modal_mass_kg(TABLE_4_RING, order)))
    assert abs(peak - alone) < 0.02 * abs(alone)


def test_circumferential_response_follows_the_mode():
    """At the resonance of order n: |u_θ| at its antinode over |u_r| at its own is B_n."""
    forced = ForcedRing(TABLE_4_RING, RingDamping(2.0, 2.0, 0.0))
    natural = float(natural_frequencies_hz(TABLE_4_RING, 3))
    radial = inertance(forced, natural, 0.0)[0]
    around = inertance(forced, natural, np.pi / 6, response_direction="circumferential")[0]
    ratio = -around / radial
    assert ratio.real == pytest.approx(float(displacement_ratio(TABLE_4_RING, 3)), rel=0.02)


def test_below_all_modes_the_static_compliance_remains():
    forced = ForcedRing(TABLE_4_RING, RingDamping(0.0, 0.0, 0.0), highest_order=400)
    low = 1e-3
    compliance = -inertance(forced, low, 0.0)[0].real / (2 * np.pi * low) ** 2
    terms = forced.terms(forced.orders)
    static = (terms.m22 / terms.determinant).real.sum()
    width = 2 * np.pi * 0.33 * 0.19
    assert compliance == pytest.approx(static / width, rel=1e-6)


def test_shapes_and_units():
    angles = np.linspace(0, 1, 3)
    table = inertance(FORCED, FREQUENCY[:5], angles)
    assert table.shape == (3, 5)
    np.testing.assert_allclose(inertance(FORCED, FREQUENCY[:5], angles[1]), table[1])
    per_width = inertance(FORCED, FREQUENCY[:5], angles, per_width=True)
    np.testing.assert_allclose(per_width, 0.19 * table)


NO_WIDTH = ForcedRing(replace(TABLE_4_RING, belt_width_m=None), TABLE_5_DAMPING)


@pytest.mark.parametrize(
    ("call", "where"),
    [
        (lambda: inertance(NO_WIDTH, 50.0, 0.0), "belt_width_m"),
        (lambda: inertance(FORCED, np.nan, 0.0), "frequency_hz"),
        (lambda: inertance(FORCED, 50.0, 0.0, force_direction="up"), "force_direction"),
        (lambda: replace(FORCED, highest_order=0), "highest_order"),
        (lambda: replace(FORCED, frame="moon"), "frame"),
        (
            lambda: inextensional_inertance(replace(FORCED, wheel=Wheel(12.0, 0.6)), 50.0, 0.0),
            "wheel",
        ),
    ],
)
def test_refusals(call, where):
    with pytest.raises(ParameterError, match=f"^{where}:"):
        call()
