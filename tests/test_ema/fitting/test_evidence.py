"""Structures without a circle: as many modes as the data carry, and ± that hold."""

from dataclasses import replace

import numpy as np
import pytest
import systems

from ema.core.modes import Mode
from ema.core.settings import IDENTIFICATION
from ema.fitting.curve_fit import without_last_peaks
from ema.fitting.evidence import (
    is_below_misfit,
    is_beneath,
    is_no_mode,
    scatter_over_positions,
    stands_out,
    visible_share,
)
from ema.fitting.fit_steps import is_undetermined, shift_beside
from ema.fitting.pole_fit import N_DRIFT, Lines, evaluate
from ema.identify import fit_modes, identify_modes
from ema.poles.tracking import PoleSelection

LINES_HZ = np.arange(1, 600) / 4
BAND_HZ = (20.0, 130.0)
TRUE_HZ = np.array([40.0, 42.0, 75.0, 110.0])
POLES = systems.pole(TRUE_HZ, np.array([0.015, 0.012, 0.01, 0.02]))
STAND_INS = systems.pole([160.0, 170.0], [0.02, 0.02])
SHAPES = np.sin(np.outer(np.arange(1, 13), np.arange(1, 5)) * 0.4)
RESIDUES = SHAPES * systems.residue(POLES)


def frf_of(values, snr_db, seed=0):
    """FRFs with white noise of unknown level."""
    rng = np.random.default_rng(seed)
    level = np.sqrt(np.mean(np.abs(values) ** 2)) * 10 ** (-snr_db / 20)
    noise = rng.standard_normal((*values.shape, 2)) @ [1, 1j] * level / np.sqrt(2)
    return systems.noise_free_frf(LINES_HZ, values + noise)


def found_hz(frf, band_hz=BAND_HZ):
    return np.array([mode.frequency_hz for mode in identify_modes(frf, band_hz).model.modes])


@pytest.mark.parametrize("snr_db", [60, 40, 25])
def test_close_and_weak_modes_of_a_structure_are_all_found(snr_db):
    frf = frf_of(systems.inertance(LINES_HZ, POLES, RESIDUES), snr_db)
    np.testing.assert_allclose(found_hz(frf), TRUE_HZ, rtol=2e-3)


def test_sensors_that_saw_other_states_do_not_double_the_modes():
    """Roving: each position was measured with the structure a little stiffer or softer."""
    state = 1 + 3e-4 * np.random.default_rng(2).standard_normal(12)
    rows = [systems.inertance(LINES_HZ, POLES * s, RESIDUES[[k]]) for k, s in enumerate(state)]
    modes = identify_modes(frf_of(np.concatenate(rows), 60), BAND_HZ).model.modes
    found = np.array([mode.frequency_hz for mode in modes])
    std = np.array([mode.frequency_std_hz for mode in modes])
    np.testing.assert_allclose(found, TRUE_HZ, rtol=1e-3)
    assert np.all(np.abs(found - TRUE_HZ) < 4 * std)


def test_a_bent_resonance_is_one_mode_and_its_width_bounds_what_is_known():
    """A resonance that softens with its own response is no exact one."""
    clean = systems.inertance(LINES_HZ, POLES, RESIDUES)
    level = np.linalg.norm(clean, axis=0)
    bent_hz = LINES_HZ * (1 + 5e-4 * level / level.max())
    frf = frf_of(systems.inertance(bent_hz, POLES, RESIDUES), 70)
    np.testing.assert_allclose(found_hz(frf), TRUE_HZ, rtol=2e-3)


def test_what_changes_slowly_from_line_to_line_widens_the_error_bars():
    """Residuals like those of a model that does not quite fit."""
    clean = systems.inertance(LINES_HZ, POLES, RESIDUES)
    rng = np.random.default_rng(3)
    window = np.hanning(21)
    z = []
    for _ in range(6):
        noise = [
            np.convolve(row @ [1, 1j], window, "same") for row in rng.standard_normal((12, 599, 2))
        ]
        wave = np.array(noise) / np.linalg.norm(window) * np.sqrt(np.mean(np.abs(clean) ** 2))
        frf = systems.noise_free_frf(LINES_HZ, clean + 0.01 * wave)
        modes = fit_modes(frf, PoleSelection(POLES, BAND_HZ)).modes
        z += [
            (m.frequency_hz - hz) / m.frequency_std_hz for m, hz in zip(modes, TRUE_HZ, strict=True)
        ]
    assert np.sqrt(np.mean(np.square(z))) < 1.5


def fit_of(poles, residues):
    values = systems.inertance(LINES_HZ, POLES, residues)
    ones = np.ones(LINES_HZ.size)
    lines = Lines(LINES_HZ, values, ones, np.ones(12), np.zeros(12, dtype=int), ones)
    return evaluate(lines, np.append(poles, STAND_INS), np.zeros((1, N_DRIFT)))


def test_a_pole_shows_by_its_share_of_the_response():
    weak = RESIDUES * np.array([1.0, 1.0, 1e-3, 1.0])
    share = visible_share(fit_of(POLES, weak))
    assert share[2] < 0.1
    assert min(share[0], share[1], share[3]) > 0.3


def test_two_poles_in_the_place_of_one_show_by_what_joining_them_leaves():
    """Each has half of the mode's residues, and yet neither is needed."""
    poles = np.append(POLES[:3], POLES[3] * np.array([1.002, 0.998]))
    fit = fit_of(poles, RESIDUES)
    np.testing.assert_allclose(np.abs(fit.residues[:, 3] / RESIDUES[:, 3]), 0.5, rtol=0.02)
    assert visible_share(fit)[3:5].min() < 0.1


