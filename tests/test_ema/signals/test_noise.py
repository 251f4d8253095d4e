"""The noise level over frequency: smooth, except where a tone sticks out."""

from dataclasses import replace

import numpy as np
import pytest
import systems

from ema.signals.leakage import noise_level, without_spikes

ALL = slice(None)
TONE = 100


def frf_with(std, values=None):
    values = np.ones(std.shape, dtype=complex) if values is None else values
    frf = systems.noise_free_frf(np.arange(1.0, std.shape[1] + 1), values)
    return replace(frf, std=std)


def flat(level=0.1, lines=400):
    return np.full((3, lines), level)


def test_a_constant_level_is_kept():
    np.testing.assert_allclose(noise_level(frf_with(flat()), ALL), 0.1)


def test_the_scatter_of_single_lines_is_averaged_out():
    """σ of one line from 20 averages scatters by 16 %, that of 21 lines together by 4 %."""
    power = np.random.default_rng(0).gamma(20, 1 / 20, (4, 2000))
    level = noise_level(frf_with(np.sqrt(power)), ALL)
    assert np.std(level) < 0.05
    assert np.mean(level) == pytest.approx(1, abs=0.02)


def test_a_level_that_changes_slowly_is_followed():
    std = 0.1 * np.exp(np.linspace(0, 2, 400))[None, :]
    np.testing.assert_allclose(
        noise_level(frf_with(std), ALL)[:, 20:-20], std[:, 20:-20], rtol=0.01
    )


def test_a_line_with_a_tone_keeps_its_own_level_and_its_neighbours_theirs():
    std = flat()
    std[1, TONE] = 5.0
    level = noise_level(frf_with(std), ALL)
    assert level[1, TONE] == pytest.approx(5.0)
    np.testing.assert_allclose(np.delete(level[1], TONE), 0.1)
    np.testing.assert_allclose(level[[0, 2]], 0.1)


def test_only_the_lines_asked_for_count():
    std = flat()
    std[:, :50] = 7.0
    level = noise_level(frf_with(std), slice(50, 150))
    assert level.shape == (3, 100)
    np.testing.assert_allclose(level, 0.1)


def test_without_known_noise_lines_count_relative_to_the_frfs_around_them():
    values = np.exp(np.linspace(0, 3, 400)) * np.ones((2, 1))
    level = noise_level(frf_with(np.full((2, 400), np.nan), values), ALL)
    np.testing.assert_allclose((level / values)[:, 20:-20], 1, rtol=0.01)


def test_noise_of_zero_still_gives_weights_that_are_finite():
    level = noise_level(frf_with(flat(0.0)), ALL)
    assert np.all(level > 0)
    assert np.all(np.isfinite(1 / level))


def test_a_tone_is_bridged_from_its_neighbours():
    std, values = flat(), np.linspace(1, 2, 400) * (1 + 1j) * np.ones((3, 1))
    std[1, TONE] = 5.0
    hum = values.copy()
    hum[1, TONE] += 40
    bridged = without_spikes(frf_with(std, hum), ALL, hum.copy())
    np.testing.assert_allclose(bridged, values, rtol=1e-12)


@pytest.mark.parametrize("level", [np.nan, 0.1])
def test_without_a_tone_nothing_is_touched(level):
    values = np.random.default_rng(0).standard_normal((3, 400)) * (1 + 0j)
    frf = frf_with(flat(level), values)
    np.testing.assert_array_equal(without_spikes(frf, ALL, values.copy()), values)
