"""Modes on the lines of their own resonance."""

import numpy as np
import pytest

import ema
from ema.core.modes import Flag, Mode
from ema.fitting.own_lines import note_of_coarse_lines, on_own_lines, with_coarse_lines
from ema.fitting.pole_fit import N_DRIFT, evaluate, lines_to_fit, with_stand_ins

BANDS_HZ = [(500.0, 800.0), (640.0, 700.0), (300.0, 1200.0), (550.0, 1800.0)]


def pole_of(frequency_hz, damping_ratio):
    size = 2 * np.pi * frequency_hz
    return size * (-damping_ratio + 1j * np.sqrt(1 - damping_ratio**2))


def response(frequency_hz, pole, residues):
    s = 2j * np.pi * frequency_hz
    direct, mirrored = 1 / (s - pole), 1 / (s - np.conj(pole))
    return s**2 * (np.outer(residues, direct) + np.outer(np.conj(residues), mirrored))


@pytest.fixture(scope="module")
def structure():
    """One sharp mode over broad ones that no fit of a few poles has: like a wheel of steel."""
    random = np.random.default_rng(5)
    hz = np.arange(200.0, 2000.0, 0.5)
    values = response(hz, pole_of(667.0, 0.008), -1j * random.uniform(0.5, 1.5, 12))
    for broad_hz in np.arange(300.0, 3000.0, 130.0):
        residues = -1j * random.normal(0, 1.2, 12)
        values += response(hz, pole_of(broad_hz + random.uniform(0, 60), 0.12), residues)
    noise = 2e-4 * np.abs(values).max() * random.standard_normal((2, *values.shape))
    return ema.FRF.from_arrays(hz, values + noise[0] + 1j * noise[1])


def test_every_band_gives_the_same_sharp_mode(structure):
    found = []
    for band_hz in BANDS_HZ:
        modes = ema.identify_modes(structure, band_hz).model.modes
        found.append(min(modes, key=lambda mode: abs(mode.frequency_hz - 667.0)))
    for mode in found:
        assert abs(mode.frequency_hz - 667.0) < min(0.05, 3 * mode.frequency_std_hz)
        assert abs(mode.damping_ratio - 0.008) < min(0.00004, 3 * mode.damping_std)


def weak_beside_strong(noise, step_hz=0.1):
    """A weak mode at 60 Hz, and a strong one at 100 Hz that each sensor sees in its own state."""
    random = np.random.default_rng(8)
    hz = np.arange(20.0, 160.0, step_hz)
    poles = np.array([pole_of(60.0, 0.01), pole_of(100.0, 0.02)])
    weak = response(hz, poles[0], -0.004j * random.uniform(0.5, 1.5, 12))
    own = 100.0 * (1 + 0.004 * random.standard_normal(12))
    strong = np.vstack([response(hz, pole_of(each, 0.02), np.array([-1j])) for each in own])
    size = noise * np.sqrt(np.mean(np.abs(weak) ** 2))
    added = size * (random.standard_normal(weak.shape) + 1j * random.standard_normal(weak.shape))
    frf = ema.FRF.from_arrays(hz, weak + strong + added, std=np.full(weak.shape, size))
    lines = lines_to_fit(frf, (30.0, 150.0))
    off = np.array([poles[0] * 1.0002 + 0.05 * poles[0].real, poles[1]])
    return poles, evaluate(lines, with_stand_ins(off, lines), np.zeros((1, N_DRIFT)))


def test_a_weak_mode_comes_from_its_own_lines():
    true, fit = weak_beside_strong(noise=0.02)
    poles, std = on_own_lines(fit, np.array([0]), 1.0)
    assert abs(poles[0] - true[0]) < 0.1 * abs(fit.poles[0] - true[0])
    off_hz = abs(abs(poles[0]) - abs(true[0])) / (2 * np.pi)
    assert off_hz < 3 * std[0, 0]
    assert std[0, 0] < 0.002
    assert np.array_equal(poles[1:], fit.poles[1:])
    assert not np.any(std[1:])


def test_a_mode_stays_where_noise_explains_the_change():
    _, fit = weak_beside_strong(noise=30.0)
    poles, std = on_own_lines(fit, np.array([0]), 1.0)
    assert np.array_equal(poles, fit.poles)
    assert not np.any(std)


def test_a_pole_without_a_resonance_stays():
    _, fit = weak_beside_strong(noise=0.02)
    far = fit.poles.copy()
    far[0] = pole_of(75.0, 0.05)
    fit = evaluate(fit.lines, far, fit.drift)
    poles, std = on_own_lines(fit, np.array([0]), 1.0)
    assert poles[0] == far[0]
    assert std[0, 1] > 0.005


def test_lines_farther_apart_than_the_half_width_leave_a_tenth_of_it_open():
    _, fit = weak_beside_strong(noise=30.0, step_hz=1.0)
    _, std = on_own_lines(fit, np.array([0]), 1.0)
    assert std[0, 0] == pytest.approx(0.06, rel=0.1)
    assert std[0, 1] == pytest.approx(0.001, rel=0.1)


def test_damping_of_modes_narrower_than_the_lines_is_less_certain(short_campaign):
    """Leakage is compensated; what that leaves open grows with the distance of the lines."""
    frf = ema.estimate_frf(ema.read_campaign(short_campaign))
    step_hz, hz = float(frf.frequency_hz[1] - frf.frequency_hz[0]), 150.0

    def relative_std(half_widths_hz, *flags):
        ratio = half_widths_hz / hz
        mode = Mode(pole_of(hz, ratio), 0.001, 1e-6 * ratio, np.ones(2), np.zeros(2), flags=flags)
        (wider,), covariance = with_coarse_lines([mode], np.zeros((2, 2)), frf)
        assert covariance[1, 1] == pytest.approx(wider.damping_std**2, rel=0.01)
        return wider.damping_std / ratio

    assert relative_std(10 * step_hz) < 3e-4
    assert relative_std(step_hz) == pytest.approx(16 * relative_std(4 * step_hz), rel=0.01)
    assert relative_std(10 * step_hz, Flag.AT_BOUND) > 0.5
    narrow = 2 * np.pi * np.array([complex(-0.5 * step_hz, hz), complex(-2 * step_hz, hz)])
    assert len([*note_of_coarse_lines(frf, narrow)]) == 1
    assert not [*note_of_coarse_lines(frf, narrow[1:])]
