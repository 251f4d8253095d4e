"""The damping that an exponential window of the analyser adds does not stay in the modes."""

from dataclasses import replace

import numpy as np
import pytest
import systems

from ema.core.errors import FitError
from ema.core.mac import frac
from ema.core.recording import ExponentialWindow
from ema.identify import fit_modes
from ema.poles.tracking import PoleSelection
from ema.signals.frf_estimation import estimate_frf

ANGLES_DEG = np.arange(0.0, 360.0, 30.0)
POLES = systems.table_3_poles()[:9]
TRUTH = systems.TABLE_3_DAMPING


def windowed(window, poles=POLES, noise_share=1e-3):
    """FRFs of responses that were multiplied by e^{−t/τ} and averaged 100 times."""
    s = 2j * np.pi * systems.LINES_HZ + window.decay_per_s
    residues = systems.tyre_residues(ANGLES_DEG, poles)
    values = s**2 * (
        residues @ (1 / (s - poles[:, None])) + residues.conj() @ (1 / (s - poles[:, None].conj()))
    )
    std = np.full(values.shape, noise_share * np.abs(values).max())
    noise = np.random.default_rng(1).standard_normal((2, *values.shape))
    values = values + std * (noise[0] + 1j * noise[1])
    return systems.noise_free_frf(
        systems.LINES_HZ, values, std=std, position_deg=ANGLES_DEG, exponential_window=window
    )


def fitted(frf, poles=POLES):
    start = poles - frf.exponential_window.decay_per_s
    return fit_modes(frf, PoleSelection(start, (20.0, 240.0)))


def test_the_declaration_goes_with_the_frfs():
    run = systems.run_of(systems.white(4000, 1), systems.white(4000, 2))
    campaign = systems.campaign_of(run, exponential_window_s=0.2, exponential_window_std_s=0.01)
    assert estimate_frf(campaign).exponential_window == ExponentialWindow(0.2, 0.01)


@pytest.mark.parametrize("time_constant_s", [0.5, 0.2, 0.08])
def test_its_damping_is_compensated(time_constant_s):
    model = fitted(windowed(ExponentialWindow(time_constant_s)))
    np.testing.assert_allclose(model.damping_ratios, TRUTH, rtol=4e-3)
    np.testing.assert_allclose(model.frequencies_hz, systems.TABLE_3_HZ, rtol=1e-4)
    errors = (model.damping_ratios - TRUTH) / [mode.damping_std for mode in model.modes]
    assert np.abs(errors).max() < 4


def test_the_fit_is_drawn_with_the_window_and_the_modes_without():
    frf = windowed(ExponentialWindow(0.2))
    model = fitted(frf)
    lines = slice(40, 480)
    values, at = frf.values[:, lines], frf.frequency_hz[lines]
    assert frac(values, model.synthesise(at, frf.run)).min() > 0.999
    bare = systems.inertance(at, POLES, systems.tyre_residues(ANGLES_DEG, POLES))
    assert frac(bare, model.synthesise(at)).min() > 0.999


def test_an_uncertain_window_makes_the_damping_uncertain_in_common():
    windows = ExponentialWindow(0.2), ExponentialWindow(0.2, 0.01)
    sure, unsure = (fitted(windowed(window, noise_share=3e-4)) for window in windows)
    decay_std = 0.01 / 0.2**2
    for before, after in zip(sure.modes, unsure.modes, strict=True):
        added = np.sqrt(after.damping_std**2 - before.damping_std**2)
        assert added == pytest.approx(decay_std / (2 * np.pi * before.frequency_hz), rel=0.02)
    scale = np.sqrt(np.diag(unsure.covariance))
    assert (unsure.covariance / np.outer(scale, scale))[1, 3] > 0.95


def test_what_decays_more_slowly_than_the_window_is_not_listed():
    frf = windowed(ExponentialWindow(0.2))
    wrong = ExponentialWindow(1 / 23.8)  # order 3 decays with 23.3/s, the others faster
    too_short = replace(frf, exponential_window=wrong)
    model = fit_modes(too_short, PoleSelection(POLES - 5.0, (20.0, 240.0)))
    assert len(model.modes) == 6
    assert len(model.modes) + len(model.guard_modes) == len(fitted(frf).modes) + len(
        fitted(frf).guard_modes
    )
    assert all(mode.damping_ratio > 0 for mode in model.modes)
    with pytest.raises(FitError, match="exponential_window_s"):
        fit_modes(
            replace(frf, exponential_window=ExponentialWindow(0.01)),
            PoleSelection(POLES - 5.0, (20.0, 240.0)),
        )
