"""The curve fit: its error bars against Monte Carlo, its guards, bounds and refusals."""

from dataclasses import replace

import numpy as np
import pytest
import systems

from ema.core.errors import FitError
from ema.core.recording import BlockPlan
from ema.core.settings import IDENTIFICATION
from ema.fitting.curve_fit import curve_fit
from ema.identify import fit_modes
from ema.poles.stability import build_stability, select_poles
from ema.poles.tracking import PoleSelection

REALISATIONS = 60
# Small, so that it fits fast: three modes in the band and one above it, where a mode may stand in
# for everything higher up. The model can be exact, and noise is all that it leaves over.
LINES_HZ = np.arange(45.0, 151.0)
BAND_HZ = (60.0, 140.0)
TRUE_HZ = np.array([70.0, 100.0, 125.0])
TRUE_DAMPING = np.array([0.04, 0.03, 0.02])
POLES = systems.pole(np.append(TRUE_HZ, 170.0), np.append(TRUE_DAMPING, 0.02))
RESIDUES = np.random.default_rng(1).standard_normal((6, 4)) * systems.residue(POLES)
SELECTION = PoleSelection(POLES[:3], BAND_HZ)
NO_WINDOW = BlockPlan(1000.0, 1000, 1000, 1, "boxcar")


def noisy_frf(seed, std=0.01):
    clean = systems.inertance(LINES_HZ, POLES, RESIDUES)
    noise = np.random.default_rng(seed).standard_normal((*clean.shape, 2)) @ [1, 1j]
    known = {"std": np.full(clean.shape, std), "coherence": np.ones(clean.shape)}
    return systems.noise_free_frf(LINES_HZ, clean + std * noise, blocks=NO_WINDOW, **known)


@pytest.fixture(scope="module")
def fits():
    """The same FRFs with fresh noise, again and again."""
    return [fit_modes(noisy_frf(seed), SELECTION) for seed in range(REALISATIONS)]


def spread(z):
    """RMS of deviations over their own claimed σ; 1 for honest error bars."""
    return float(np.sqrt(np.mean(np.square(z))))


def test_frequencies_scatter_as_their_error_bars_say(fits):
    found = np.array([fit.frequencies_hz for fit in fits])
    std = np.array([[mode.frequency_std_hz for mode in fit.modes] for fit in fits])
    assert 0.8 < spread((found - TRUE_HZ) / std) < 1.25


def test_damping_ratios_scatter_as_their_error_bars_say(fits):
    found = np.array([fit.damping_ratios for fit in fits])
    std = np.array([[mode.damping_std for mode in fit.modes] for fit in fits])
    assert 0.8 < spread((found - TRUE_DAMPING) / std) < 1.25


def test_residues_scatter_as_their_error_bars_say(fits):
    found = np.array([[mode.residues for mode in fit.modes] for fit in fits])
    std = np.array([[mode.residues_std for mode in fit.modes] for fit in fits])
    error = found - RESIDUES[:, :3].T
    assert 0.8 < spread(np.stack([error.real, error.imag]) / std) < 1.25


def test_the_covariance_holds_the_error_bars_and_how_modes_share_errors(fits):
    std = [(mode.frequency_std_hz, mode.damping_std) for mode in fits[0].modes]
    np.testing.assert_allclose(np.sqrt(np.diag(fits[0].covariance)), np.ravel(std))
    claimed = np.mean([fit.covariance for fit in fits], axis=0)
    found = [np.ravel(np.column_stack([f.frequencies_hz, f.damping_ratios])) for f in fits]
    seen = np.cov(np.array(found).T)
    size = np.sqrt(np.diag(claimed))
    difference = (seen - claimed) / np.outer(size, size)
    assert np.sqrt(np.mean(difference**2)) < 1.5 / np.sqrt(REALISATIONS)


def test_the_misfit_is_one_where_noise_is_all_that_is_left(fits):
    assert np.mean([fit.misfit for fit in fits]) == pytest.approx(1, abs=0.05)


def test_error_bars_shrink_with_the_noise():
    loud, quiet = (
        np.mean([mode.damping_std for mode in fit_modes(noisy_frf(1, std), SELECTION).modes])
        for std in (0.01, 0.001)
    )
    assert loud / quiet == pytest.approx(10, rel=0.1)


def test_modes_beyond_the_band_guard_its_ends():
    frf = systems.tyre_frf(snr_db=40)
    model = fit_modes(frf, select_poles(build_stability(frf, (20, 240))))
    assert len(model.modes) == 7
    assert any(abs(mode.frequency_hz - 253.1) < 1 for mode in model.guard_modes)
    np.testing.assert_allclose(model.frequencies_hz, systems.TABLE_3_HZ, rtol=2e-4)
    np.testing.assert_allclose(model.damping_ratios, systems.TABLE_3_DAMPING, rtol=1e-2)


@pytest.mark.parametrize("snr_db", [40, 10])
def test_table_3_comes_back_from_noisy_frfs(snr_db):
    """0.02 % in frequency and 1 % in damping over the whole band."""
    frf = systems.tyre_frf(snr_db=snr_db, seed=3)
    model = fit_modes(frf, select_poles(build_stability(frf, (20, 260))))
    np.testing.assert_allclose(model.frequencies_hz[:7], systems.TABLE_3_HZ, rtol=2e-4)
    np.testing.assert_allclose(model.damping_ratios[:7], systems.TABLE_3_DAMPING, rtol=1e-2)


