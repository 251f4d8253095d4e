"""FRFs that do not state how they were averaged: what a Hann window may have added to damping."""

from dataclasses import replace

import numpy as np
import pytest
import systems

from ema.core.recording import BlockPlan, ExponentialWindow
from ema.identify import identify_modes

BLOCK_S, FINER, RATE_HZ = 2.0, 16, 1024.0
BAND_HZ = (60.0, 240.0)


def through_hann():
    """The tyre of Table 3 as blocks of white noise under a Hann window show it, on the mean.

    They average its FRF with the power of the window's spectrum as weight.
    """
    fine_hz = np.arange(1, 400 * FINER * BLOCK_S) / (BLOCK_S * FINER)
    exact = systems.tyre_frf(frequency_hz=fine_hz)
    n = 64
    weight = np.abs(np.fft.fft(np.hanning(n + 1)[:-1], n * FINER)) ** 2
    weight = np.fft.fftshift(weight)[n * FINER // 2 - 4 * FINER : n * FINER // 2 + 4 * FINER + 1]
    blurred = [np.convolve(row, weight / weight.sum(), mode="same") for row in exact.values]
    lines = slice(9 * FINER - 1, None, FINER)
    values = np.array(blurred)[:, lines]
    return replace(
        exact,
        frequency_hz=fine_hz[lines],
        values=values,
        std=np.full(values.shape, 1e-4 * np.abs(values).mean()),
        coherence=np.full(values.shape, 0.999),
    )


@pytest.fixture(scope="module")
def blurred():
    return through_hann()


def errors_of(frf):
    """Damping ratios against the truth, and their standard deviations."""
    modes = identify_modes(frf, BAND_HZ).model.modes
    assert [mode.order for mode in modes] == [1, 2, 3, 4, 5, 6, 7]
    found = np.array([mode.damping_ratio for mode in modes])
    return found - systems.TABLE_3_DAMPING, np.array([mode.damping_std for mode in modes])


def test_what_a_hann_window_adds_to_damping_is_within_the_interval(blurred):
    error, std = errors_of(blurred)
    assert np.all(error > 0.005 * systems.TABLE_3_DAMPING)
    assert np.all(error < 1.96 * std)
    assert np.all(error > 0.5 * std)


def test_blocks_that_are_known_leave_no_window_open(blurred):
    plan = BlockPlan(RATE_HZ, round(BLOCK_S * RATE_HZ), round(RATE_HZ), 1, "boxcar")
    _, unknown = errors_of(blurred)
    _, known = errors_of(replace(blurred, blocks=plan))
    assert np.all(known < 0.5 * unknown)


def test_the_result_says_so(blurred):
    found = identify_modes(blurred, BAND_HZ).model
    assert sum("Hann" in note for note in found.notes) == 1
    windowed = replace(blurred, exponential_window=ExponentialWindow(5.0))
    assert not any("Hann" in note for note in identify_modes(windowed, BAND_HZ).model.notes)