def test_a_broad_pole_around_a_sharper_one_is_beneath_it():
    poles = np.append(POLES, systems.pole([70.0], [0.12]))
    assert is_beneath(fit_of(poles, RESIDUES)).tolist()[:5] == [False] * 4 + [True]


def test_poles_that_hang_on_a_third_of_the_positions_scatter_without_them():
    fit = fit_of(POLES, RESIDUES)
    moves = iter((1.0, 1.03, 1.0))

    def refit(lines, poles):
        return replace(fit, poles=np.append(poles * next(moves), STAND_INS))

    std = scatter_over_positions(fit, refit)
    assert std[0, 0] == pytest.approx(40 * 0.03 * np.sqrt(2 * 2 / 9), rel=0.01)
    assert np.all(std[-2:] == 0)


def test_a_pole_of_one_part_of_the_positions_does_not_scatter_without_it():
    """As of a spindle, measured in two directions: the others show nothing of it."""
    elsewhere = np.arange(12) % 3 != 1
    shapes = np.where(elsewhere[:, None] & (np.arange(4) == 0), 0.1, 1.0) * RESIDUES
    fit = fit_of(POLES, shapes)
    moves = iter((1.001, 1.03, 1.0))

    def refit(lines, poles):
        return replace(fit, poles=np.append(poles * next(moves), STAND_INS))

    std = scatter_over_positions(fit, refit)
    assert std[0, 0] == pytest.approx(40 * 0.001 * np.sqrt(2 / 4), rel=0.01)
    assert std[1, 0] == pytest.approx(42 * 0.03 * np.sqrt(2 * 2 / 9), rel=0.05)


def test_a_weak_shape_without_common_phase_is_no_mode():
    turning = np.exp(1j * np.arange(12))[:, None]
    phase = np.where(np.arange(4) == 3, turning, 1.0)
    strong, weak = (RESIDUES * phase * size for size in (1.0, np.array([1, 1, 1, 0.02])))
    plain = RESIDUES * np.array([1, 1, 1, 0.02])
    found = [is_no_mode(fit_of(POLES, each), 0.1)[3] for each in (strong, weak, plain)]
    assert found == [False, True, False]


def test_a_pole_that_adds_less_than_the_model_leaves_is_below_its_misfit():
    fit = fit_of(POLES, RESIDUES)
    near = np.abs(LINES_HZ - 75.0) < 2.0
    ripple = np.where(near, 3 * np.abs(fit.lines.values).max() * (-1) ** np.arange(599), 0)
    for weight, below in ((1.0, [2]), (1e-6, [])):  # the same as misfit, and within the noise
        lines = replace(fit.lines, values=fit.lines.values + ripple, weight=np.full(599, weight))
        found = is_below_misfit(evaluate(lines, fit.poles, np.zeros((1, N_DRIFT))))
        assert np.flatnonzero(found[:4]).tolist() == below
    assert not np.any(is_below_misfit(fit)[:4])


def test_beside_the_ring_a_pole_as_uncertain_as_its_width_is_no_mode():
    mode = Mode(POLES[2], 0.01, 0.6 * 0.01, SHAPES[:, 2], np.zeros(12))
    assert is_undetermined(mode, True, IDENTIFICATION)
    assert not is_undetermined(mode, False, IDENTIFICATION)
    known = replace(mode, damping_std=0.4 * 0.01)
    assert not is_undetermined(known, True, IDENTIFICATION)


def test_beside_the_ring_the_band_ends_count():
    mode = Mode(POLES[2], 0.01, 1e-4, SHAPES[:, 2], np.zeros(12))
    moved = replace(mode, frequency_band_shift_hz=0.3, damping_band_shift=0.02)
    assert shift_beside([moved, moved, mode], {1, 2}).tolist() == [[0, 0], [0.3, 0.02], [0, 0]]


def test_a_hump_between_peaks_does_not_stand_out():
    hump = systems.pole(57.0, 0.1)
    poles = np.append(POLES, hump)
    weak = 0.1 * SHAPES[:, :1] * systems.residue(hump)
    values = systems.inertance(LINES_HZ, poles, np.hstack([RESIDUES, weak]))
    ones = np.ones(LINES_HZ.size)
    lines = Lines(LINES_HZ, values, ones, np.ones(12), np.zeros(12, dtype=int), ones)
    fit = evaluate(lines, np.append(poles, STAND_INS), np.zeros((1, N_DRIFT)))
    np.testing.assert_array_equal(stands_out(fit)[:5], [True, True, True, True, False])


def test_modes_with_peaks_are_ok():
    frf = frf_of(systems.inertance(LINES_HZ, POLES, RESIDUES), 40)
    assert all(mode.status == "ok" for mode in identify_modes(frf, BAND_HZ).model.modes)


@pytest.mark.parametrize(
    ("doubted", "peaks", "left_out"),
    [
        ({1, 2}, {3}, {1, 2}),  # another peak is there
        ({1, 2}, {1}, {2}),  # a hump at 3 would be all
        ({1, 2, 3}, {2}, {1, 3}),
        ({1, 2, 3}, set(), set()),
        ({1}, set(), {1}),
    ],
)
def test_peaks_that_stand_out_are_not_all_left_out(doubted, peaks, left_out):
    why = dict.fromkeys(doubted, "not determined")
    assert without_last_peaks(why, {1, 2, 3}, peaks).keys() == left_out