def test_synthesis_from_the_modes_is_what_was_measured():
    frf = systems.tyre_frf(snr_db=40, positions=12)
    model = fit_modes(frf, select_poles(build_stability(frf, (20, 260))))
    low, high = model.fit_band_hz
    lines = (frf.frequency_hz >= low) & (frf.frequency_hz <= high)
    synthesised = model.synthesise(frf.frequency_hz[lines])
    error = np.linalg.norm(synthesised - frf.values[:, lines]) / np.linalg.norm(synthesised)
    assert error < 0.01
    assert np.all(model.frac > 0.999)


def test_the_start_may_be_off_without_changing_the_answer():
    frf = noisy_frf(2)
    moved = PoleSelection(SELECTION.poles * (1.003 + 0.004j), BAND_HZ)
    expected, found = fit_modes(frf, SELECTION), fit_modes(frf, moved)
    np.testing.assert_allclose(found.frequencies_hz, expected.frequencies_hz, rtol=1e-6)
    np.testing.assert_allclose(found.damping_ratios, expected.damping_ratios, rtol=1e-4)


def test_scaling_the_frfs_scales_the_residues_alone():
    frf = noisy_frf(2)
    doubled = replace(frf, values=2 * frf.values, std=2 * frf.std)
    expected, found = fit_modes(frf, SELECTION), fit_modes(doubled, SELECTION)
    np.testing.assert_allclose(found.frequencies_hz, expected.frequencies_hz, rtol=1e-7)
    for one, two in zip(expected.modes, found.modes, strict=True):
        np.testing.assert_allclose(two.residues, 2 * one.residues, rtol=1e-4)


def test_a_pole_held_back_by_its_bounds_says_so():
    """Damping may move by a factor of 4; started ten times too low, it ends on the bound."""
    low = POLES[:3].copy()
    low[1] = systems.pole(TRUE_HZ[1], TRUE_DAMPING[1] / 10)
    model = fit_modes(noisy_frf(1), PoleSelection(low, BAND_HZ, pinned=True))
    assert [mode.status == "at bound" for mode in model.modes] == [False, True, False]
    assert [mode.status for mode in fit_modes(noisy_frf(1), SELECTION).modes] == ["ok"] * 3


def test_bare_poles_are_enough_to_start_from():
    """The band then reaches 20 % beyond them."""
    frf = systems.tyre_frf(snr_db=40, positions=24)
    model = fit_modes(frf, systems.table_3_poles()[:8])
    assert model.band_hz == pytest.approx((0.8 * 78.73, 1.2 * 253.1))
    np.testing.assert_allclose(model.frequencies_hz[:7], systems.TABLE_3_HZ, rtol=1e-3)


def test_no_pole_in_the_band_is_refused():
    with pytest.raises(FitError, match="no pole between 200 and 240 Hz"):
        fit_modes(systems.tyre_frf(), PoleSelection(systems.table_3_poles()[:2], (200, 240)))


def test_orders_are_labelled():
    frf = systems.tyre_frf(snr_db=20)
    model = fit_modes(frf, select_poles(build_stability(frf, (40, 240))))
    assert [mode.order for mode in model.modes] == [1, 2, 3, 4, 5, 6, 7]
    assert min(mode.order_purity for mode in model.modes) > 0.98


def test_a_drift_over_the_runs_is_found_with_its_error_bar():
    """Modes are those of the first run's state; one fit for all would broaden them."""
    frf = systems.drifting_frf(percent_per_run=0.05)
    model = fit_modes(frf, select_poles(build_stability(frf, (20, 260))))
    assert model.drift.run == tuple(f"run_{number}" for number in range(6))
    error = model.drift.percent - 0.05 * np.arange(6)
    assert np.all(np.abs(error[1:]) < 4 * model.drift.std_percent[1:])
    assert np.max(np.abs(error)) < 0.01
    np.testing.assert_allclose(model.frequencies_hz[:7], systems.TABLE_3_HZ, rtol=2e-4)
    np.testing.assert_allclose(model.damping_ratios[:7], systems.TABLE_3_DAMPING, rtol=1e-2)


def test_runs_in_one_state_show_no_drift():
    frf = systems.drifting_frf(percent_per_run=0.0)
    drift = fit_modes(frf, select_poles(build_stability(frf, (20, 260)))).drift
    assert not drift.applied
    assert np.all(np.abs(drift.percent[1:]) < 4 * drift.std_percent[1:])


def test_a_pole_is_found_again_where_its_order_shows_it():
    """Order 1 at 55 Hz was started beneath order 2, at 70 Hz, and stayed there."""
    poles = systems.pole([55.0, 75.8, 94.7, 116.5], [0.058, 0.040, 0.035, 0.032])
    angles = np.arange(72) * 5.0
    lines_hz = np.arange(20, 600) / 4
    values = systems.inertance(lines_hz, poles, systems.tyre_residues(angles, poles))
    noise = np.random.default_rng(0).standard_normal((*values.shape, 2)) @ [1, 1j]
    std = 0.1 * np.sqrt(np.mean(np.abs(values) ** 2))
    frf = systems.noise_free_frf(lines_hz, values + std * noise, position_deg=angles)
    frf = replace(frf, std=np.full(values.shape, std))
    fit = curve_fit(frf, PoleSelection(poles[1:], (20.0, 140.0)), (20.0, 140.0), IDENTIFICATION)
    found = systems.frequency_hz_of(fit.fit.poles)
    assert np.min(np.abs(found - 55.0)) < 0.5
