"""Responses at one of several forces to another against the reverse: what differs is named."""

from dataclasses import replace

import numpy as np
import pytest

from ema.checks.quality import _at, compared, reciprocity_findings
from ema.core.frf import FRF
from pipelines.simulate.truth import modal_sum, truth_modes

BAND_HZ = (30.0, 260.0)
LINES = np.arange(20.0, 300.0, 0.25)
ANGLES = np.arange(0.0, 360.0, 5.0)
MODES = truth_modes(split_percent=1.0)


def frf_of(force_deg, stated_deg=None, shift=0.0, gain=1.0, seed=0, noise=0.01):
    modes = tuple(replace(m, frequency_hz=m.frequency_hz * (1 + shift)) for m in MODES)
    system = modal_sum(modes, ANGLES, force_deg)
    exact = np.array([system.inertance(k, 2 * np.pi * LINES) for k in range(ANGLES.size)])
    std = noise * np.sqrt(np.mean(np.abs(exact) ** 2))
    random = np.random.default_rng([seed, int(force_deg)])
    error = random.normal(0, std, (2, *exact.shape))
    return FRF(
        frequency_hz=LINES,
        values=gain * (exact + error[0] + 1j * error[1]),
        coherence=np.ones(exact.shape),
        std=np.full(exact.shape, gain * std),
        node=np.arange(ANGLES.size),
        position_deg=ANGLES,
        run=("a",) * ANGLES.size,
        excitation_deg=force_deg if stated_deg is None else stated_deg,
    )


@pytest.mark.parametrize("second_deg", [20.0, 13.0])  # at a position, and between two
def test_forces_on_the_same_tyre_agree_within_their_error_bars(second_deg):
    found = []
    for seed in range(20):
        one, other = frf_of(0.0, seed=seed), frf_of(second_deg, seed=seed)
        assert all(each.is_ok for each in reciprocity_findings((one, other), BAND_HZ))
        seen = compared(LINES, _at(one, other), _at(other, one), BAND_HZ)
        found.append(((seen.gain - 1) / seen.gain_std, seen.shift / seen.shift_std))
    assert np.sqrt(np.mean(np.square(found), axis=0)) == pytest.approx([1.0, 1.0], abs=0.45)


@pytest.mark.parametrize("shift", [0.002, -0.005, 0.02, -0.025])
def test_a_shift_of_all_frequencies_is_measured_and_named(shift):
    one, other = frf_of(0.0), frf_of(13.0, shift=shift)
    far = abs(shift) > 0.01
    seen = compared(LINES, _at(one, other), _at(other, one), BAND_HZ, far=far)
    assert seen.shift == pytest.approx(shift, rel=0.1)
    (finding,) = reciprocity_findings((one, other), BAND_HZ)
    assert not finding.is_ok and f"{100 * seen.shift:+.2f} %" in finding.detail


def test_a_gain_and_a_wrong_place_are_named():
    one = frf_of(0.0)
    gained = frf_of(13.0, gain=1.4)
    seen = compared(LINES, _at(one, gained), _at(gained, one), BAND_HZ)
    assert seen.gain == pytest.approx(1.4, abs=0.01)
    assert seen.unexplained < 0.01
    (finding,) = reciprocity_findings((one, gained), BAND_HZ)
    assert not finding.is_ok
    misplaced = frf_of(13.0, stated_deg=17.0)
    seen = compared(LINES, _at(one, misplaced), _at(misplaced, one), BAND_HZ)
    assert seen.unexplained > 0.05
    (finding,) = reciprocity_findings((one, misplaced), BAND_HZ)
    assert not finding.is_ok


def test_noise_of_unknown_size_is_no_contradiction():
    nothing = np.full((ANGLES.size, LINES.size), np.nan)
    pair = tuple(replace(frf_of(angle, noise=0.3), std=nothing) for angle in (0.0, 20.0))
    assert all(each.is_ok for each in reciprocity_findings(pair, BAND_HZ))


def test_a_structure_is_compared_at_its_nodes():
    one, other = (
        replace(frf_of(angle), excitation_deg=np.nan, force_node=node)
        for angle, node in ((0.0, 72), (20.0, 4))
    )
    assert reciprocity_findings((one, other), BAND_HZ) == []  # no sensor at node 72
    one, other = (
        replace(each, node=np.where(each.node == 0, 72, each.node)) for each in (one, other)
    )
    (finding,) = reciprocity_findings((one, other), BAND_HZ)
    assert finding.is_ok
