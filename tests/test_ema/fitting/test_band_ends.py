"""Sensitivity to the band's ends: nothing where the model is complete, much where it is not."""

from dataclasses import replace

import numpy as np
import pytest
import systems

from ema.core.settings import IDENTIFICATION
from ema.fitting.covariance import band_shift
from ema.fitting.pole_fit import N_DRIFT, Lines, evaluate, fit_bounded, lines_to_fit, with_stand_ins
from ema.identify import fit_modes
from ema.poles.tracking import PoleSelection

LINES_HZ = np.arange(80, 520) / 2
POLES = systems.pole(systems.TABLE_3_HZ, systems.TABLE_3_DAMPING)
STAND_INS = systems.pole([270.0, 285.0], [0.02, 0.02])


def fit_of(poles):
    """A fit at given poles, followed by the two stand-ins."""
    values = systems.inertance(LINES_HZ, POLES, systems.tyre_residues(np.arange(12) * 30.0, POLES))
    ones = np.ones(LINES_HZ.size)
    lines = Lines(LINES_HZ, values, ones, np.ones(12), np.zeros(12, dtype=int), ones)
    return evaluate(lines, np.append(poles, STAND_INS), np.zeros((1, N_DRIFT)))


def refit_that(moves):
    """A refit that moves poles by what `moves` says of the lines it gets."""

    def refit(lines, poles):
        return evaluate(lines, np.append(poles * moves(lines), STAND_INS), np.zeros((1, N_DRIFT)))

    return refit


def test_poles_that_stay_have_no_shift():
    shift = band_shift(fit_of(POLES), refit_that(lambda lines: 1.0))
    np.testing.assert_allclose(shift[:7], 0, atol=1e-12)
    assert shift.shape == (9, 2)


def test_each_end_is_trimmed_once_and_the_larger_change_counts():
    seen = []

    def moves(lines):
        seen.append((lines.frequency_hz[0], lines.frequency_hz[-1]))
        return 1.001 if lines.frequency_hz[0] > LINES_HZ[0] else 0.997

    shift = band_shift(fit_of(POLES), refit_that(moves))
    low, high = LINES_HZ[[0, -1]]
    assert seen == [(low + 13, high), (low, high - 13)]
    np.testing.assert_allclose(shift[:7, 0], 0.003 * systems.TABLE_3_HZ, rtol=1e-6)
    np.testing.assert_allclose(shift[:7, 1], 0, atol=1e-12)


def test_a_change_of_damping_is_told_beside_that_of_frequency():
    moved = systems.pole(systems.TABLE_3_HZ, 1.1 * systems.TABLE_3_DAMPING) / POLES
    shift = band_shift(fit_of(POLES), refit_that(lambda lines: moved))
    np.testing.assert_allclose(shift[:7, 0], 0, atol=1e-9)
    np.testing.assert_allclose(shift[:7, 1], 0.1 * systems.TABLE_3_DAMPING, rtol=1e-6)


def test_a_pole_beyond_both_trimmed_bands_has_no_verdict():
    outside = systems.pole([20.0], [0.02])
    shift = band_shift(fit_of(np.append(outside, POLES)), refit_that(lambda lines: 1.0))
    assert np.all(np.isnan(shift[0]))
    assert np.all(np.isfinite(shift[1:8]))


def test_a_pole_near_one_end_is_judged_by_the_other():
    near = systems.pole([45.0], [0.01])
    shift = band_shift(fit_of(np.append(near, POLES)), refit_that(lambda lines: 1.0))
    np.testing.assert_allclose(shift[0], 0, atol=1e-12)


def frf_of(poles, snr_db):
    frf = systems.tyre_frf(snr_db, positions=24, frequency_hz=LINES_HZ)
    clean = systems.inertance(LINES_HZ, poles, systems.tyre_residues(frf.position_deg, poles))
    full = systems.inertance(
        LINES_HZ, systems.table_3_poles(), systems.tyre_residues(frf.position_deg)
    )
    return replace(frf, values=frf.values - full + clean)


def test_a_complete_model_does_not_care_where_the_band_ends():
    selection = PoleSelection(POLES * 1.001, (50.0, 240.0))
    for mode in fit_modes(frf_of(POLES, 60), selection).modes:
        assert mode.frequency_band_shift_hz < 1e-4 * mode.frequency_hz
        assert mode.damping_band_shift < 2e-3 * mode.damping_ratio


def test_a_mode_that_the_model_lacks_shows_as_sensitivity():
    """Order 1 lies among the lines below the band; order 2 depends on how many of them are used."""
    lacking = PoleSelection(POLES[1:], (88.0, 240.0), pinned=True)
    complete = PoleSelection(POLES, (88.0, 240.0), pinned=True)
    shifts = [
        fit_modes(frf_of(POLES, 60), poles).modes[0].frequency_band_shift_hz
        for poles in (lacking, complete)
    ]
    assert shifts[0] > 20 * shifts[1]


@pytest.mark.parametrize("snr_db", [40, 15])
def test_on_a_measurement_the_shift_stays_within_the_noise(snr_db):
    frf = systems.tyre_frf(snr_db, averages=30)
    model = fit_modes(frf, PoleSelection(systems.table_3_poles()[:9], (20.0, 260.0)))
    for mode in model.modes[1:7]:
        assert mode.frequency_band_shift_hz < 2 * mode.frequency_std_hz
        assert mode.damping_band_shift < 2 * mode.damping_std


def test_a_pole_broader_than_its_frequency_keeps_a_positive_one():
    """Its bounds once reached below zero, and the next fit had none to search in."""
    lines = lines_to_fit(frf_of(POLES, 40), (42.0, 250.0))
    poles = with_stand_ins(np.append(-300 + 5j, POLES), lines)
    for _ in range(2):
        poles = fit_bounded(lines, poles, IDENTIFICATION).poles
        assert np.all(poles.imag > 0)
