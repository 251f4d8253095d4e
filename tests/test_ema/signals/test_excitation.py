"""Steady shaker noise against events: sweeps, bursts and impacts."""

import numpy as np
import pytest
import systems
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import butter, chirp, sosfilt

from ema.core.recording import FORCE, Channel
from ema.signals.excitation import is_steady, period_samples, repeats_after

RATE_HZ, DURATION_S = 2000.0, 20.0
TIMES_S = np.arange(round(RATE_HZ * DURATION_S)) / RATE_HZ


def steady(samples):
    return is_steady(Channel("force", FORCE, "N", samples))


def noise(seed=0):
    return systems.white(TIMES_S.size, seed)


def shaker_noise():
    return sosfilt(butter(4, [10, 900], "bandpass", fs=RATE_HZ, output="sos"), noise())


def test_a_missing_sample_hides_no_period():
    force = np.resize(noise()[:2000], 40_000)
    force[5] = np.nan
    assert period_samples(load_cell(force), SHORTEST) == 2000


@pytest.mark.parametrize(
    "force",
    [
        pytest.param(noise(), id="white"),
        pytest.param(shaker_noise(), id="band-limited"),
        pytest.param(50 + 10 * noise(), id="preloaded"),
        pytest.param(np.cumsum(noise()) * 0.01 + noise(), id="with a drifting offset"),
        pytest.param(np.tile(noise()[:2000], 20), id="periodic"),
        pytest.param(np.sin(2 * np.pi * 80 * TIMES_S), id="a tone"),
    ],
)
def test_a_force_that_goes_on_is_steady(force):
    assert steady(force)


@pytest.mark.parametrize(
    "force",
    [
        pytest.param(chirp(TIMES_S, 10, DURATION_S, 900), id="sweep"),
        pytest.param(chirp(TIMES_S, 10, DURATION_S, 900, "logarithmic"), id="log sweep"),
        pytest.param(noise() * (TIMES_S < 4), id="burst"),
        pytest.param(1000 * np.exp(-0.5 * ((TIMES_S - 0.5) / 1e-3) ** 2), id="impact"),
    ],
)
def test_an_event_is_not(force):
    assert not steady(force + 1e-3 * noise(1))


@given(st.integers(0, 2**31), st.integers(2_000, 40_000))
def test_white_noise_of_any_length_is_steady(seed, n_samples):
    assert steady(systems.white(n_samples, seed))


@pytest.mark.parametrize("force", [np.zeros(40_000), np.full(40_000, 50.0), noise()[:200]])
def test_what_cannot_be_judged_counts_as_steady(force):
    assert steady(force)


SHORTEST = round(0.25 * RATE_HZ)


def load_cell(samples):
    return Channel("force", FORCE, "N", samples)


def sweep(n_samples):
    return chirp(np.arange(n_samples) / RATE_HZ, 15, n_samples / RATE_HZ, 400)


@pytest.mark.parametrize("period", [1000, 8001, 20_000])
@pytest.mark.parametrize("one", [noise, sweep], ids=["pseudo-random", "sweep"])
def test_what_repeats_has_its_period(one, period):
    force = load_cell(50 + np.resize(one(period) if one is sweep else noise()[:period], 40_000))
    noisy = load_cell(force.samples + 0.05 * noise(1))
    assert period_samples(noisy, SHORTEST) == period
    assert repeats_after(noisy, period)
    assert not repeats_after(noisy, period + 7)
    assert not repeats_after(noisy, 40_000 - period // 2)


@pytest.mark.parametrize("period", [4000.4, 4000.5, 4000.6])
def test_a_period_between_two_samples_is_that_of_the_nearest(period):
    time = 2 * np.pi * np.arange(12_000) / period
    phases = np.random.default_rng(3).uniform(0, 2 * np.pi, 1600)
    force = sum(np.cos(line * time + phase) for line, phase in enumerate(phases, 20))
    assert period_samples(load_cell(force), SHORTEST) in (4000, 4001)


@pytest.mark.parametrize(
    "force",
    [
        pytest.param(noise(), id="white"),
        pytest.param(shaker_noise(), id="band-limited"),
        pytest.param(noise() + 2 * np.sin(2 * np.pi * 50 * TIMES_S), id="noise and hum"),
        pytest.param(sweep(40_000), id="one sweep"),
        pytest.param(np.resize(noise()[:25_000], 40_000), id="less than two periods"),
        pytest.param(np.ones(40_000), id="constant"),
        pytest.param(np.where(np.arange(40_000) % 9, np.nan, noise()), id="gaps"),
    ],
)
def test_what_does_not_repeat_has_none(force):
    assert period_samples(load_cell(force), SHORTEST) == 0


@pytest.mark.parametrize("place", [36, 5000, 30_000])
def test_a_single_impact_is_an_event_wherever_it_is(place):
    force = 0.02 * np.random.default_rng(4).standard_normal(50_000)
    force[place : place + 7] += 200 * np.hanning(7)
    assert not steady(force)
